"""Fusion: the motion's ratios, axes and centre of mass correct the parts of the shape that the images did not show.

The mesh's replicates (`replicates`) say how volume, centre and inertia move together when the unseen
parts reach further out or less far, between the smallest body and the hull. Ten numbers describe each replicate: the
logarithm of the volume, the centre, and the logarithm of the inertia in the mesh's principal frame. The motion
measures eight combinations of them: two ratios, three axes, three of the centre. So the fused body is the mesh moved
along its own uncertainty to where the motion is explained: the best linear estimate (Kalman 1960) with the
covariance of the replicates. The size, which the motion does not show, follows by what it shares with the ratios: what
reaches further out on an unseen side moves ratios, centre and volume alike. Kept as the mesh has it, the moments of sixty
bodies are off by twice as much (docs/measurements.md).

Neither covariance is known as it stands. Well-measured meshes are off by a third of what their replicates allow, and
errors of motions, which come from images one like the next, are larger than their noise. So both are multiplied by
factors that are not known, and the estimate is averaged over them, each pair weighed by how well it explains by how much
shape and motion differ (Bayesian model averaging; the factors are variance components). The estimate believes meshes to be
as good as they were found to be, so a faint motion moves a good mesh little. The interval about it is as wide as replicates
say, for the next mesh may be worse.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from massprops.consistency.mesh_side import SHAPE_FLOOR, MeshSide
from massprops.consistency.replicates import read_replicates
from massprops.documents.scale_json import has_scale, read_scale
from massprops.dynamics.inertia import ratios_of_moments
from massprops.mass.integrals import central_inertia
from massprops.mass.intervals import OWN_LENGTH, bounds, scaled_replicates
from massprops.mass.ratio_space import chi_square, log_inertia, p_value

TO_RATIOS = np.array(
    [[1.0, -1, 0, 0, 0, 0], [0, 1, -1, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]
)
"""Five numbers of `ratio_space` from the log inertia's (L11, L22, L33, L23, L13, L12)."""


SHAPE_FACTORS = tuple(float(f) for f in 0.25 * 2 ** (0.5 * np.arange(7)))
MOTION_FACTORS = tuple(float(f) for f in 2 ** (0.5 * np.arange(4)))
"""Factors of the two sigmas that are tried."""
MOTION_PRIOR = (np.log(1.4), 0.4)
"""Mean and sigma of the logarithm of the motion's factor, before shape and motion are compared. Squared errors of attitudes
from images are about twice what their noise makes of them (docs/accuracy.md, Limits)."""
SHAPE_PRIOR, SHAPE_AS_STATED = (np.log(0.4), 0.6), (0.0, 0.6)
"""The same of the shape's factor, for the estimate and for the interval about it. Meshes of 50 bodies with truth, made from
images, had all volumes and moments within their 90 % intervals, so they are off by less than they state. Checked on 120 bodies
without images (docs/measurements.md, Shape against motion): with meshes off by 0.35 of what they state the first prior leaves
moments off by 1.30 % in the mean and the second by 1.46 (the meshes 1.56); with meshes off by all of it 2.47 and 2.56 (4.34).
Intervals by the second hold the moments of 98 % of the latter, by the first of 94 %."""
SIZE_OF_ITS_OWN = 0.5
"""Part of the size's sigma that goes with nothing the motion sees, over that sigma. Replicates are drawn from bumps of one
width, so they know better than any real surface which size goes with which centre: without it the intervals of fused moments
held the truth of 77 % of thirty bodies, with it of 97 % (`tests/crosscheck/footage_bodies.py`, seeds 0 to 14 in both
lights)."""


@dataclass(frozen=True)
class Draws:
    """The mesh and its replicates as ten numbers each.

    Attributes:
        own: (10,) log volume, centre (3) [final units], log inertia (L11, L22, L33, L23, L13, L12) at the document's
            density, in the mesh's principal frame.
        spread: (r, 10) of the replicates.
    """

    own: np.ndarray
    spread: np.ndarray


def read_draws(run: Path, mesh: MeshSide) -> Draws | None:
    """The mesh's replicates in final units, the scale drawn as the mass stage draws it; None when the run keeps none."""
    if not has_scale(run):
        return None
    scale = read_scale(run)
    replicates = read_replicates(run)
    if replicates is None:
        return None
    own_length = (scale.source or "none") in OWN_LENGTH
    rng = np.random.default_rng([scale.seed or 0, 5])
    sigma = scale.relative_sigma or 0.0
    drawn = scaled_replicates(
        replicates.rows, replicates.lengths, replicates.length, mesh.factor, sigma, own_length, rng
    )
    density = float(mesh.document["density"])
    _, centres, inertias = central_inertia(drawn, density)
    good = (drawn[:, 0] > 0) & (np.linalg.eigvalsh(inertias)[:, 0] > 0)
    if good.sum() < 50:
        return None
    inertia = np.array(mesh.document["inertia"], float)
    spread = ten_numbers(drawn[good, 0], centres[good], inertias[good], mesh.axes)
    own_numbers = ten_numbers(float(mesh.document["volume"]), mesh.centre, inertia, mesh.axes)
    return Draws(own_numbers, with_own_size(with_floor(spread, rng), own_numbers, rng))


def with_floor(spread: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Replicates (r, 10) with the `SHAPE_FLOOR` that no replicate shows."""
    bent = np.sqrt([0.5, 0.5, 0.5, 1.0, 1.0, 1.0]) * SHAPE_FLOOR
    out = spread.copy()
    out[:, 4:] += bent * rng.standard_normal((len(spread), 6))
    return out


def with_own_size(spread: np.ndarray, own: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Replicates (r, 10) with a size of their own: see `SIZE_OF_ITS_OWN`. own: (10,) of the mesh."""
    sigma = SIZE_OF_ITS_OWN * float(np.sqrt(np.mean((spread[:, 0] - own[0]) ** 2)))
    # a body scaled alike all over: inertia grows with the 5/3rd power of the volume
    alike = np.array([1.0, 0, 0, 0, 5 / 3, 5 / 3, 5 / 3, 0, 0, 0])
    return spread + sigma * np.outer(rng.standard_normal(len(spread)), alike)


def ten_numbers(volume: Any, centre: np.ndarray, inertia: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(..., 10) as in `Draws`."""
    L = log_inertia(inertia, axes)
    parts = [L[..., 0, 0], L[..., 1, 1], L[..., 2, 2], L[..., 1, 2], L[..., 0, 2], L[..., 0, 1]]
    return np.concatenate([np.log(volume)[..., None], centre, np.stack(parts, axis=-1)], axis=-1)


def inertia_from(x: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(..., 3, 3) of ten numbers (..., 10)."""
    a, b, c, f, e, d = (x[..., 4 + i] for i in range(6))
    L = np.stack([np.stack([a, d, e], -1), np.stack([d, b, f], -1), np.stack([e, f, c], -1)], -2)
    values, vectors = np.linalg.eigh(L)
    return np.einsum("ai,...ij,...j,...kj,bk->...ab", axes, vectors, np.exp(values), vectors, axes)


@dataclass(frozen=True)
class Measured:
    """What the motion says of a replicate x: y (m,) = H x, H (m, 10), with covariance R (m, m)."""

    y: np.ndarray
    H: np.ndarray
    R: np.ndarray


def measured(
    ratios_and_axes: np.ndarray,
    covariance: np.ndarray,
    centre: np.ndarray | None = None,
    centre_covariance: np.ndarray | None = None,
) -> Measured:
    """Ratios, axes and, where known, centre of mass by the motion.

    Args:
        ratios_and_axes: (5,) `log_components` of the motion's inertia in the mesh's principal frame; covariance (5, 5).
        centre: (3,) point that the body turns about, mesh axes [final units], or None; centre_covariance (3, 3).
    """
    H = np.zeros((5, 10))
    H[:, 4:] = TO_RATIOS
    y, R = ratios_and_axes, covariance
    if centre is not None and centre_covariance is not None:
        H = np.vstack([H, np.eye(10)[1:4]])
        y = np.concatenate([y, centre])
        whole = np.zeros((8, 8))
        whole[:5, :5], whole[5:, 5:] = covariance, centre_covariance
        R = whole
    return Measured(y, H, R + np.diag(np.full(len(R), 1e-18)))


def agreement(draws: Draws, motion: Measured, length: float) -> float:
    """p-value of the motion's numbers all together, given how the replicates' move together.

    A fill that is wrong somewhere moves the centre and the inertia alike; a mass that the surface does not show moves
    them as no fill does.

    Args:
        length: of the body [final units]; brings the centre to the size of the other numbers.
    """
    apart = draws.spread - draws.own
    size = np.where(np.arange(len(motion.y)) < 5, 1.0, 1.0 / length)
    spread = motion.H @ (apart.T @ apart / len(apart)) @ motion.H.T + motion.R
    return p_value(*chi_square((motion.y - motion.H @ draws.own) * size, spread * np.outer(size, size)))


@dataclass(frozen=True)
class _Linear:
    """The best linear estimate under one pair of factors. log_weight: of the pair before anything is believed of the
    shape's factor; gain: (10, m)."""

    shape: float
    motion: float
    log_weight: float
    gain: np.ndarray


def _linear(C: np.ndarray, difference: np.ndarray, motion: Measured, factors: tuple[float, float]) -> _Linear:
    """Kalman's gain, and the evidence of the pair: the normal density of the difference, and of the motion's factor."""
    shape, noise = factors
    H = motion.H
    S = shape**2 * H @ C @ H.T + noise**2 * motion.R
    L = np.linalg.cholesky(S)
    z = np.linalg.solve(L, difference)
    log_weight = -0.5 * float(z @ z) - float(np.log(np.diag(L)).sum()) + _log_prior(noise, MOTION_PRIOR)
    return _Linear(shape, noise, log_weight, np.linalg.solve(S, shape**2 * H @ C).T)


def _log_prior(factor: float, prior: tuple[float, float]) -> float:
    """Log density of a factor, but for a constant. prior: mean and sigma of its logarithm."""
    mean, sigma = prior
    return -0.5 * float((np.log(factor) - mean) / sigma) ** 2


def _weights(tried: list[_Linear], shape_prior: tuple[float, float]) -> np.ndarray:
    """(p,) probability of each pair of factors."""
    log_weight = np.array([t.log_weight + _log_prior(t.shape, shape_prior) for t in tried])
    weight = np.exp(log_weight - log_weight.max())
    return weight / weight.sum()


def averaged(draws: Draws, motion: Measured) -> tuple[np.ndarray, np.ndarray]:
    """The mesh moved to where the motion is explained, and every replicate likewise, averaged over both factors.

    Returns:
        (10,) the estimate, and (r, 10) replicates whose spread about it is what is left of the uncertainty.
    """
    apart, H = draws.spread - draws.own, motion.H
    C = apart.T @ apart / len(apart)
    difference = motion.y - H @ draws.own
    tried = [_linear(C, difference, motion, pair) for pair in product(SHAPE_FACTORS, MOTION_FACTORS)]
    moved = np.array([draws.own + t.gain @ difference for t in tried])
    estimate, weight = _weights(tried, SHAPE_PRIOR) @ moved, _weights(tried, SHAPE_AS_STATED)
    rng = np.random.default_rng(11)
    noise = rng.multivariate_normal(np.zeros(len(motion.y)), motion.R, len(apart), method="cholesky")
    # each replicate is drawn under one pair, as many under each as its weight says
    at = (np.arange(len(apart)) + 0.5) / len(apart)
    under = rng.permutation(np.minimum(np.searchsorted(np.cumsum(weight), at), len(tried) - 1))
    replicates = np.empty_like(apart)
    for k, t in enumerate(tried):
        rows = under == k
        remaining_spread = t.shape * apart[rows]
        replicates[rows] = moved[k] + remaining_spread - (remaining_spread @ H.T + t.motion * noise[rows]) @ t.gain.T
    return estimate, replicates + (estimate - weight @ moved)


def fuse(draws: Draws, mesh: MeshSide, motion: Measured) -> dict[str, Any]:
    """The fused mass properties, as in `massprops.json`, with their 90 % intervals.

    Args:
        draws: of `read_draws`. mesh: the mesh's side. motion: of `measured`.
    """
    from massprops.mass.properties import MassProperties

    x, replicates = averaged(draws, motion)
    density = float(mesh.document["density"])
    body = MassProperties.of(density, float(np.exp(x[0])), x[1:4], inertia_from(x, mesh.axes))
    volumes, inertias = np.exp(replicates[:, 0]), inertia_from(replicates, mesh.axes)
    moments = np.linalg.eigvalsh(inertias)
    k = ratios_of_moments(moments)
    interval = {
        "volume": bounds(volumes, body.volume),
        "mass": bounds(density * volumes, body.mass),
        "center_of_mass": bounds(replicates[:, 1:4], body.center_of_mass),
        "inertia": bounds(inertias, body.inertia),
        "principal_moments": bounds(moments, body.principal_moments),
        "k1": bounds(k[:, 0], body.k1),
        "k2": bounds(k[:, 1], body.k2),
    }
    return {**body.values(), "interval_90": interval}
