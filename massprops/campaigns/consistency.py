"""Whether a filter's covariance is consistent with its errors: the mean NEES of many runs and its 95 % band, in one line."""

from __future__ import annotations

import numpy as np


def consistency(name: str, nees: np.ndarray, size: int) -> str:
    """A line with the filter's (or the state's) name, the mean NEES over its size, the band and the verdict.

    Args:
        nees: (runs,) e^T P^-1 e of independent runs at one epoch, or its average over epochs of a run (its band is
            narrower than the one printed); size: components of e. The sum over the runs is chi-squared with runs x size
            degrees of freedom when the covariance is right (Bar-Shalom, Li and Kirubarajan 2001, ch. 5.4).
    """
    from scipy.special import gammaincinv  # scipy.stats takes a second to load

    nees = np.asarray(nees, float)
    nees = nees[np.isfinite(nees)]
    if not len(nees):
        return f"NEES of {name}: no run"
    total = len(nees) * size
    low, high = 2.0 * gammaincinv(total / 2.0, [0.025, 0.975]) / total
    ratio = float(np.mean(nees)) / size
    verdict = "inside"
    if not low <= ratio <= high:
        small = ratio > high
        factor = np.sqrt(ratio if small else 1 / max(ratio, 1e-12))
        verdict = f"OUTSIDE, sigmas too {'small' if small else 'large'} by {factor:.3g}"
    return (
        f"NEES of {name} ({size} components): {ratio:.3g} of its expectation, median {np.median(nees) / size:.3g}, "
        f"{verdict} (95 % band {low:.3g} to {high:.3g}, {len(nees)} runs)"
    )
