"""What a record leaves open of the moment of inertia about the axis of a wheel of any history.

I + c a a^T with the momentum h - c a.w moves as I with h does, both in one scale: only how evenly the wheel is driven tells c. Along
this line the likelihood is curved, often flat, and may have several ends, so the covariance at one of them says too little. The
posterior is therefore taken at many c, each linearised about its own inertia, and summed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.diagnosis.criteria import LEAST_SHARE
from massprops.diagnosis.hypothesis import Guess, wheel_shapes
from massprops.diagnosis.hypothesis_fit import HypothesisFit, solved_about
from massprops.diagnosis.momentum_balance import INERTIA, shape_of
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
SMALL_MOMENT = 1e-4
"""Over the mean one, by which the inertia's shape is differentiated."""


@dataclass(frozen=True, kw_only=True)
class Linearised:
    """What a record says if the moment about a wheel's axis is another than a fit's.

    Attributes:
        density: log density of that moment and the rows; moment_sd: 1-sigma of the moment by this linearisation, over the mean one.
        history, history_sd: (n,) of the wheel; values, covariance: of each effect.
    """

    density: float
    moment_sd: float
    history: np.ndarray
    history_sd: np.ndarray
    values: dict[str, np.ndarray]
    covariance: dict[str, np.ndarray]


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
    linearisations = [*down.found[::-1], here, *up.found]
    if len(linearisations) < 2:
        return fit
    density = np.array([f.density for f in linearisations])
    weight = np.gradient(added) * np.exp(density - density.max())
    weight /= weight.sum()
    spread = sum(
        w * (f.history_sd**2 + (f.history - fit.history) ** 2) for w, f in zip(weight, linearisations, strict=True)
    )
    covariance = {
        name: np.sum([w * (f.covariance[name] + _square(f.values[name] - value)) for w, f in zip(weight, linearisations, strict=True)], axis=0)
        for name, value in fit.values.items()
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
            linearised = along_wheel_axis(fit, at)
        except NotPossible:
            break
        out.added.append(at)
        out.found.append(linearised)
        highest = max(highest, linearised.density)
        if linearised.density < highest - FALL:
            break
    return out


def along_wheel_axis(fit: HypothesisFit, added: float) -> Linearised:
    """What the record says of a wheel's fit with a moment `added` about its axis, by a pass about the inertia and the history that
    then move as the fit's do; all of the inertia but that moment is marginalised.

    Raises:
        NotPossible: no body has that moment, or none comes near the record with it.
    """
    axis, history, hypothesis = fit.axis, fit.history, fit.hypothesis
    assert axis is not None and history is not None

    def with_more(more: float) -> np.ndarray:
        more_inertia = fit.inertia + more * np.outer(axis, axis)
        return np.asarray(more_inertia * (3.0 / np.trace(more_inertia)))

    inertia, scale = with_more(added), 3.0 / (3.0 + added)
    if not np.linalg.eigvalsh(1.5 * np.eye(3) - inertia)[0] > LEAST_SHARE * 3.0:
        raise NotPossible("no body has that moment about the wheel's axis")
    shape = shape_of(inertia)
    carried = scale * fit.carried
    guess = Guess(
        shape=shape, rate=fit.rate, momentum=carried, axis=axis, history=scale * (history - added * (fit.rate @ axis)),
        start=np.mean(np.einsum("nij,nj->ni", fit.record.path.R, carried), axis=0),
    )  # fmt: skip
    try:
        post = solved_about(fit.record, hypothesis, guess).posterior
    except (np.linalg.LinAlgError, FloatingPointError):
        raise NotPossible("no body comes near the record with that moment about the wheel's axis") from None
    slope = (shape_of(with_more(added + SMALL_MOMENT)) - shape) / SMALL_MOMENT
    way = slope / (slope @ slope)
    off, across_all = float(way @ (post.mean["base"][:INERTIA] - shape)), post.joint[:, :INERTIA] @ way
    variance = float(way @ across_all[:INERTIA])
    mean = post.whole - across_all * (off / variance)
    joint = post.joint - np.outer(across_all, across_all) / variance
    places = post.places
    shapes, wheel = wheel_shapes(fit.record, hypothesis.lag), places["wheel"]
    spread = np.sum((shapes @ joint[wheel, wheel]) * shapes, axis=1)
    told = {t.name: t.values(mean[places[t.name]], joint[places[t.name], places[t.name]]) for t in hypothesis.terms}
    return Linearised(
        density=float(post.evidence - 0.5 * (off**2 / variance + np.log(2.0 * np.pi * variance))),
        moment_sd=float(np.sqrt(variance)), history=shapes @ mean[wheel], history_sd=np.sqrt(np.maximum(spread, 0.0)),
        values={k: v for k, (v, _) in told.items()}, covariance={k: c for k, (_, c) in told.items()},
    )  # fmt: skip
