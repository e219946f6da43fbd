"""What a user holds: one mechanism with its models, made on demand."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough import catalogue
from gough.analysis.analysis import Analysis, analyse
from gough.analysis.elimination import VelocityMap, direct_map, inverse_map, passive_map
from gough.analysis.ranks import Linearisation, linearise
from gough.assembly import Assembler, Assembly
from gough.description import Mechanism
from gough.errors import ConfigurationError, DescriptionError, OutOfReach, Problem
from gough.formats.native import Source
from gough.models import Models
from gough.topology import Modelling, Role, Structure

if TYPE_CHECKING:
    import xarray

    from gough.dynamics.check import DynamicsCheck
    from gough.dynamics.contributions import Contributions, LegContributions
    from gough.dynamics.derivatives import Differentiated
    from gough.dynamics.dynamics import Dynamics, Wrench
    from gough.dynamics.identification.identify import Identification
    from gough.dynamics.reactions import JointForces, Reactions
    from gough.exporting import Exported
    from gough.geometry.assembly_modes import AssemblyModes
    from gough.geometry.direct import DirectGeometry
    from gough.geometry.direct_problem import DirectProblem
    from gough.geometry.inverse import InverseGeometry, InverseSolution, WorkingModes
    from gough.geometry.path_reports import Given, Track
    from gough.geometry.path_routes import Path as Path_
    from gough.geometry.rates import Kinematics
    from gough.geometry.tracking import OnSingularity, Tracker
    from gough.simulation.controllers import Sampled
    from gough.simulation.ensemble import Measure
    from gough.simulation.equations import CommandSource
    from gough.simulation.simulate import Simulator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Home:
    """The closed start configuration."""

    q: Array
    """Positions of the joints of the tree."""
    q_actuated: Array
    """Positions of the actuated joints, rad and m."""
    x: Array
    """A pose (x, y, z, then the quaternion w, x, y, z) where all six freedoms of the platform are
    operational, else the operational coordinates, rad and m; rx, ry and rz of a platform that turns
    freely are then entries of its rotation vector, while their rates are its angular velocity."""
    assembly: Assembly


@dataclass(frozen=True)
class Origin:
    """What a robot was loaded from."""

    robot: str
    """Path, or name in the catalogue."""
    parameters: dict[str, Any]
    """Values that replaced those of the description."""
    modelling: Modelling | None
    variants: tuple[str, ...] = ()
    """Variants of the description, in the order in which their changes were merged."""


class Robot:
    """One mechanism and its models.

    Args:
        mechanism: the description.
        modelling: one of the two ways to model the platform; the description's own by default.
        live: values of live parameters by name; those of the description by default.

    Attributes:
        origin: what it was loaded from, None if the mechanism was described in Python.

    Raises:
        DescriptionError: a loop has no passive joint to cut.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        modelling: Modelling | None = None,
        live: Mapping[str, Any] | None = None,
    ) -> None:
        self.mechanism = mechanism
        self.structure = Structure(mechanism, modelling)
        self._live = dict(live or {})
        self._direct_problems: dict[str, DirectProblem] = {}
        self.origin: Origin | None = None

    @property
    def name(self) -> str:
        """The mechanism's name."""
        return self.mechanism.name

    @cached_property
    def models(self) -> Models:
        """Expressions and kernels."""
        return Models(self.structure)

    @cached_property
    def assembler(self) -> Assembler:
        """What closes the loops."""
        return Assembler(self.models, self.models.parameters(self._live))

    @cached_property
    def home(self) -> Home:
        """The closed start configuration.

        Raises:
            ClosureError: the loops do not close.
        """
        assembly = self.assembler.home().require()
        q = assembly.q
        return Home(q, self._positions(q, "actuated"), self._positions(q, "operational"), assembly)

    def analyse(self, seed: int = 0) -> Analysis:
        """Mobility, redundancy and singularity at the home configuration.

        Args:
            seed: of the random configurations that generic values are taken from.

        Raises:
            ClosureError: the loops do not close.
            ConfigurationError: the seed is negative.
        """
        if seed < 0:
            raise ConfigurationError(f"the seed is {seed}; it must be 0 or more")
        return analyse(self.assembler, self.home.assembly, seed)

    # geometry

    @cached_property
    def _inverse(self) -> InverseGeometry:
        from gough.geometry.inverse import InverseGeometry

        return InverseGeometry(self.models, self.assembler, self.home.q)

    def reach(self, x: ArrayLike, near: ArrayLike | None = None) -> InverseSolution:
        """Configurations for operational coordinates, and which of them are reached.

        Args:
            x: operational coordinates, (*batch, n): a pose (x, y, z, then the quaternion w, x, y,
                z) where all six freedoms of the platform are operational, rad and m.
            near: a configuration whose working mode is kept, (positions,) or (*batch,
                positions); home by default.

        Raises:
            ConfigurationError: an argument has the wrong shape, or there are no operational
                coordinates.
        """
        return self._inverse.solve(x, near)

    def inverse_geometry(self, x: ArrayLike, near: ArrayLike | None = None) -> Array:
        """Positions of all joints for operational coordinates, (*batch, positions).

        As `reach`, for poses that all have to be reached.

        Raises:
            OutOfReach: a leg does not reach; the message says which, and how much is missing.
        """
        found = self.reach(x, near)
        missed = np.flatnonzero(~found.reached.ravel())
        if missed.size:
            reasons = [found.reasons[k] for k in missed]
            raise OutOfReach("pose", found.reached.size, missed.tolist(), reasons)
        return found.q

    def working_modes(self, x: ArrayLike, near: ArrayLike | None = None) -> WorkingModes:
        """Every configuration for one pose, one for each choice of branches of its legs.

        Raises:
            ConfigurationError: a leg has no closed form.
        """
        return self._inverse.working_modes(x, near)

    @property
    def has_closed_form(self) -> bool:
        """Whether every leg is solved in closed form, so that `working_modes` can list them."""
        return self._inverse.closed_form

    @cached_property
    def position_names(self) -> tuple[str, ...]:
        """A name for each number of a configuration q."""
        from gough.geometry.coordinates import position_names

        return position_names(self.models)

    def _direct_problem(self, motion: str = "home") -> DirectProblem:
        if not isinstance(motion, str) or motion not in self._direct_problems:
            from gough.geometry.direct_problem import DirectProblem

            self._direct_problems[motion] = DirectProblem(
                self.models, self.assembler, self.home.q, motion
            )
        return self._direct_problems[motion]

    def assembly_modes(self, q_actuated: ArrayLike, motion: str = "home") -> AssemblyModes:
        """Every solution of the direct problem, with what is known about the list.

        Args:
            q_actuated: positions of the actuated joints, (actuated,), rad and m.
            motion: "home" for modes in which a platform that only translates has the orientation
                it has at home, "any" for those in which it is turned too.

        Raises:
            ConfigurationError: the shape is wrong, the equations are no polynomials, or the
                actuated joints leave a freedom.
        """
        return self._direct_problem(motion).modes(q_actuated)

    @cached_property
    def _direct(self) -> DirectGeometry:
        from gough.geometry.direct import DirectGeometry

        return DirectGeometry(self._direct_problem(), self._inverse)

    def direct_geometry(self, q_actuated: ArrayLike, near: ArrayLike | None = None) -> Array:
        """Operational coordinates for actuated positions, on the assembly mode of others.

        Args:
            q_actuated: positions of the actuated joints, (*batch, actuated), rad and m.
            near: operational coordinates near those wanted, (*batch, n); home's by default.

        Raises:
            OutOfReach: there is no solution near, or a singularity of type 2 lies between.
            ConfigurationError: an argument has the wrong shape, entries that are not finite, or a
                quaternion that does not have length 1.
        """
        quick = self._direct.quick(q_actuated, near)
        if quick is not None:
            return quick
        from gough.geometry.direct import ENDINGS

        found = self._direct.solve(q_actuated, near)
        missed = np.flatnonzero(~found.closed.ravel())
        if missed.size:
            reasons = [ENDINGS[found.ending.ravel()[k]].value for k in missed]
            raise OutOfReach("row", found.closed.size, missed.tolist(), reasons)
        return found.x

    @cached_property
    def kinematics(self) -> Kinematics:
        """Velocity and acceleration models, conditioning, velocity factors."""
        from gough.geometry.rates import Kinematics

        return Kinematics(self.models, self.assembler, self.home.q)

    def jacobian(self, x: ArrayLike, near: ArrayLike | None = None) -> Array:
        """J with ẋ = J q̇_a at operational coordinates, (*batch, operational, actuated).

        With all six freedoms of the platform ẋ is its twist (linear, angular) in base axes.

        Raises:
            OutOfReach: a leg does not reach.
        """
        return self.kinematics.jacobian(self.inverse_geometry(x, near))

    def workspace_map(
        self,
        measures: str | Sequence[str] = ("conditioning", "velocity_factors"),
        **axes: ArrayLike,
    ) -> xarray.Dataset:
        """Measures over a grid of operational coordinates, on the working mode of home.

        Args:
            measures: one name or more from `gough.geometry.maps.MEASURES`.
            axes: for each output, by its name, the positions of the grid (n,), or one number; m and
                rad. With six freedoms rx, ry, rz are the entries of the rotation vector.

        Raises:
            UnknownName: an axis is no output, or a measure does not exist.
            ConfigurationError: an output has no axis, or an axis is no list of finite numbers.
        """
        from gough.geometry.maps import workspace_map

        def inverse(x: Array) -> tuple[Array, NDArray[np.bool_]]:
            found = self.reach(x)
            return found.q, found.reached

        return workspace_map(self.kinematics, inverse, measures, **axes)

    @cached_property
    def _tracker(self) -> Tracker:
        from gough.geometry.tracking import Tracker

        outputs = bool(self.structure.columns("operational"))
        return Tracker(self.kinematics, self._inverse if outputs else None)

    def track(
        self,
        path: Path_,
        of: Given = "outputs",
        near: ArrayLike | None = None,
        on_singularity: OnSingularity = "stop",
        samples: int = 101,
    ) -> Track:
        """Follow a path through closed configurations on one mode, each step proved.

        Args:
            path: waypoints, (m, n), joined by straight lines, or a function of s in [0, 1] that
                gives coordinates, (n,).
            of: what the path is of: "outputs", operational coordinates, or "inputs", positions of
                the actuated joints.
            near: the configuration to start from, (positions,); home by default.
            on_singularity: whether to "stop" at the first one or to "continue" where that can be.
            samples: rows of the result.

        Raises:
            ConfigurationError: an argument has the wrong shape or value.
        """
        return self._tracker.follow(path, of, near, on_singularity, samples)

    # dynamics

    @cached_property
    def dynamics(self) -> Dynamics:
        """Inverse and direct dynamics over batches, with a named ending for each row."""
        from gough.dynamics.dynamics import Dynamics

        outputs = bool(self.structure.columns("operational"))
        inverse = self._inverse if outputs else None
        return Dynamics(self.models, self.assembler, self.home.q, inverse, self.kinematics)

    @cached_property
    def _contributions(self) -> Contributions:
        from gough.dynamics.contributions import Contributions

        return Contributions(self.dynamics)

    def leg_contributions(
        self, x: ArrayLike, xd: ArrayLike, xdd: ArrayLike, gravity: ArrayLike | None = None
    ) -> LegContributions:
        """What each leg and the platform add to the robot's inertia and forces, along ẋ.

        Their sums are `mass_matrix` and the forces of `inverse_dynamics`; arguments as there.

        Raises:
            ConfigurationError: there is no platform, or an argument has the wrong shape.
            SingularError: a row is out of reach.
        """
        return self._contributions.at(x, xd, xdd, gravity)

    @cached_property
    def _joint_forces(self) -> JointForces:
        from gough.dynamics.reactions import JointForces

        return JointForces(self.dynamics)

    def reaction(
        self,
        x: ArrayLike,
        xd: ArrayLike,
        xdd: ArrayLike | None = None,
        efforts: ArrayLike | None = None,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
    ) -> Reactions:
        """The wrench that every joint passes on, and which parts of it equilibrium determines.

        Args:
            x: operational coordinates, (n,).
            xd: their rates, (outputs,).
            xdd: their accelerations; those that the efforts make by default.
            efforts: of the motors; those that the motion takes by default.
            wrench: as for `inverse_dynamics`.
            gravity: as for `inverse_dynamics`.

        Raises:
            ConfigurationError: accelerations and efforts contradict each other, or neither is
                given.
            SingularError: the pose is out of reach or singular.
        """
        return self._joint_forces.at(x, xd, xdd, efforts, "platform", wrench, gravity)

    def check_dynamics(self, states: int = 20, seed: int = 0) -> DynamicsCheck:
        """Compare the models with Lagrange's equations and with laws, at random closed states.

        Args:
            states: how many.
            seed: of the states.
        """
        from gough.dynamics.check import check_dynamics

        return check_dynamics(self.dynamics, states, seed)

    def inverse_dynamics(
        self,
        x: ArrayLike,
        xd: ArrayLike,
        xdd: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Efforts of the motors for a motion, (*batch, actuated), N and N m.

        Args:
            x: operational coordinates, (*batch, n); a pose where all six freedoms are.
            xd: their rates, (*batch, outputs); of a pose the twist (linear, angular) in base axes.
            xdd: their accelerations, (*batch, outputs).
            wrench: what the surroundings do to the platform, (force, moment about its origin) in
                base axes, (*batch, 6), or such by the names of bodies.
            gravity: in base axes, (*batch, 3), m/s²; that of the description by default.

        Raises:
            SingularError: a row is out of reach, or at a singularity or too near to one.
            ConfigurationError: an argument has the wrong shape.
        """
        if wrench is None and gravity is None:
            quick = self.dynamics.quick_inverse(x, xd, xdd)
            if quick is not None:
                return quick
        return self.dynamics.require(self.dynamics.inverse(x, xd, xdd, wrench, gravity)).efforts

    def direct_dynamics(
        self,
        x: ArrayLike,
        xd: ArrayLike,
        tau: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Accelerations of the outputs for efforts, (*batch, outputs); see `inverse_dynamics`."""
        if wrench is None and gravity is None:
            quick = self.dynamics.quick_direct(x, xd, tau)
            if quick is not None:
                return quick
        return self.dynamics.require(
            self.dynamics.direct(x, xd, tau, wrench, gravity)
        ).accelerations

    def state(self, independent: ArrayLike) -> Array:
        """The closed configuration q with given positions of the independent variables.

        Args:
            independent: positions of the joints of ``dynamics.independent()``, (independent,),
                rad and m; the other joints are those of the assembly nearest to home.

        Raises:
            ClosureError: the loops do not close with them.
            ConfigurationError: the shape is wrong, or an independent variable has no position of
                its own (a ball joint, a floating base).
        """
        return self.dynamics.state(independent)

    def mass_matrix(self, x: ArrayLike) -> Array:
        """A with A ẍ + bias = forces along ẋ, (*batch, outputs, outputs); kg, kg m, kg m².

        For joint space, and for mechanisms without outputs, see ``dynamics.mass_matrix``.
        """
        return self.dynamics.mass_matrix(x)

    def bias(
        self,
        x: ArrayLike,
        xd: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Coriolis, centrifugal and gravity forces along ẋ, (*batch, outputs), N and N m."""
        return self.dynamics.bias(x, xd, wrench, gravity)

    def gravity_load(
        self, x: ArrayLike, wrench: Wrench = None, gravity: ArrayLike | None = None
    ) -> Array:
        """Forces along ẋ that hold the robot at rest, (*batch, outputs), N and N m."""
        return self.dynamics.gravity_load(x, wrench, gravity)

    def energy(
        self, x: ArrayLike, xd: ArrayLike, gravity: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Kinetic and potential energy, J, (*batch) each; potential from the origin of the base."""
        return self.dynamics.energy(x, xd, gravity)

    def inverse_dynamics_joint(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Efforts of the motors in joint space, (*batch, actuated), N and N m.

        Args:
            q: closed configurations, (*batch, positions).
            v: rates of ``dynamics.independent()``, (*batch, independent).
            a: their accelerations, (*batch, independent).
            wrench: as for `inverse_dynamics`.
            gravity: as for `inverse_dynamics`.

        Raises:
            SingularError: a row is at a singularity, or too near to one.
            ConfigurationError: an argument has the wrong shape, or a row is not closed.
        """
        found = self.dynamics.inverse_joint(q, v, a, wrench, gravity)
        return self.dynamics.require(found).efforts

    def direct_dynamics_joint(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        wrench: Wrench = None,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Accelerations of the independent variables, (*batch, independent)."""
        found = self.dynamics.direct_joint(q, v, tau, wrench, gravity)
        return self.dynamics.require(found).accelerations

    @cached_property
    def identification(self) -> Identification:
        """Base parameters, exciting trajectories, and least squares from measured efforts."""
        from gough.dynamics.identification.identify import Identification

        return Identification(self.dynamics)

    @cached_property
    def dynamics_derivatives(self) -> Differentiated:
        """Derivatives of inverse and direct dynamics by state, input and live parameters."""
        from gough.dynamics.derivatives import Differentiated

        return Differentiated(self.dynamics)

    # programs

    # simulation

    @cached_property
    def simulator(self) -> Simulator:
        """What makes simulations."""
        from gough.simulation.simulate import Simulator

        return Simulator(self.dynamics, {"robot": self.name, **self._told})

    @property
    def _told(self) -> dict[str, str]:
        """What a dataset says of the robot it is of."""
        if self.origin is None:
            return {}
        given = {name: str(value) for name, value in self.origin.parameters.items()}
        return {"variants": ", ".join(self.origin.variants), "parameters": json.dumps(given)}

    def simulate(
        self,
        duration: float,
        x0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        *,
        q0: ArrayLike | None = None,
        inputs: Mapping[str, Any] | None = None,
        controller: CommandSource | Sampled | None = None,
        events: Mapping[str, Any] | None = None,
        gravity: ArrayLike | None = None,
        method: str = "dormand-prince",
        rtol: float = 1e-8,
        atol: float | None = None,
        times: int | ArrayLike = 201,
        max_step: float = np.inf,
        max_steps: int = 10_000_000,
        locate: bool | None = None,
        samples: int | None = None,
        vary: Mapping[str, Any] | str | None = None,
        design: str = "latin-hypercube",
        seed: int = 0,
        store: str | Path | None = None,
        workers: int | None = None,
        scheduler: str | None = None,
        progress: bool | Callable[[int, int], None] = True,
        measures: Mapping[str, Measure] | None = None,
    ) -> xarray.Dataset:
        """A motion from a start under the actuators, as a dataset over time; or many of them.

        Args:
            duration: s.
            x0: operational coordinates at the start, (n,); a pose (x, y, z, then the quaternion w,
                x, y, z) where all six freedoms of the platform are; home by default.
            v0: rates of the outputs, (outputs,): of a pose the twist (linear, angular) in base
                axes; of the independent joints of a mechanism without outputs; 0 by default.
            q0: a configuration instead of x0, (positions,).
            inputs: what actuators are told, by joint or by the name of the actuator: a number, or
                a table (times, values) joined by straight lines; N and N m.
            controller: what tells the actuators besides; see `gough.simulation.controllers`.
            events: what is looked for, by name: expressions such as "platform.z - 0.5" that change
                their sign, or `gough.When`.
            gravity: in base axes, (3,), m/s²; that of the description by default.
            method: "dormand-prince", or with scikit-sundae "adams" or "bdf".
            rtol: relative tolerance of the local error.
            atol: absolute tolerance, in the unit of each state; rtol by default.
            times: how many times the motion is seen at, evenly spaced, or which, s. Ensembles
                keep only the end by default.
            max_step: longest step, s.
            max_steps: largest number of steps.
            locate: whether steps end where the formula of a law switches, such as at the reversals
                of a hysteretic actuator; by default where rtol is below 1e-7.
            samples: how many runs an ensemble has; None for a single run.
            vary: what differs from run to run: a distribution ("±10 %", "normal(3.5, 0.1)", see
                `gough.uncertainty`) for each name of a parameter (mass, scale[2]), of the start
                (x0.z, x0.rx, v0.x) or of an input (inputs.leg1.slide). One text stands for every
                number among the parameters.
            design: "latin-hypercube", "sobol", "random", or "saltelli" for Sobol' indices, which
                has samples · (factors + 2) runs.
            seed: of the design.
            store: a folder that results go to, chunk by chunk (zarr); an interrupted ensemble goes
                on where it was. None keeps them in memory.
            workers: chunks computed at once; all cores by default.
            scheduler: address of a Dask scheduler that has the runs made.
            progress: whether a terminal shows a bar; or a function of runs done and in all.
            measures: further numbers of each run, by name: functions of the columns of some runs.

        Returns:
            Variables over ``time``: ``pose`` and ``twist`` (or ``x`` and ``xd``), ``q`` and ``v``
            of all joints, ``actuator_force``, ``actuator_position``, ``actuator_rate``,
            ``actuator_memory``, ``energy_kinetic``, ``…_potential``, ``…_stored``,
            ``…_delivered``, ``…_dissipated`` and ``energy_balance_error``; ``event_time`` over
            ``event``; ``ending``, a word whose long name says how the run ended. Times behind an
            early end are left out.

            Of an ensemble variables over ``row``: ``ending`` and ``end``, ``pose`` and ``twist``
            there, ``energy``, ``energy_balance_error``, ``first`` time of each event, ``factor``,
            ``counts`` and the measures. A run that failed is a row with the name of its ending.

        Raises:
            ConfigurationError: an argument has the wrong form or value.
            UnknownName: a joint, an actuator, a factor or a method does not exist.
            StoreError: the store can not be used, or is of another ensemble.
            SingularError: x0 is out of reach.
            MissingExtra: the method needs a package that is not installed.
        """
        from gough.simulation.many import Many, ensemble_of, simulate_many
        from gough.simulation.simulate import Request

        request = Request(
            duration,
            x0,
            v0,
            q0,
            inputs,
            controller,
            events,
            gravity,
            method,
            rtol,
            atol,
            times,
            max_step,
            max_steps,
            locate,
        )
        if samples is None:
            if vary is not None:
                raise ConfigurationError("vary takes samples: how many runs there are")
            return self.simulator.run(request)
        many = Many(
            samples,
            vary or {},
            design,
            seed,
            store,
            workers,
            scheduler,
            progress,
            measures or {},
        )
        ensemble = ensemble_of(self.mechanism, self.structure.modelling, self._live, request, many)
        return simulate_many(ensemble, many, {"robot": self.name, **self._told})

    @cached_property
    def _exported(self) -> list[Exported]:
        from gough.exporting import exported_models

        return exported_models(self.dynamics)

    def operations(self) -> dict[str, dict[str, int]]:
        """How many operations each model takes, by kind: mul, add, div, sqrt, trig, select …"""
        return {model.name: model.kernel.tape.counts() for model in self._exported}

    def export_c(self, folder: str | Path) -> list[Path]:
        """Write every model as C99 into a folder, with a test program and a README.

        Each is a function of one row and the same over many rows; README.md says what their
        numbers are. Compiled without contraction they give the bits of this library, and
        ``test_<robot>.c`` tests that at recorded states.

        Returns:
            The files written.

        Raises:
            ConfigurationError: the folder can not be written.
            ClosureError: the loops do not close.
        """
        return self._export("c", folder)

    def export_cuda(self, folder: str | Path) -> list[Path]:
        """Write every model as CUDA C into a folder, as `export_c`."""
        return self._export("cuda", folder)

    def _export(self, language: str, folder: str | Path) -> list[Path]:
        from gough.exporting import files

        texts = files(language, self.dynamics)
        return [_written(Path(folder) / name, text) for name, text in texts.items()]

    # rates at the home configuration

    @cached_property
    def rates(self) -> Linearisation:
        """M, N and K at home, lengths divided by the characteristic length."""
        return linearise(self.assembler, self.home.q)

    def inverse_velocity(self) -> VelocityMap:
        """Motor rates from output rates at home: q̇_a = J⁻¹ ẋ, (actuated, operational).

        With all six freedoms of the platform ẋ is its twist (linear, angular) in base axes.
        ``valid`` says whether every output rate is possible, ``unique`` whether it fixes the
        motors' rates. SI units and rad; rates of rx, ry, rz are angular velocities.
        """
        return self._in_si(inverse_map(self.rates), "actuated", "operational")

    def direct_velocity(self) -> VelocityMap:
        """Output rates from motor rates at home: ẋ = J q̇_a, (operational, actuated)."""
        return self._in_si(direct_map(self.rates), "operational", "actuated")

    def passive_velocity(self) -> VelocityMap:
        """Passive rates from output rates at home, (passive, operational)."""
        return self._in_si(passive_map(self.rates), "passive", "operational")

    def _in_si(self, found: VelocityMap, output: Role, input_: Role) -> VelocityMap:
        scale, columns = self.assembler.rate_scale, self.structure.columns
        return found.in_units(scale[columns(output)], scale[columns(input_)])

    def _positions(self, q: Array, role: Role) -> Array:
        """Position numbers of the freedoms with a role, in the order of the variables."""
        picked: list[float] = []
        for k in range(len(self.structure.edges)):
            roles = [v.role for v in self.structure.variables if v.edge == k]
            position = q[self.models.closure.slices[k]]
            if roles and all(r == role for r in roles):
                picked.extend(position)
            elif role in roles:
                if len(position) != len(roles):
                    position = _rotation_vector_last(position)
                picked.extend(x for x, r in zip(position, roles, strict=True) if r == role)
        return np.array(picked)


def _written(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    except OSError as error:
        raise ConfigurationError(f"{path} can not be written: {error.strerror}") from None
    return path


def _rotation_vector_last(position: Array) -> Array:
    """Translations, then the rotation vector of the trailing quaternion (w, x, y, z)."""
    w, v = position[-4], position[-3:]
    size = float(np.linalg.norm(v))
    angle = 2 * np.arctan2(size, abs(w)) * (1 if w >= 0 else -1)
    vector = v * (angle / size) if size > 0 else 2 * v
    return np.concatenate([position[:-4], vector])


def load(
    robot: str | Path,
    modelling: Modelling | None = None,
    variants: str | Sequence[str] = (),
    **parameters: Any,
) -> Robot:
    """The robot of a description file, or of a name in the catalogue.

    Args:
        robot: a path, or the name of a robot of the catalogue.
        modelling: see ``Mechanism.modelling``.
        variants: names of variants of the description; their changes are made in this order.
        parameters: values that then replace those of the description's parameters.

    Raises:
        DescriptionError: the file is missing or something in it is wrong.
        UnknownName: there is no such robot, no such variant, or no such parameter.
    """
    chosen = (variants,) if isinstance(variants, str) else tuple(variants)
    source = open_source(robot)
    mechanism = source.mechanism(parameters, chosen)
    loaded = source.varied(chosen).locating(lambda: Robot(mechanism, modelling))
    loaded.origin = Origin(str(robot), parameters, modelling, chosen)
    return loaded


def open_source(robot: str | Path) -> Source:
    """The description file of a path or of a name in the catalogue.

    Raises:
        DescriptionError: the file is missing or no YAML.
        UnknownName: there is no such robot.
    """
    path = Path(robot)
    looks_like_path = path.suffix in (".yaml", ".yml") or len(path.parts) > 1 or path.exists()
    if isinstance(robot, Path) or looks_like_path:
        return Source.open(path)
    near = path.with_suffix(".yaml")
    if str(robot) not in catalogue.names() and near.exists():
        problem = Problem(f"is no name of the catalogue; the file beside you is called {near}")
        raise DescriptionError([problem], str(robot))
    return Source(catalogue.file(str(robot)).read_bytes(), f"{robot}.yaml")
