"""Ensembles as a person asks for them: how many runs, of what, kept where."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gough.description import Mechanism
from gough.ensembles import Memory, Results, Store, run
from gough.errors import ConfigurationError, UnknownName
from gough.simulation.ensemble import WORDS, Ensemble, Measure
from gough.simulation.factors import every_parameter, with_live
from gough.simulation.simulate import TIMES, Request, options_of
from gough.topology import Modelling
from gough.uncertainty import Design, SaltelliDesign

if TYPE_CHECKING:
    import xarray

DESIGNS = ("latin-hypercube", "sobol", "random", "saltelli")
"""Kinds of designs; saltelli is the one for Sobol' indices, of samples · (factors + 2) runs."""


@dataclass(frozen=True)
class Many:
    """How many runs there are, and where their results go; see `Robot.simulate`."""

    samples: int
    vary: Mapping[str, Any] | str = field(default_factory=dict)
    design: str = "latin-hypercube"
    seed: int = 0
    store: str | Path | None = None
    workers: int | None = None
    scheduler: str | None = None
    progress: bool | Callable[[int, int], None] = True
    measures: Mapping[str, Measure] = field(default_factory=dict)


def ensemble_of(
    mechanism: Mechanism,
    modelling: Modelling | None,
    live: Mapping[str, Any],
    request: Request,
    many: Many,
) -> Ensemble:
    """The ensemble that a person asks for.

    Raises:
        UnknownName: a factor or the design does not exist.
        ConfigurationError: a value is wrong.
        DistributionError: a distribution can not be read.
    """
    options_of(request)
    vary = _vary(mechanism, live, many.vary)
    _check(many)
    design = _design(many, len(vary))
    times: tuple[float, ...] = ()
    if not (isinstance(request.times, int) and request.times == TIMES):
        times = tuple(_times(request.times, request.duration))
    return Ensemble(
        with_live(mechanism, list(vary)),
        modelling,
        live,
        request,
        vary,
        design,
        times,
        many.measures,
    )


def _vary(
    mechanism: Mechanism, live: Mapping[str, Any], given: Mapping[str, Any] | str
) -> Mapping[str, Any]:
    if isinstance(given, str):
        return every_parameter(mechanism, given, live)
    if not isinstance(given, Mapping):
        raise ConfigurationError(
            f"vary is {given!r}, expected a distribution for each name, or one text for all "
            "parameters"
        )
    for name in given:
        if not isinstance(name, str):
            raise ConfigurationError(f"vary has the name {name!r}, expected a text")
    return dict(given)


def _check(many: Many) -> None:
    """Refuse what is not of the form that it should have."""
    if isinstance(many.samples, bool) or not isinstance(many.samples, int | np.integer):
        raise ConfigurationError(f"samples is {many.samples!r}, expected a whole number from 1 up")
    if many.samples < 1:
        raise ConfigurationError(f"samples is {many.samples}, expected 1 or more")
    whole = isinstance(many.workers, int | np.integer) and not isinstance(many.workers, bool)
    if many.workers is not None and (not whole or many.workers < 1):
        raise ConfigurationError(f"workers is {many.workers!r}, expected a whole number from 1 up")
    if not isinstance(many.measures, Mapping) or not all(map(callable, many.measures.values())):
        raise ConfigurationError("measures has to hold a function for each name")


def _design(many: Many, factors: int) -> Design | SaltelliDesign:
    if many.design not in DESIGNS:
        raise UnknownName("design", str(many.design), DESIGNS)
    if many.design == "saltelli":
        if not factors:
            raise ConfigurationError("nothing varies: give vary={name: distribution}")
        return SaltelliDesign(int(many.samples), factors, seed=many.seed)
    kind: Any = many.design
    return Design(kind, int(many.samples), max(factors, 1), many.seed)


def _times(given: int | ArrayLike, duration: float) -> list[float]:
    from gough.simulation.simulate import times_of

    found: list[float] = times_of(given, duration).tolist()
    return found


def simulate_many(ensemble: Ensemble, many: Many, about: Mapping[str, Any]) -> xarray.Dataset:
    """All runs of an ensemble that are not in its store yet, and the dataset of all.

    Raises:
        StoreError: the store can not be made, read or written, or is of another run.
        TaskFailed: a chunk failed; chunks computed by then are kept.
        Interrupted: the user stopped it; what was done is kept.
    """
    plan = ensemble.plan
    results: Results = Memory(plan) if many.store is None else Store.open(many.store, plan)
    with results:
        run(
            ensemble,
            results,
            workers=many.workers,
            scheduler=many.scheduler,
            progress=many.progress,
        )
        found = results.dataset()
    codes = found["ending"].values
    counts = {word: int(np.sum(codes == k)) for k, word in enumerate(WORDS)}
    endings = ", ".join(f"{n} {word}" for word, n in counts.items() if n)
    return found.assign_attrs({**about, "seed": many.seed, "endings": endings})
