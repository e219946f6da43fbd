"""The parts of a mechanism with legs and parallelograms written out."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gough.description.expression import Expression
from gough.description.form import Description
from gough.description.parts import (
    Body,
    Constraint,
    Coupling,
    Frame,
    Joint,
    Leg,
    Parameter,
    Part,
)
from gough.errors import Path


@dataclass
class Flat:
    """Every parameter, body, joint, constraint and coupling by its full name.

    ``paths`` says where a part was written: one place in a leg serves all its repetitions.
    ``clashes`` lists names that came up twice; ``expanded`` keeps the joints that were replaced by
    bodies, joints and couplings.
    """

    parameters: dict[str, Parameter] = field(default_factory=dict)
    bodies: dict[str, Body] = field(default_factory=dict)
    joints: dict[str, Joint] = field(default_factory=dict)
    constraints: dict[str, Constraint] = field(default_factory=dict)
    couplings: dict[str, Coupling] = field(default_factory=dict)
    paths: dict[tuple[str, str], Path] = field(default_factory=dict)
    clashes: list[tuple[Path, str]] = field(default_factory=list)
    expanded: dict[str, Joint] = field(default_factory=dict)

    def add(self, kind: str, name: str, part: Part, path: Path) -> None:
        """Keep a part; a name that is taken by another of its kind is a clash."""
        if (kind, name) in self.paths:
            self.clashes.append((path, name))
            return
        getattr(self, kind)[name] = part
        self.paths[kind, name] = path

    @property
    def links(self) -> list[Joint | Constraint]:
        """Joints, then constraints: all that ties two bodies."""
        return [*self.joints.values(), *self.constraints.values()]


BARS = {"length", "width", "bar_mass"}
"""Dimensions of a parallelogram whose bars are bodies."""
OWN = "__"
"""Between a leg's name and a parameter's, in the full name of a leg's own parameter."""
KINDS = ("bodies", "joints", "constraints", "couplings")


def flatten(mechanism: Description) -> Flat:
    """Write out the legs and the parallelograms whose bars have mass."""
    flat = Flat()
    for name, parameter in mechanism.parameters.items():
        flat.add("parameters", name, parameter, ("parameters", name))
    for kind in KINDS:
        for name, part in getattr(mechanism, kind).items():
            _add(flat, kind, name, part, (kind, name))
    for name, leg in mechanism.legs.items():
        for i in range(leg.repeat or 1):
            _add_leg(flat, name, leg, i)
    return flat


def _add_leg(flat: Flat, name: str, leg: Leg, i: int) -> None:
    prefix = f"{name}{i + 1}" if leg.repeat else name
    own = {parameter: _own_name(prefix, parameter) for parameter in leg.parameters}
    names: dict[str, int | str] = {"i": i, **own}
    for parameter, part in leg.parameters.items():
        path = ("legs", name, "parameters", parameter)
        flat.add("parameters", own[parameter], bound(part, names), path)
    for kind in KINDS:
        for short, part in getattr(leg, kind).items():
            placed = _relabelled(bound(part, names), leg, prefix)
            _add(flat, kind, f"{prefix}.{short}", placed, ("legs", name, kind, short))


def _own_name(prefix: str, parameter: str) -> str:
    """The full name of a leg's parameter, which expressions can hold: leg1.q is leg1__q."""
    letters = re.sub(r"\W", lambda match: f"_{ord(match[0]):x}_", prefix)
    return f"{letters}{OWN}{parameter}"


def _add(flat: Flat, kind: str, name: str, part: Part, path: Path) -> None:
    if isinstance(part, Joint) and part.type == "parallelogram" and part.dimensions.keys() >= BARS:
        flat.expanded[name] = part
        _add_parallelogram(flat, name, part, path)
    else:
        flat.add(kind, name, part, path)


def bound(value: Any, names: Mapping[str, int | str]) -> Any:
    """A part, or a piece of one, with names in its expressions replaced."""
    match value:
        case Expression():
            return value.bind(names)
        case Part():
            fields = type(value).model_fields
            return value.model_copy(update={f: bound(getattr(value, f), names) for f in fields})
        case tuple():
            return tuple(bound(item, names) for item in value)
        case dict():
            return {key: bound(item, names) for key, item in value.items()}
    return value


def _relabelled(part: Part, leg: Leg, prefix: str) -> Part:
    """The part with names of the leg's own bodies and joints made full."""
    if isinstance(part, Joint | Constraint):
        a, b = (f"{prefix}.{body}" if body in leg.bodies else body for body in part.bodies)
        return part.model_copy(update={"bodies": (a, b)})
    if isinstance(part, Coupling):
        terms = {
            f"{prefix}.{joint}" if joint in leg.joints else joint: factor
            for joint, factor in part.terms.items()
        }
        return part.model_copy(update={"terms": terms})
    return part


def _add_parallelogram(flat: Flat, name: str, joint: Joint, path: Path) -> None:
    """Two bars, the pins of the first at both ends, that of the second at the near end.

    The pin that tells the angle has the name of the joint. The couplings keep the second bar
    parallel to the first and the far body from turning; the fourth pin would only repeat them.
    """
    (a, b), (on_a, on_b) = joint.bodies, joint.frames
    length, mass = joint.dimensions["length"], joint.dimensions["bar_mass"]
    half = Expression(f"({joint.dimensions['width']})/2")
    moment = Expression(f"({mass})*({length})**2/12")
    rod = Body(mass=mass, com=(Expression(f"({length})/2"), 0, 0), inertia=(0, moment, moment))
    far_end = Frame(point=(length, 0, 0))
    bar1, bar2 = f"{name}.bar1", f"{name}.bar2"
    pins = {
        "near1": ((a, bar1), (_aside(on_a, half), Frame()), joint.home),
        "near2": ((a, bar2), (_aside(on_a, Expression(f"-({half})")), Frame()), joint.home),
        "far1": ((bar1, b), (far_end, _aside(on_b, half)), _minus(joint.home)),
    }
    for bar in (bar1, bar2):
        flat.add("bodies", bar, rod, path)
    for pin, (bodies, frames, home) in pins.items():
        driven = pin == "near1"
        part = Joint(
            type="revolute",
            bodies=bodies,
            frames=frames,
            actuated=joint.actuated and driven,
            motor=joint.motor if driven else None,
            actuators=joint.actuators if driven else {},
            home=home,
        )
        flat.add("joints", name if pin == "near1" else f"{name}.{pin}", part, path)
    near1, near2, far1 = name, f"{name}.near2", f"{name}.far1"
    flat.add("couplings", f"{name}.bars", Coupling(terms={near2: 1, near1: -1}), path)
    flat.add("couplings", f"{name}.level", Coupling(terms={far1: 1, near1: 1}), path)


def _aside(frame: Frame, distance: Expression) -> Frame:
    """The frame moved along its own y axis, beyond any offset it has."""
    if frame.offset is None:
        offset: Any = (0.0, distance, 0.0)
    else:
        x, y, z = _three(frame.offset)
        offset = (x, Expression(f"({y})+({distance})"), z)
    return frame.model_copy(update={"offset": offset})


def _three(value: Any) -> tuple[Any, Any, Any]:
    if isinstance(value, Expression):
        x, y, z = (Expression(f"({value})[{k}]") for k in range(3))
        return x, y, z
    return value[0], value[1], value[2] if len(value) == 3 else 0.0


def _minus(home: Any) -> Any:
    if home is None:
        return None
    if isinstance(home, Expression):
        return Expression(f"-({home})")
    return tuple(-x if isinstance(x, float) else Expression(f"-({x})") for x in home)
