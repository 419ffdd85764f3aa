"""What a record leaves open of the moment of inertia about the axis of a wheel of any history.

I + c a a^T with the momentum h - c a.w moves as I with h does, both in one scale: only how evenly the wheel is driven tells c. Along
this line the likelihood is curved, often flat, and may have several ends, so the covariance at one of them says too little. The
posterior is therefore taken at many c, each linearised about its own inertia, and summed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.diagnosis.hypothesis_fit import HypothesisFit, Linearised, along_wheel_axis
from massprops.errors import NotPossible

FIRST, GROWS = 0.3, 1.25
"""First step of the moment over its 1-sigma at the fit, and by how much each is longer than the one before: where that sigma is one
end's, others lie far beyond it."""
WIDEST = 0.15
"""Longest step, over the mean moment."""
MOST = 14
"""Steps to either side."""
FALL = 5.0
"""Of the log density at which a side ends: what lies beyond has less than a hundredth of the weight."""


@dataclass(frozen=True)
class _Side:
    """Moments added (k,), each further than the one before, and what is known there."""

    added: list[float]
    found: list[Linearised]


def with_open_moment(fit: HypothesisFit) -> HypothesisFit:
    """The fit of a wheel of any history with sigmas that hold whatever the moment about its axis may be: mean squares about the fit's
    own values, over the posterior of that moment. The fit itself where its neighbours cannot be told."""
    if fit.axis is None or fit.history is None or fit.history_sd is None:
        return fit
    try:
        here = along_wheel_axis(fit, 0.0)
    except NotPossible:
        return fit
    down, up = _side(fit, here, -1.0), _side(fit, here, 1.0)
    added = np.array([*down.added[::-1], 0.0, *up.added])
    found = [*down.found[::-1], here, *up.found]
    if len(found) < 2:
        return fit
    density = np.array([f.density for f in found])
    weight = np.gradient(added) * np.exp(density - density.max())
    weight /= weight.sum()
    spread = sum(w * (f.history_sd**2 + (f.history - fit.history) ** 2) for w, f in zip(weight, found, strict=True))
    covariance = {
        name: np.sum([w * (f.covariance[name] + _square(f.values[name] - own)) for w, f in zip(weight, found, strict=True)], axis=0)
        for name, own in fit.values.items()
    }  # fmt: skip
    return replace(fit, history_sd=np.sqrt(spread), covariance=covariance)


def _square(x: np.ndarray) -> np.ndarray:
    return np.outer(x, x)


def _side(fit: HypothesisFit, here: Linearised, sign: float) -> _Side:
    """Moments to one side of the fit's, until the density has fallen or no body has them."""
    out, step, at, highest = _Side([], []), min(FIRST * here.moment_sd, WIDEST), 0.0, here.density
    for _ in range(MOST):
        at += sign * step
        step = min(GROWS * step, WIDEST)
        try:
            own = along_wheel_axis(fit, at)
        except NotPossible:
            break
        out.added.append(at)
        out.found.append(own)
        highest = max(highest, own.density)
        if own.density < highest - FALL:
            break
    return out
