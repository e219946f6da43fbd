"""What a mechanism must be beyond the form of its values: names, numbers and graph agree."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator
from fnmatch import fnmatchcase
from typing import Any

from gough import algebra as al
from gough.description.check_actuators import actuator_problems
from gough.description.expression import RESERVED, ExpressionError
from gough.description.flat import OWN, Flat, flatten
from gough.description.form import Description
from gough.description.frames import FrameError, transform
from gough.description.parts import Body, Constraint, Frame, Joint, Motor
from gough.description.values import array, evaluate_parameters, scalar, vector
from gough.errors import Path, Problem, closest
from gough.joints import TYPES
from gough.joints.free import POSE, ROTATIONS, Free

MAX_LINKS = 1000
"""Most joints and constraints together; more would keep dense linear algebra busy for minutes."""
PLANAR_MOVES = ("x", "y", "rz")
PLANAR_TOLERANCE = 1e-9
LEVEL = ("prismatic", "fixed", "parallelogram", "frames-coincide")
"""Planar joints and constraints whose frames give the whole orientation of a body."""
POSE_TOLERANCE = 1e-9
INERTIA_TOLERANCE = 1e-9
"""Relative to the trace; moments that meet the triangle inequality with equality pass."""


def problems_of(mechanism: Description, broken: Collection[str] = ()) -> list[Problem]:
    """Everything wrong with a mechanism whose values have the right form.

    Args:
        mechanism: the mechanism.
        broken: names of parts that were left out because their form is wrong, with * for what
            is not known of them. They count as known, and the graph is not judged if there are
            any.
    """
    checker = _Checker(mechanism, broken)
    checker.run()
    return list(dict.fromkeys(checker.problems))


class _Checker:
    """Collects the problems of one mechanism."""

    def __init__(self, mechanism: Description, broken: Collection[str]) -> None:
        self.mechanism, self.broken = mechanism, tuple(broken)
        self.flat: Flat = flatten(mechanism)
        self.problems: list[Problem] = []
        self.values: dict[str, Any] = {}

    def run(self) -> None:
        """Collect everything that is wrong."""
        if len(self.flat.links) > MAX_LINKS:
            count = len(self.flat.links)
            self.report((), f"{count} joints and constraints; at most {MAX_LINKS} can be handled")
            return
        self._check_parameters()
        self._check_names()
        for name, body in self.flat.bodies.items():
            self._check_body(name, body)
        for name, joint in (self.flat.joints | self.flat.expanded).items():
            self._check_joint(name, joint)
        for name, constraint in self.flat.constraints.items():
            self._check_ends("constraints", name, constraint)
        self._check_couplings()
        self._check_roles()
        self._check_cut()
        self._number(self.mechanism.gravity, ("gravity",), 3)
        self._check_variants()
        if not self.problems and not self.broken:
            self._check_graph()

    def report(self, path: Path, message: str, on_key: bool = False) -> None:
        """Note a problem; names of a leg's own parameters as they are written there."""
        if path[:1] == ("legs",):
            message = re.sub(rf"\b\w+?{OWN}(?=\w)", "", message)
        self.problems.append(Problem(message, path, on_key))

    # names and numbers

    def _check_parameters(self) -> None:
        for path in self.flat.paths.values():
            if path[-2] == "parameters" and path[-1] in RESERVED | {"i"}:
                self.report(path, f"{path[-1]!r} has a meaning of its own", on_key=True)
        self.values = evaluate_parameters(
            self.flat.parameters,
            report=self._report_parameter,
        )

    def _report_parameter(self, name: str, text: str) -> None:
        """Note that a parameter has no value; once for all repetitions of a leg."""
        path = self.flat.paths["parameters", name]
        known = any(problem.path == path for problem in self.problems)
        if not known and not _names_any(text, self.broken):
            self.report(path, text)

    def _check_names(self) -> None:
        for path, name in self.flat.clashes:
            self.report(path, f"the name {name!r} is taken", on_key=True)
        if self.mechanism.base in self.flat.bodies:
            body = self.flat.bodies[self.mechanism.base]
            if body.free is not None or body.home is not None:
                path = ("bodies", self.mechanism.base)
                self.report(path, "the base can not be free or have a home; see `floating`")

    def _value(self, path: Path, read: Callable[[], Any]) -> Any:
        """What ``read`` returns, or None after a report."""
        try:
            return read()
        except ExpressionError as error:
            if not self._follows(error):
                self.report(path, str(error))
        return None

    def _follows(self, error: Exception) -> bool:
        """Whether an error only repeats that a parameter has no value, which was reported."""
        valueless = self.flat.parameters.keys() - self.values.keys() | set(self.broken)
        return _names_any(str(error), valueless)

    def _number(self, value: Any, path: Path, *lengths: int) -> Any:
        return self._value(path, lambda: vector(value, self.values, *lengths))

    def _scalar(self, value: Any, path: Path) -> Any:
        return self._value(path, lambda: scalar(value, self.values))

    def _array(self, value: Any, path: Path) -> Any:
        return self._value(path, lambda: array(value, self.values))

    # bodies

    def _check_body(self, name: str, body: Body) -> None:
        path = self.flat.paths["bodies", name]
        mass = self._scalar(body.mass, (*path, "mass"))
        if mass is not None and mass < 0:
            self.report((*path, "mass"), f"the mass is {mass:g} kg; it can not be negative")
        self._number(body.com, (*path, "com"), 2, 3)
        inertia = self._number(body.inertia, (*path, "inertia"), 3, 6)
        if inertia is not None:
            self._check_inertia(inertia, mass, (*path, "inertia"))
        if body.rotation != "exact":
            self._check_rotation(name, body, (*path, "rotation"))
        if self.mechanism.motion == "planar" and body.free:
            for move in sorted(set(body.free) - set(PLANAR_MOVES)):
                self.report(
                    (*path, "free"), f"{move!r} leaves the plane; planar bodies move in x, y, rz"
                )
        if body.home is not None:
            home = self._frame(body.home, (*path, "home"))
            platform = self.mechanism.platform
            lost = platform is not None and not self._is_body(platform)
            if body.free is None and name != self.mechanism.platform and not lost:
                self.report((*path, "home"), "only a free link or the platform has a home pose")
            elif home is not None and (body.free is not None or not lost):
                self._check_pose(name, home, (*path, "home"))

    def _check_rotation(self, name: str, body: Body, path: Path) -> None:
        """Formulas in the rotation vector are of free links that turn freely in a fixed frame."""
        free = body.free is not None or name == self.mechanism.platform
        kind = f"{body.rotation!r} is for"
        if not free or name == self.mechanism.base:
            self.report(path, f"{kind} a free link or the platform; {name!r} is none")
        elif not set(ROTATIONS) <= set(self._moves(name)):
            known = ", ".join(self._moves(name))
            self.report(path, f"{kind} a body that turns freely; {name!r} moves in {known}")
        elif self.mechanism.floating:
            self.report(path, f"{kind} bodies on a base that is fixed; this one floats")
        com = self._number(body.com, (*path[:-1], "com"), 2, 3)
        if com is not None and any(com):
            self.report(path, f"{kind} a body whose centre of mass is its origin: com [0, 0, 0]")

    def _check_pose(self, name: str, home: al.Transform, path: Path) -> None:
        """A free link that can not have its home pose is refused, and not moved to another."""
        kind = Free(self._moves(name))
        (R, p), (S, q) = home, kind.placement(kind.from_pose(home), {})
        entries = [pair for r, s in zip(R, S, strict=True) for pair in zip(r, s, strict=True)]
        turned = max(abs(x - y) for x, y in entries)
        moved = max(abs(x - y) for x, y in zip(p, q, strict=True))
        if max(turned, moved) > POSE_TOLERANCE * max(1.0, *map(abs, p)):
            known = ", ".join(kind.moves)
            self.report(path, f"{name!r} moves in {known} alone; this pose asks for more")

    def _check_inertia(self, inertia: tuple[float, ...], mass: float | None, path: Path) -> None:
        import numpy as np

        xx, yy, zz, xy, xz, yz = (*inertia, 0.0, 0.0, 0.0)[:6]
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        slack = INERTIA_TOLERANCE * max(float(np.abs(moments).sum()), 1e-300)
        shown = ", ".join(f"{moment:.6g}" for moment in moments)
        if moments[0] < -slack:
            self.report(path, f"no body has negative principal moments: {shown} kg m²")
        elif moments[2] > moments[0] + moments[1] + slack:
            self.report(
                path,
                f"no body has the principal moments {shown} kg m²: "
                "the largest must not exceed the sum of the others",
            )
        elif mass == 0 and moments[2] > 0:
            self.report(path, "a body without mass can not have inertia")

    # joints and constraints

    def _check_joint(self, name: str, joint: Joint) -> None:
        path = self.flat.paths["joints", name]
        kind = TYPES[joint.type]
        self._check_ends("joints", name, joint)
        self._check_dimensions(joint, path)
        if joint.home is not None:
            self._check_home(joint, path)
        if joint.actuated and kind.freedoms == 0:
            self.report((*path, "actuated"), f"a {joint.type} joint has no freedom to actuate")
        if joint.actuated and joint.type == "free":
            self.report((*path, "actuated"), "a free joint has no motor")
        if joint.motor is not None:
            self._check_motor(joint, joint.motor, (*path, "motor"))
        for problem in actuator_problems(joint, path, self._array, self._scalar):
            self.report(problem.path, problem.message, problem.on_key)
        if self.mechanism.motion == "planar" and not kind.planar:
            known = ", ".join(sorted(t for t in TYPES if TYPES[t].planar))
            self.report(
                (*path, "type"), f"a {joint.type} joint leaves the plane; planar are {known}"
            )

    def _check_motor(self, joint: Joint, motor: Motor, path: Path) -> None:
        rates = TYPES[joint.type].rates
        if len(rates) != 1:
            text = f"a motor needs a joint of one freedom; a {joint.type} joint has {len(rates)}"
            self.report(path, text, on_key=True)
        elif not joint.actuated:
            self.report(path, "a joint with a motor needs actuated: true", on_key=True)
        inertia = self._scalar(motor.inertia, (*path, "inertia"))
        if inertia is not None and inertia < 0:
            text = f"the inertia of the rotor is {inertia:g} kg m²; it can not be negative"
            self.report((*path, "inertia"), text)
        if self._scalar(motor.ratio, (*path, "ratio")) == 0:
            self.report((*path, "ratio"), "the ratio is zero: the motor would not move the joint")
        slides = rates == ("m",)
        limits = (
            ("effort", motor.effort, "N" if slides else "N m"),
            ("speed", motor.speed, "m/s" if slides else "rad/s"),
        )
        for key, written, unit in limits:
            limit = None if written is None else self._scalar(written, (*path, key))
            if limit is not None and limit <= 0:
                text = f"the largest {key} is {limit:g} {unit}; it must be positive"
                self.report((*path, key), text)

    def _check_dimensions(self, joint: Joint, path: Path) -> None:
        kind = TYPES[joint.type]
        known = kind.required + kind.optional
        for key in joint.dimensions:
            if key not in known:
                text = closest(key, known) if known else " It needs none."
                self.report(
                    (*path, "dimensions", key),
                    f"a {joint.type} joint has no dimension {key!r}.{text}",
                    on_key=True,
                )
        for key in kind.required:
            if key not in joint.dimensions:
                self.report(
                    path, f"a {joint.type} joint needs dimensions: {{{key}: …}}", on_key=True
                )
        for key, written in joint.dimensions.items():
            value = self._scalar(written, (*path, "dimensions", key))
            if value is not None and (value == 0 if key == "pitch" else value <= 0):
                wanted = "other than zero" if key == "pitch" else "positive"
                self.report((*path, "dimensions", key), f"{key} is {value:g}; it must be {wanted}")

    def _check_home(self, joint: Joint, path: Path) -> None:
        written = TYPES[joint.type].written
        home = self._number(joint.home, (*path, "home"), *written)
        turns = joint.type in ("spherical", "free") and home is not None and len(home) in (4, 7)
        if turns and not any(home[-4:]):
            self.report((*path, "home"), "a quaternion of zeros is no rotation")

    def _check_ends(self, kind: str, name: str, part: Joint | Constraint) -> None:
        path = self.flat.paths[kind, name]
        for k, body in enumerate(part.bodies):
            if not self._is_body(body):
                own = self.mechanism.legs[str(path[1])].bodies if path[0] == "legs" else ()
                known = [*own, *sorted({self.mechanism.base, *self.flat.bodies})]
                text = f"there is no body {body!r}.{closest(body, known)}"
                self.report((*path, "bodies", k), text)
        if part.bodies[0] == part.bodies[1]:
            self.report((*path, "bodies"), f"both ends are on {part.bodies[0]!r}")
        frames = [
            self._frame(frame, (*path, "frames", k), part) for k, frame in enumerate(part.frames)
        ]
        if self.mechanism.motion == "planar" and part.type in LEVEL and None not in frames:
            a, b = (T[0] for T in frames if T is not None)
            if abs(abs(al.dot(a[2], b[2])) - 1) > PLANAR_TOLERANCE:
                text = "the two frames turn one body out of the plane of the other; see `across`"
                self.report((*path, "frames"), text)

    def _frame(
        self, frame: Frame, path: Path, part: Joint | Constraint | None = None
    ) -> al.Transform | None:
        """T_body_frame, or None after a report."""
        try:
            T = transform(frame, self.values)
        except FrameError as error:
            if not self._follows(error):
                self.report((*path, error.field), str(error))
            return None
        if self.mechanism.motion == "planar" and part is not None:
            self._check_plane(T, path, part)
        return T

    def _check_plane(self, T: al.Transform, path: Path, part: Joint | Constraint) -> None:
        """Pins stand on the plane, sliders and directions lie in it."""
        lean = abs(al.column(T[0], 2)[2])
        if part.type in ("revolute", "parallelogram") and abs(lean - 1) > PLANAR_TOLERANCE:
            self.report(path, f"the axis of a planar {part.type} joint is z, or -z")
        if part.type in ("prismatic", "directions-parallel") and lean > PLANAR_TOLERANCE:
            self.report(path, f"the axis of a planar {part.type} lies in the x-y plane")

    def _is_body(self, name: str) -> bool:
        return name in (*self.flat.bodies, self.mechanism.base) or self._is_broken(name)

    def _is_broken(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self.broken)

    # couplings, roles, cuts

    def _check_couplings(self) -> None:
        for name, coupling in self.flat.couplings.items():
            path = self.flat.paths["couplings", name]
            self._scalar(coupling.offset, (*path, "offset"))
            for joint, factor in coupling.terms.items():
                own = joint.rsplit(".", 1)[-1] if path[0] == "legs" else joint
                place = (*path, "terms", own)
                self._check_single(joint, place)
                if self._scalar(factor, place) == 0:
                    self.report(place, "the factor is zero")

    def _check_single(self, name: str, path: Path) -> None:
        """The name is that of a joint of one freedom."""
        if name in self.flat.joints:
            kind = TYPES[self.flat.joints[name].type]
            if kind.freedoms != 1:
                text = f"{name!r} is {kind.name} with {kind.freedoms} freedoms; one is needed"
                self.report(path, text)
        elif not self._is_broken(name):
            known = sorted(self.flat.joints)
            self.report(path, f"there is no joint {name!r}.{closest(name, known)}")

    def _check_roles(self) -> None:
        platform, operational = self.mechanism.platform, self.mechanism.operational
        if platform is not None and not self._is_body(platform):
            known = sorted(self.flat.bodies)
            self.report(("platform",), f"there is no body {platform!r}.{closest(platform, known)}")
        elif platform == self.mechanism.base:
            self.report(("platform",), "the platform can not be the base")
        for k, name in enumerate(operational):
            if operational.index(name) != k:
                self.report(("operational", k), f"{name!r} is listed twice")
            elif name in POSE:
                self._check_coordinate(name, ("operational", k))
            elif platform is not None and name not in self.flat.joints:
                known = [*POSE, *sorted(self.flat.joints)]
                text = f"there is no output {name!r}.{closest(name, known)}"
                if not self._is_broken(name):
                    self.report(("operational", k), text)
            else:
                self._check_single(name, ("operational", k))
                joint = self.flat.joints.get(name)
                if joint is not None and joint.actuated:
                    self.report(("operational", k), f"{name!r} is actuated: an input, no output")

    def _check_coordinate(self, name: str, path: Path) -> None:
        platform = self.mechanism.platform
        if platform is None:
            self.report(path, f"{name!r} is a coordinate of the platform, and none is named")
        elif platform in self.flat.bodies and name not in self._moves(platform):
            known = ", ".join(self._moves(platform))
            self.report(path, f"{name!r} is no free coordinate of {platform!r}; these are: {known}")

    def _moves(self, body: str) -> tuple[str, ...]:
        moves = self.flat.bodies[body].free
        every = PLANAR_MOVES if self.mechanism.motion == "planar" else POSE
        return moves or every

    def _check_cut(self) -> None:
        coupled = {joint for c in self.flat.couplings.values() for joint in c.terms}
        coupled.update(self.mechanism.operational)
        for k, name in enumerate(self.mechanism.cut):
            joint = self.flat.joints.get(name)
            if joint is None:
                if not self._is_broken(name):
                    known = sorted(self.flat.joints)
                    self.report(("cut", k), f"there is no joint {name!r}.{closest(name, known)}")
            elif joint.actuated:
                self.report(("cut", k), f"{name!r} is actuated; only passive joints can be cut")
            elif name in coupled:
                self.report(
                    ("cut", k), f"{name!r} is in a coupling or an output and can not be cut"
                )
            elif joint.actuators:
                text = f"{name!r} has actuators, which need its variable, and can not be cut"
                self.report(("cut", k), text)

    # variants

    def _check_variants(self) -> None:
        """Changes are of entries that there are, and leave the variants themselves alone."""
        known = sorted(Description.model_fields.keys() - {"variants"})
        for name, variant in self.mechanism.variants.items():
            for key in variant.changes:
                path = ("variants", name, "changes", key)
                if key == "variants":
                    self.report(path, "a variant can not change the variants", on_key=True)
                elif key not in known:
                    text = f"there is no entry {key!r} to change.{closest(key, known)}"
                    self.report(path, text, on_key=True)

    # the graph

    def _check_graph(self) -> None:
        reached = set(self._component(self.mechanism.base))
        for name in self.flat.bodies:
            if name in reached:
                continue
            path = self.flat.paths["bodies", name]
            island = sorted(self._component(name))
            if len(island) == 1:
                self.report(path, f"nothing holds body {name!r}: no joint names it", on_key=True)
            else:
                others = ", ".join(other for other in island if other != name)
                text = f"body {name!r} hangs together with {others}, but not with the base"
                self.report(path, text, on_key=True)

    def _component(self, start: str) -> Iterator[str]:
        """Bodies that joints and constraints join to one body, itself included."""
        neighbours: dict[str, set[str]] = {}
        for part in self.flat.links:
            a, b = part.bodies
            neighbours.setdefault(a, set()).add(b)
            neighbours.setdefault(b, set()).add(a)
        seen, todo = {start}, [start]
        while todo:
            body = todo.pop()
            yield body
            new = neighbours.get(body, set()) - seen
            seen |= new
            todo.extend(new)


def _names_any(text: str, names: Collection[str]) -> bool:
    """Whether a message quotes one of the names."""
    return any(f"'{name}'" in text for name in names)
