"""From replicates of the ten integrals to an interval on every quantity.

The surface stage gives r replicates of the body's integrals and greatest length (`massprops.surface.spread` says how
they are drawn). Here the uncertainty of the scale joins them: each replicate's lengths are multiplied by
exp(N(0, relative_sigma)), which enters volume with the third power and inertia with the fifth. When the model unit
is the body's own greatest length (no scale, or a length of the whole body that the user gave), every replicate is
divided by its own length; when the scale comes from elsewhere (baseline, range, distance, marker) by the mesh's.

An interval is the 5th to the 95th percentile of the replicates, stretched where needed to hold the estimate. Replicates
that are no bodies have collapsed: where they are more than the 5 % below, volume, mass and moments may be anything from
zero to those of the silhouettes' hull, and the ratios anything that a body may have.

Two moments that are nearly equal are driven apart by every error, as they are told by their order. So where the replicates'
tensors do not exclude that two are equal, the ratio's interval reaches to 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.dynamics.inertia import ratios_of_moments
from massprops.errors import NotPossible
from massprops.mass.integrals import central_inertia, scale_integrals
from massprops.mass.properties import MassProperties

OWN_LENGTH = ("none", "given")
"""Scale sources whose metres refer to the body's greatest length."""


def scaled_replicates(
    rows: np.ndarray,
    lengths: np.ndarray,
    length: float,
    factor: float,
    relative_sigma: float,
    own_length: bool,
    rng: np.random.Generator,
) -> np.ndarray:
    """Replicates in final units, with the scale's uncertainty in them.

    Args:
        rows: (r, 10) integrals [SfM units].
        lengths: (r,) greatest length of each replicate [SfM units].
        length: greatest length of the mesh [SfM units].
        factor: final length units per SfM unit.
        relative_sigma: 1-sigma of the scale.
        own_length: whether the scale is tied to the body's greatest length.
        rng: source of the scale's draws.

    Returns:
        (r, 10) [final units].
    """
    drawn = factor * np.exp(relative_sigma * rng.standard_normal(len(rows)))
    return scale_integrals(rows, drawn * (length / lengths) if own_length else drawn)


ROUNDING = 1e-9
"""Least 1-sigma of an element of the inertia over its trace."""
TAIL = 0.05
"""Share of the replicates beyond either end of an interval."""


def intervals(rows: np.ndarray, estimate: MassProperties, outer: np.ndarray | None = None) -> dict[str, list[Any]]:
    """`interval_90` of `massprops.json`: lowest and highest value of each quantity.

    Args:
        rows: (r, 10) replicates [final units].
        estimate: what the mesh itself gives.
        outer: (10,) integrals of what the body is within [final units], where replicates collapse.

    Raises:
        NotPossible: none of the replicates is a body.
    """
    valid = valid_bodies(rows)
    if not valid.any():
        raise NotPossible(
            "mass: the images leave everything open: with all that is uncertain about it the surface encloses no body; film the object "
            "from more sides, or lit from another one"
        )
    vague, rows = collapsed(valid), rows[valid]
    mass, centre, inertia = central_inertia(rows, estimate.density)
    moments = np.linalg.eigvalsh(inertia)
    ratios = ratios_of_moments(moments)
    middle = ratios_of_moments(estimate.principal_moments)

    def within(draws: np.ndarray, value: np.ndarray | float, most: np.ndarray | float) -> Any:
        known = np.array(bounds(draws, value))
        if vague:
            known[..., 0], known[..., 1] = 0.0, np.maximum(known[..., 1], most)
        return known.tolist()

    equal = may_be_equal(inertia, estimate.principal_axes)

    def ratio(k: int) -> Any:
        draws, value = ratios[:, k], middle[k]
        low, high = (float(min(draws.min(), value)), 0.0) if vague else bounds(draws, value)
        return [low, 0.0 if equal[k] else high]

    largest = (
        _largest(outer, estimate.density) if vague and outer is not None and outer[0] > 0 else (0.0, 0.0, np.zeros(3))
    )
    return {
        "volume": within(rows[:, 0], estimate.volume, largest[0]),
        "mass": within(mass, estimate.mass, largest[1]),
        "center_of_mass": bounds(centre, estimate.center_of_mass),
        "inertia": bounds(inertia, estimate.inertia),
        "principal_moments": within(moments, estimate.principal_moments, largest[2]),
        "k1": ratio(0),
        "k2": ratio(1),
    }


def bounds(draws: np.ndarray, value: np.ndarray | float) -> Any:
    """Ends (..., 2), in lists, of the interval of draws (r, ...), widened where it does not hold the value (...)."""
    low, high = np.quantile(draws, [TAIL, 1.0 - TAIL], axis=0)
    return np.stack([np.minimum(low, value), np.maximum(high, value)], axis=-1).tolist()


def may_be_equal(inertia: np.ndarray, axes: np.ndarray) -> tuple[bool, bool]:
    """Whether I1 and I2, and I2 and I3, may be equal by 90 %.

    Of two equal moments the tensor is round in the plane of their axes: half the difference of its two diagonal elements
    there and the element beside them are both zero, which is tested by their mean and covariance over the replicates.

    Args:
        inertia: (r, 3, 3) of replicates about their centres of mass.
        axes: (3, 3) principal axes of the estimate, as columns, of ascending moments.
    """
    from scipy.special import chdtri  # scipy.stats takes a second to load

    turned = axes.T @ (inertia / np.trace(inertia, axis1=1, axis2=2)[:, None, None]) @ axes
    out = []
    for i in (0, 1):
        apart = np.stack([0.5 * (turned[:, i, i] - turned[:, i + 1, i + 1]), turned[:, i, i + 1]], axis=1)
        middle, spread = apart.mean(axis=0), np.cov(apart.T, bias=True)
        away = middle @ np.linalg.solve(spread + ROUNDING**2 * np.eye(2), middle)
        out.append(bool(away < chdtri(2, 2.0 * TAIL)))
    return out[0], out[1]


def collapsed(valid: np.ndarray) -> bool:
    """Whether more replicates are no bodies, (r,) of `valid_bodies`, than lie below an interval."""
    return 1.0 - float(valid.mean()) > TAIL


def _largest(outer: np.ndarray, density: float) -> tuple[float, float, np.ndarray]:
    """Volume, mass and principal moments (3,) of integrals (10,)."""
    mass, _, inertia = central_inertia(outer, density)
    return float(outer[0]), float(mass), np.linalg.eigvalsh(inertia)


def valid_bodies(rows: np.ndarray) -> np.ndarray:
    """(r,) bool: replicates that a body of positive density could have.

    One that collapses, or whose moments break the triangle inequality, says nothing about the inertia.

    Args:
        rows: (r, 10) integrals.
    """
    out = rows[:, 0] > 0
    moments = np.full((len(rows), 3), np.nan)
    moments[out] = np.linalg.eigvalsh(central_inertia(rows[out], 1.0)[2])
    with np.errstate(invalid="ignore"):
        return out & (moments[:, 0] > 0) & (moments[:, 0] + moments[:, 1] >= moments[:, 2])
