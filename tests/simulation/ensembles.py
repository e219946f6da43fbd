"""Ensembles of tests, single runs to compare them with, and a run that a test can kill."""

import re
import sys
import time

import numpy as np

import gough
from gough.description.values import evaluate_parameters

HEXAPOD = "deployable-hexapod"


def slow_height(columns):
    """The height of the platform, after a while."""
    time.sleep(0.1)
    return columns["pose"][:, 2]


def killable(store, slow=True):
    """An ensemble of some chunks that takes a few seconds if it is slow."""
    measure = {"height": slow_height} if slow else None
    return gough.load(HEXAPOD).simulate(
        0.05, rtol=1e-6, samples=1600, vary="±10 %", store=store, workers=1, progress=False,
        measures=measure,
    )  # fmt: skip


def listed(value):
    return [listed(item) for item in value] if isinstance(value, tuple) else float(value)


def robot_of(name, names, row):
    """The robot with the parameters of a row as constants."""
    described = evaluate_parameters(gough.load(name).mechanism.parameters)
    given = {}
    for factor, value in zip(names, row, strict=True):
        if factor.startswith(("x0.", "v0.", "inputs.")):
            continue
        base, *places = re.findall(r"\w+", factor)
        inner = given.setdefault(base, listed(described[base]))
        for place in places[:-1]:
            inner = inner[int(place)]
        if places:
            inner[int(places[-1])] = float(value)
        else:
            given[base] = float(value)
    return gough.load(name, **given)


def equal(a, b):
    """Whether all variables of two datasets have the same bits."""
    assert set(a.data_vars) == set(b.data_vars)
    return all(
        np.array_equal(a[k].values, b[k].values, equal_nan=a[k].dtype.kind == "f") for k in a
    )


if __name__ == "__main__":
    from tests.simulation import ensembles  # under the name that a store knows its measures by

    ensembles.killable(sys.argv[1])
