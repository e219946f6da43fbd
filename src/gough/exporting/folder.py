"""The files of an exported robot."""

from __future__ import annotations

from gough.dynamics.dynamics import Dynamics
from gough.exporting.models import c_name, exported_models
from gough.exporting.readme import readme
from gough.exporting.records import recorded
from gough.exporting.trials import trial


def files(language: str, dynamics: Dynamics) -> dict[str, str]:
    """Sources of every model, a program that tests them, and a README, as texts by file name.

    Args:
        language: one of `gough.kernels.languages.LANGUAGES`.
        dynamics: the robot's.

    Raises:
        UnknownName: there is no such language.
        ClosureError: the loops do not close.
    """
    robot = dynamics.structure.mechanism.name
    prefix, models = c_name(robot), exported_models(dynamics)
    texts: dict[str, str] = {}
    for model in models:
        name, about = f"{prefix}_{model.name}", f"{robot}: {model.about}"
        texts |= model.kernel.files(language, name, about)
    test = f"test_{prefix}.{'cu' if language == 'cuda' else 'c'}"
    texts[test] = trial(language, robot, models, recorded(dynamics, models))
    texts["README.md"] = readme(language, dynamics, models)
    return texts
