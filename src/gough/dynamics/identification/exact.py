"""Changes of bodies' inertia without effect that joints allow exactly, whatever the motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gough.dynamics.identification.parameters import INERTIAL
from gough.dynamics.identification.regressor import Regressor, on_node
from gough.symbolic.trees.transfers import NUMBERS, Transfers, as_vector

Array = NDArray[np.float64]

SAME = 1e-10
"""Singular values below this part of the largest count as zero, in scaled parameters."""


def exact_changes(regressor: Regressor) -> Array | None:
    """Changes of inertial parameters that transfers between joints make, (inertial, changes).

    Nodes between the joints of a leg that carry no body can carry no inertia of a body either, so
    transfers count that together leave them empty. None where frames hang on live parameters.
    """
    transfers = Transfers(regressor.model.tree)
    placed = _placed(regressor, transfers)
    if placed is None:
        return None
    count = placed.shape[1]
    scale = regressor.parameters.scale[:count]
    own = placed * scale
    joint = np.hstack([own, -transfers.basis]) if transfers.basis.size else own
    size = np.linalg.norm(joint, axis=0)
    size[size == 0] = 1.0
    size[:count] = 1.0
    _, s, Vt = np.linalg.svd(joint / size)
    null = Vt[int(np.sum(s > SAME * s[0])) :, :count]
    if not null.size:
        return np.zeros((count, 0))
    U, s, _ = np.linalg.svd(null.T, full_matrices=False)
    return np.asarray(scale[:, None] * U[:, s > SAME])


def _placed(regressor: Regressor, transfers: Transfers) -> Array | None:
    """Numbers of nodes of those of bodies, (10 nodes, inertial parameters)."""
    place = {node.index: NUMBERS * k for k, node in enumerate(transfers.nodes)}
    found = np.zeros((NUMBERS * len(place), regressor.parameters.inertial))
    for n, body in enumerate(regressor.parameters.bodies):
        node, *_ = regressor.model.tree.of_body[body]
        if node.index not in place:
            continue
        start = place[node.index]
        for k, unit in enumerate(np.eye(len(INERTIAL)).tolist()):
            try:
                ten = as_vector(on_node(unit, *node.bodies[body]))
            except TypeError:  # hangs on live parameters
                return None
            found[start : start + NUMBERS, n * len(INERTIAL) + k] = ten
    return found
