"""How well an adjusted free motion is known: its attitudes, and the ratios and axes of the inertia.

Seven of the motion's numbers no film shows: a turn of the body's axes together with its inertia, a shift of its origin, and the size. They
are taken out exactly. By the size of their curvature they cannot be told from what the film shows faintly, such as the first ratio of a
slender body.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Callable, Sequence

import numpy as np
import pycolmap

from massprops.core.linalg import at_least
from massprops.geometry.vectors import skew
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.free_adjustment import MOTION, MotionSystem, State, Tumble
from massprops.sfm.free_motion import BASIS, inertia_of_log
from massprops.sfm.points import SparsePoints
from massprops.sfm.precision import Precision, ShownInertia
from massprops.sfm.surface_regions import regions

UNSEEN = 7
"""Numbers of a motion that no film shows."""

FAINTEST = 1e-13
"""Curvature, in units of the diagonal, that rounding makes of none: a body that spins about one axis shows no ratio at all."""


def tumble_precision(
    model: pycolmap.Reconstruction,
    tumble: Tumble,
    clock: Callable[[str], float],
    loss_px: float,
    free_focal: bool,
    names: Sequence[str],
) -> Precision:
    """Precision of an adjusted motion and of the attitudes that it gives the images `names`, with tracks as clusters, as
    `massprops.sfm.precision` has it, and the inertia that it shows.

    Errors of a motion are alike in all images, and whoever reads attitudes takes them for independent. Stated larger by the
    square root of coordinates over the motion's numbers, they leave such a reader as uncertain of the motion as it is, in the mean over
    its numbers. The inertia has a covariance of its own, with tracks as clusters and at least that of regions of the surface, which may
    slide with the light.
    """
    views, ids = to_views(model)
    points = to_points(model, ids)
    times = np.array([clock(n) for n in names])
    system = MotionSystem(views, points, np.array([clock(n) for n in views.names]), loss_px, free_focal)
    linear = system.linear(State(tumble, 0.0, points.xyz))
    J, r = linear.columns, linear.residual
    free = unseen(tumble, J.shape[1])
    inverse = inverse_but_for(J.T @ linear.system.normal @ J, free, float(np.linalg.norm(tumble.place)))
    score = np.asarray(linear.system.scores(r, linear.weight) @ J)
    R = tumble.poses(times)[0]
    turns = system.columns(tumble, R, times)[: 6 * len(R)].reshape(len(R), 6, -1)[:, :3]
    still = _attitudes_still(R, turns, free)
    spread = score @ inverse
    attitude = np.sqrt(np.square(turns @ still @ spread.T).sum(axis=(1, 2)) / 3)
    rms = float(np.sqrt(np.mean(r**2)))
    stated, independent = np.linalg.norm(spread, axis=0), np.sqrt(np.maximum(np.diag(inverse), 0)) * rms
    focal = (float(stated[-1]), float(independent[-1])) if free_focal else (0.0, 0.0)
    numbers = {model.image(i).camera_id for i in ids}
    alike = np.sqrt(max(3 * len(R) / MOTION, 1.0))
    by_region = _by_region(score, points) @ inverse
    shown = ShownInertia(
        inertia_of_log(tumble.turning.inertia[None])[0],
        at_least(_of_inertia(spread, still), _of_inertia(by_region, still)),
    )
    by_camera = dict.fromkeys(numbers, focal[0])
    return Precision(rms, focal[0], 0.0, alike * attitude, focal[1], by_camera, shown)


def unseen(tumble: Tumble, size: int) -> np.ndarray:
    """(size, 7) ways to change the numbers of a motion, and of the lens after them, that no film shows: three turns, three shifts, the size."""
    out = np.zeros((size, UNSEEN))
    log = np.einsum("k,kij->ij", tumble.turning.inertia, BASIS)
    for i, W in enumerate(skew(np.eye(3))):
        out[:3, i] = -tumble.turning.attitude[:, i]
        out[3:6, i] = W @ tumble.turning.rate
        out[6:MOTION, i] = np.einsum("ij,kij->k", W @ log - log @ W, BASIS)
        out[MOTION : MOTION + 3, i] = W @ tumble.centre
    out[MOTION : MOTION + 3, 3:6] = np.eye(3)
    out[MOTION : MOTION + 9, 6] = np.concatenate([tumble.centre, tumble.place, tumble.speed])
    return out


def inverse_but_for(normal: np.ndarray, free: np.ndarray, distance: float) -> np.ndarray:
    """Inverse (q, q) of a normal matrix of a motion across the ways `free` (q, 7) that nothing fixes; distance: unit of its lengths."""
    unit = np.ones(len(normal))
    unit[MOTION : MOTION + 9] = distance
    across = np.linalg.svd((free / unit[:, None]).T)[2][UNSEEN:].T * unit[:, None]
    kept = across.T @ normal @ across
    size = np.diag(kept)
    scale = 1 / np.sqrt(np.where(size > 0, size, 1.0))
    inverse = np.linalg.inv(kept * scale[:, None] * scale + FAINTEST * np.eye(len(kept))) * scale[:, None] * scale
    return np.asarray(across @ (0.5 * (inverse + inverse.T)) @ across.T)


def _attitudes_still(R: np.ndarray, turns: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(q, q) takes out of changes of a motion the turn of the body's axes that all attitudes share, R (n, 3, 3); turns (n, 3, q): of the
    images in the camera. The body's axes are those of its attitudes."""
    shared = np.einsum("nba,nbq->naq", R, turns).mean(axis=0)
    about = free[:, :3]
    return np.eye(len(free)) - about @ np.linalg.solve(shared @ about, shared)


def _by_region(score: np.ndarray, points: SparsePoints) -> np.ndarray:
    """(g, q) sums of the scores (m, q) of points over regions of the surface, made larger for their number."""
    label = regions(points.xyz, np.bincount(points.obs_point, minlength=len(points.xyz)))
    out = np.zeros((int(label.max(initial=0)) + 1, score.shape[1]))
    np.add.at(out, label, score)
    return out * np.sqrt(len(out) / max(len(out) - 1, 1))


def _of_inertia(spread: np.ndarray, still: np.ndarray) -> np.ndarray:
    """(5, 5) covariance of the inertia's logarithm in `BASIS`, in the axes of the attitudes, by the errors `spread` (m, q) that clusters
    of observations add to a motion: no rounding makes it less than nothing, however faint what the film shows."""
    inertia_errors = spread @ still[6:MOTION].T
    return np.asarray(inertia_errors.T @ inertia_errors)
