"""Whether a motion has shown the inertia ratios: a test on the information, never on a guess of what is enough."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.estimators.momentum import Momentum, ratio_covariance

SIGNIFICANT = 3.0
"""Sigma that a difference needs to count."""
SPREAD_OF_K = np.array([0.63, 0.16])
"""Standard deviations of k1 and k2 over all physically possible bodies, Sigma's eigenvalues drawn evenly from the
triangle that they may lie in. A sigma of k as large says that nothing was learnt."""
LEAST_GAIN = 2.0
"""By what factor the data must narrow that spread."""


@dataclass(frozen=True)
class Judgement:
    """Attributes:
    observable: both ratios and the axes are shown. reason: one line when not.
    k_covariance: (2, 2); axes_covariance: (3, 3) of a small turn about body axes [rad^2].
    """

    observable: bool
    reason: str
    k_covariance: np.ndarray
    axes_covariance: np.ndarray


def judge(momentum: Momentum) -> Judgement:
    """Three questions, in order.

    Do the rates change direction in the body by more than their noise does? (The information without the noise's
    share, against how much that share scatters.) Do the ratios follow from it closely enough to have learnt
    something? Are the three moments told apart, without which there are no principal axes?
    """
    moments = np.linalg.eigvalsh(momentum.inertia)
    k_covariance, axes_covariance, gaps = ratio_covariance(momentum.inertia, momentum.covariance)
    sigma = np.sqrt(np.maximum(np.diag(k_covariance), 0.0))

    def say(observable: bool, reason: str = "") -> Judgement:
        return Judgement(observable, reason, k_covariance, axes_covariance)

    count = max(int(momentum.used.sum()) / max(momentum.correlation, 1), 1.0)
    strength = float(_relative(momentum.information, momentum.noise_share).min())
    if strength < SIGNIFICANT * np.sqrt(2.0 / count):
        return say(
            False,
            "the body turns about an axis that hardly moves in it: the rates change direction by no more than "
            "their noise",
        )
    if not (sigma < SPREAD_OF_K / LEAST_GAIN).all():
        return say(
            False,
            f"the motion shows the ratios too faintly: sigma of k1, k2 {sigma[0]:.2g}, {sigma[1]:.2g}, "
            f"where all possible bodies spread by {SPREAD_OF_K[0]}, {SPREAD_OF_K[1]}",
        )
    apart = np.diff(moments)
    if not (apart > SIGNIFICANT * gaps).all():
        which = "smaller" if apart[0] / max(gaps[0], 1e-300) < apart[1] / max(gaps[1], 1e-300) else "larger"
        return say(
            False,
            f"the two {which} principal moments are equal within the noise: a symmetric body has no principal axes "
            "to find there",
        )
    return say(True)


def _relative(information: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Eigenvalues of the information in units of the noise's share."""
    values, vectors = np.linalg.eigh(share)
    half = vectors / np.sqrt(np.maximum(values, 1e-12 * max(float(values.max()), 1e-300)))
    return np.asarray(np.linalg.eigvalsh(half.T @ information @ half))
