"""The parts of a mechanism as immutable, validated data.

The same classes are what a person writes in YAML (see ``docs/description.md``) and in Python.
Numbers may be expressions of the mechanism's parameters everywhere. SI units and radians.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    StringConstraints,
    WithJsonSchema,
)

from gough.actuators import LAWS
from gough.description.scalars import Array, Position, Scalar, Vector
from gough.errors import closest
from gough.joints import TYPES
from gough.joints.constraints import CONSTRAINTS
from gough.joints.free import POSE, ROTATIONS

Name = Annotated[
    str,
    StringConstraints(
        pattern=r"^[A-Za-z][A-Za-z0-9_-]*(\.[A-Za-z][A-Za-z0-9_-]*)*$", max_length=80
    ),
]
ParameterName = Annotated[
    str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=80)
]
Axis = Literal["x", "y", "z"]


def _read_moves(value: Any) -> tuple[str, ...]:
    """The free coordinates of a link; an empty tuple stands for all."""
    if value == "all" or value == ():
        return ()
    if not isinstance(value, list | tuple) or not value or any(m not in POSE for m in value):
        raise ValueError(f"expected all, or a list of {', '.join(POSE)}; got {value!r}")
    turns = len(set(value) & set(ROTATIONS))
    if len(set(value)) < len(value) or turns == 2:
        raise ValueError(f"expected no rotation, one, or all three, none twice; got {value!r}")
    return tuple(move for move in POSE if move in value)


Moves = Annotated[
    tuple[str, ...],
    PlainValidator(_read_moves),
    PlainSerializer(lambda moves: list(moves) or "all"),
    WithJsonSchema({"anyOf": [{"const": "all"}, {"type": "array", "items": {"enum": list(POSE)}}]}),
]


def _known_type(kind: str, known: tuple[str, ...]) -> Any:
    def check(value: Any) -> Any:
        if not isinstance(value, str) or value not in known:
            raise ValueError(f"{value!r} is not a {kind}.{closest(str(value), known)}")
        return value

    return Annotated[
        str,
        BeforeValidator(check),
        Field(json_schema_extra={"enum": list(known)}),
    ]


JointTypeName = _known_type("joint type", tuple(TYPES))
ConstraintTypeName = _known_type("constraint", tuple(CONSTRAINTS))
LawName = _known_type("law", tuple(LAWS))


class Part(BaseModel):
    """Immutable data; unknown names are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class Parameter(Part):
    """A named number, or nested list of numbers, that expressions may use."""

    value: Array
    live: bool = False
    """Whether it stays an input of every model, and so can change without a new one."""
    unit: str = ""
    about: str = ""


def _read_parameter(value: Any) -> Any:
    """A bare number or list stands for a parameter that is not live."""
    return value if isinstance(value, dict | Parameter) else {"value": value}


Parameters = dict[ParameterName, Annotated[Parameter, BeforeValidator(_read_parameter)]]


class Frame(Part):
    """A frame on a body: where a joint or a constraint takes hold.

    Its orientation is given by ``axis`` (the z axis, a unit vector in body axes) with ``across``
    (a vector that gives the direction of x), or by ``rotate`` (rotations about the frame's own
    axes, one after the other). Without ``across``, x is the body's z axis made normal to
    ``axis``, or the body's x axis where ``axis`` is within some 45 degrees of z.
    """

    point: Vector = (0.0, 0.0, 0.0)
    """Origin in body axes, m; two numbers mean z = 0."""
    axis: Vector | None = None
    across: Vector | None = None
    rotate: tuple[tuple[Axis, Scalar], ...] = ()
    offset: Vector | None = None
    """Further displacement of the origin, along the frame's own axes, m."""


class Body(Part):
    """A rigid body; its frame is where its joints say."""

    mass: Scalar = 0.0
    """kg"""
    com: Vector = (0.0, 0.0, 0.0)
    """Centre of mass in body axes, m."""
    inertia: Vector = (0.0, 0.0, 0.0)
    """At the centre of mass in body axes, kg m²: xx, yy, zz, or these and xy, xz, yz as entries
    of the matrix."""
    rotation: Literal["exact", "truncated", "as_printed"] = "exact"
    """The energy of rotation of a free link that turns freely about its centre of mass, which is
    its origin. exact: that of a rigid body. truncated: its terms up to third order in the rotation
    vector and its rates. as_printed: the same with twice the third order, for comparison with a
    paper that has it so."""
    free: Moves | None = None
    """The coordinates of a free link, a body placed by its own variables and not through a joint.

    ``all`` stands for x, y, z, rx, ry, rz, in planar motion for x, y, rz. The platform of a
    mechanism is a free link without saying so.
    """
    home: Frame | None = None
    """Approximate pose of a free link at the start, in base axes."""


class Motor(Part):
    """What drives an actuated joint of one freedom, through a gear, a screw, a reel or directly."""

    inertia: Scalar = 0.0
    """Of the rotor, and what turns with it before the gear, about its axis, kg m²."""
    ratio: Scalar = 1.0
    """Turns of the rotor for one turn of the joint; for a slide rad of the rotor for one metre:
    1/radius of a reel or pinion, 2 pi/lead of a screw. A negative one turns it the other way."""
    effort: Scalar | None = None
    """Largest effort at the joint, either way, N m or N."""
    speed: Scalar | None = None
    """Largest rate of the joint, either way, rad/s or m/s."""


class Actuator(Part):
    """A law of force on one freedom of a joint: a spring, friction, a stop, a drive, a reel.

    It sees the position of the freedom less ``reference``, and the rate.
    """

    law: LawName  # type: ignore[valid-type]
    reference: Scalar = 0.0
    """Position of the joint that counts as 0, m or rad."""
    freedom: Annotated[int, Field(ge=1, le=1000, strict=True)] = 1
    """Which freedom of the joint, counted from 1."""
    numbers: dict[str, Array] = Field(default_factory=dict)
    """The numbers of the law by name; some laws take lists."""


class Joint(Part):
    """A joint between two bodies, with a frame on either."""

    type: JointTypeName  # type: ignore[valid-type]
    bodies: tuple[str, str]
    frames: tuple[Frame, Frame] = (Frame(), Frame())
    actuated: bool = False
    motor: Motor | None = None
    """What drives an actuated joint; the joint feels ratio² · inertia."""
    dimensions: dict[str, Scalar] = Field(default_factory=dict)
    """The numbers a type needs besides its frames: ``pitch`` of a helical joint, m a turn."""
    actuators: dict[Name, Actuator] = Field(default_factory=dict)
    """Laws of force on its freedoms. A joint that has any is never cut."""
    home: Position | None = None
    """Approximate position at the start, rad and m."""


class Constraint(Part):
    """Frames of two bodies tied to each other where no joint is."""

    type: ConstraintTypeName  # type: ignore[valid-type]
    bodies: tuple[str, str]
    frames: tuple[Frame, Frame] = (Frame(), Frame())


class Coupling(Part):
    """A linear relation between joints of one freedom: sum of factor × position = offset."""

    terms: dict[str, Scalar] = Field(min_length=1)
    offset: Scalar = 0.0


class Leg(Part):
    """Parts that belong together, written once and repeated.

    Parts get the leg's name in front, ``leg.pin``; with ``repeat`` the leg's number too,
    ``leg1.pin`` … , and expressions may use the index ``i`` = 0, 1, … Names of bodies, joints and
    parameters are looked up in the leg first.
    """

    repeat: Annotated[int, Field(ge=1, le=1000, strict=True)] | None = None
    parameters: Parameters = Field(default_factory=dict)
    bodies: dict[Name, Body] = Field(default_factory=dict)
    joints: dict[Name, Joint] = Field(default_factory=dict)
    constraints: dict[Name, Constraint] = Field(default_factory=dict)
    couplings: dict[Name, Coupling] = Field(default_factory=dict)


class Variant(Part):
    """Changes that make another robot of a description, under a name."""

    about: str = ""
    changes: dict[str, Any] = Field(default_factory=dict)
    """Merged into the description: mappings merge, null removes an entry, other values replace."""
