"""A filter's beginning in principal axes, with k1 and k2 for the inertia, from one in body axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from massprops.dynamics.inertia import (
    cholesky_changes,
    cholesky_inertia,
    principal_axes,
    ratio_derivatives,
    ratios_of_moments,
)
from massprops.dynamics.quaternion import conjugate, from_rotation_matrix, multiply
from massprops.estimators.filters.begin import WIDEST_K
from massprops.estimators.filters.setup import Setup
from massprops.geometry.vectors import skew


def in_principal_axes(
    setup: Setup, principal: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] = principal_axes
) -> Setup:
    """The same beginning with rates, attitude and features in the principal axes of its inertia.

    They belong to the dynamics: nothing measured fixes them in the body, so what is not known of them turns attitude, rates
    and features alike.

    Args:
        principal: moments and axes of an inertia, in the order and with the signs that the filter's axes shall have.
    """
    body = setup.state
    moments, frame = principal(cholesky_inertia(body.k))
    by_k, by_turn = ratio_derivatives(moments, frame, cholesky_changes(body.k))
    free = np.sqrt(np.einsum("ai,ij,aj->a", by_turn, body.P[6:11, 6:11], by_turn)) > WIDEST_K
    by_turn[free] = 0.0
    # what sensors on the body or attitudes measure is in its axes
    axes_free = setup.sensors[0] or setup.sensors[1]
    w, features, rest = body.w @ frame, body.features @ frame, 11 if axes_free else 8
    G = np.zeros((rest + len(body.P) - 11, len(body.P)))
    G[:3, :3] = G[3:6, 3:6] = frame.T
    G[6:8, 6:11] = by_k
    G[np.arange(rest, len(G)), np.arange(11, len(body.P))] = 1.0
    lever = np.zeros((len(G), 3))
    lever[:3], lever[3:6] = skew(w), np.eye(3)
    if axes_free:
        lever[8:11] = -frame
    for i, p in enumerate(features):
        at = len(G) - 3 * (len(features) - i)
        lever[at : at + 3] = skew(p)
        G[at : at + 3, len(body.P) - len(G) + at :][:, :3] = frame.T
    G[:, 6:11] += lever @ by_turn
    P = G @ body.P @ G.T + (lever * np.where(free, WIDEST_K, 0.0) ** 2) @ lever.T
    turn = from_rotation_matrix(frame)
    state = replace(
        body,
        w=w,
        q=multiply(body.q, turn),
        k=ratios_of_moments(moments),
        features=features,
        P=P + 1e-18 * np.eye(len(P)),
        axes=conjugate(turn) if axes_free else body.axes,
        axes_free=axes_free,
    )
    return replace(setup, state=state, k_sigma=np.sqrt(np.diag(P)[6:8]))
