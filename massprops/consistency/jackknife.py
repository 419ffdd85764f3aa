"""How much the poses depend on single regions of the surface: the delete-a-group jackknife.

Residuals say how well a pose fits its features, not whether the features keep to the body. A highlight, a shadow's edge
or a mirrored sky moves with the light, and every feature on that side with it, in frame after frame: errors that are
alike, which no residual shows. But two sides rarely slide alike. So the surface is cut into regions, each is left out in
turn, and whatever follows from the poses is computed anew: its spread is the error that regions do not share (Quenouille
1956; Miller 1974, "The jackknife: a review").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from massprops.sfm.points import SparsePoints, residuals
from massprops.sfm.surface_regions import regions
from massprops.views import Views

FEWEST_FEATURES = 8
"""Features that must be left to an image; with fewer it keeps its pose."""
LOSS = 3.0
"""Scale of the Cauchy loss, in medians of the residuals' length."""


@dataclass(frozen=True)
class Replicate:
    """Poses without one region: R (n, 3, 3), t (n, 3), as in `Views`."""

    R: np.ndarray
    t: np.ndarray


def replicates(views: Views, points: SparsePoints) -> Iterator[Replicate]:
    """The poses without each region in turn, to first order about the given ones.

    Args:
        views: n images; points: their sparse points with observations.
    """
    n = len(views)
    label = regions(points.xyz, np.bincount(points.obs_point, minlength=len(points.xyz)))
    H, g = _normal_equations(views, points, label[points.obs_point])
    remaining = np.bincount(
        points.obs_view * (int(label.max()) + 1) + label[points.obs_point], minlength=H[:, :, 0, 0].size
    )
    remaining = remaining.reshape(n, -1).sum(axis=1, keepdims=True) - remaining.reshape(n, -1)
    for region in range(H.shape[1]):
        A, b = H.sum(axis=1) - H[:, region], g.sum(axis=1) - g[:, region]
        known = remaining[:, region] >= FEWEST_FEATURES
        step = np.zeros((n, 6))
        damped = (
            A + 1e-9 * np.trace(A, axis1=1, axis2=2)[:, None, None] * np.eye(6) + (~known)[:, None, None] * np.eye(6)
        )
        step[known] = np.linalg.solve(damped, -b[:, :, None])[known, :, 0]
        yield Replicate(_turned(step[:, :3], views.R), views.t + step[:, 3:])


def spread(values: np.ndarray) -> np.ndarray:
    """(p, p) the jackknife's covariance of p numbers from their values (g, p) without each of g regions."""
    apart = values - values.mean(axis=0)
    return np.asarray((len(values) - 1) / len(values) * apart.T @ apart)


def _turned(turn: np.ndarray, R: np.ndarray) -> np.ndarray:
    """(n, 3, 3) rotations R after small turns (n, 3) about the camera's axes."""
    from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix

    return np.asarray(rotation_matrix(from_rotation_vector(turn)) @ R)


def _normal_equations(views: Views, points: SparsePoints, region: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """H (n, g, 6, 6) and gradient (n, g, 6) of each image's turn and shift by the features (k,) of each region; the
    points stay, and the lens's bend is left out of the derivatives."""
    v = points.obs_view
    turned = np.einsum("kij,kj->ki", views.R[v], points.xyz[points.obs_point])
    c = turned + views.t[v]
    r = residuals(views, points)
    length = np.linalg.norm(r, axis=1)
    weight = 1.0 / (1.0 + (length / max(LOSS * float(np.median(length)), 1e-9)) ** 2)
    fu, fv = views.K[v, 0, 0] / c[:, 2], views.K[v, 1, 1] / c[:, 2]
    zero = np.zeros(len(v))
    J = np.stack(
        [np.stack([fu, zero, -fu * c[:, 0] / c[:, 2]], 1), np.stack([zero, fv, -fv * c[:, 1] / c[:, 2]], 1)], 1
    )
    # of a small turn w before the camera: w x (R X)
    J = np.concatenate([np.cross(turned[:, None, :], J), J], axis=2)
    groups = int(region.max(initial=0)) + 1
    cell = v * groups + region
    H = np.zeros((len(views) * groups, 6, 6))
    g = np.zeros((len(views) * groups, 6))
    np.add.at(H, cell, np.einsum("k,kia,kib->kab", weight, J, J))
    np.add.at(g, cell, np.einsum("k,kia,ki->ka", weight, J, r))
    return H.reshape(len(views), groups, 6, 6), g.reshape(len(views), groups, 6)
