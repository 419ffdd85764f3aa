"""What every estimator gives, and what it may be told beforehand."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from massprops.core.displayed import Displayed, number

NORMAL_90 = 1.6449
"""Standard deviations of a 90 % interval of a normal distribution."""

Halves = tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Of each half of the record, coordinates (5,) of the inertia and their covariance (5, 5)."""


@dataclass(frozen=True)
class Prior:
    """What is believed of the target before the first measurement; every field may be None.

    Attributes:
        inertia: (3, 3) in body axes, any scale, tensor signs; k_sigma: 1-sigma of k1 and k2.
        axes_sigma: 1-sigma of the principal axes [rad], for small turns about each of them (3,).
        features: (m, 3) feature points from the centre of mass, body axes [m]; feature_ids (m,); feature_sigma [m].
        attitude: whether these axes are the start's body axes; if not, the ratios count and the axes do not.
        process_noise: recommended 1-sigma of angular acceleration [rad/s^2 per sqrt(s)].
    """

    inertia: np.ndarray | None = None
    k_sigma: np.ndarray | None = None
    axes_sigma: np.ndarray | None = None
    features: np.ndarray | None = None
    feature_ids: np.ndarray | None = None
    feature_sigma: float | None = None
    process_noise: float | None = None
    attitude: bool = False


@dataclass(frozen=True, repr=False)
class Estimate(Displayed):
    """Motion and inertia ratios from one estimator; n epochs, m features.

    Attributes:
        name: the estimator's.
        converged: it came to rest near an answer that explains the data.
        observable: the motion shows both ratios; when False `k1`, `k2` and the axes are None and `reason` says why.
        reason: one line when not converged or not observable.
        k1, k2: ln(I1/I2), ln(I2/I3) of I1 <= I2 <= I3; k_covariance (2, 2).
        inertia: (3, 3) in body axes, trace 1.
        principal_axes: (3, 3) columns in body axes; axes_covariance (3, 3) of a small turn about body axes [rad^2].
        times: (n,) [s]; q: (n, 4) body to cam0; w: (n, 3) body rates [rad/s]; position, velocity: (n, 3) of the centre
            of mass in cam0 [m, m/s], or None. sigma_*: (n, 3) 1-sigma of each.
        k_history, k_sigma_history: (n, 2), or None for batch methods.
        features: (m, 3) from the centre of mass in body axes [m]; feature_ids: (m,).
        body_frame: `attitude0` when the body axes are the sequence's, `own` when they are the estimator's.
        innovation: mean squared innovation or residual in units of its stated covariance, near 1 when the noise is right.
        gated: measurements rejected as outliers; used: measurements used.
        cpu_us_per_step: CPU time per epoch [us].
        reliable: its sigmas can be believed, as `judgement` finds; because: one line when not.
        residuals: (n, c) of a batch method, signed, in units of their sigma, NaN where there are none.
        memory_counted: the covariance already counts errors that stay alike from epoch to epoch.
        halves: of a batch method, the inertia by each half of the record: coordinates (5,) along
            `momentum.DIRECTIONS` at trace 1, and their covariance (5, 5).
        of_body: by effect and name, numbers of the body that the effects of a model have (`massprops.effects.of_body`); whole_covariance:
            (2 + m, 2 + m) of k1, k2 and these m in their order.
    """

    name: str
    converged: bool
    observable: bool
    reason: str = ""
    k1: float | None = None
    k2: float | None = None
    k_covariance: np.ndarray | None = None
    inertia: np.ndarray | None = None
    principal_axes: np.ndarray | None = None
    axes_covariance: np.ndarray | None = None
    times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    q: np.ndarray | None = None
    w: np.ndarray | None = None
    position: np.ndarray | None = None
    velocity: np.ndarray | None = None
    sigma_attitude: np.ndarray | None = None
    sigma_w: np.ndarray | None = None
    sigma_position: np.ndarray | None = None
    sigma_velocity: np.ndarray | None = None
    k_history: np.ndarray | None = None
    k_sigma_history: np.ndarray | None = None
    features: np.ndarray | None = None
    feature_ids: np.ndarray | None = None
    body_frame: str = "own"
    innovation: float | None = None
    gated: int = 0
    used: int = 0
    cpu_us_per_step: float | None = None
    warnings: tuple[str, ...] = ()
    reliable: bool = False
    because: str = ""
    residuals: np.ndarray | None = None
    memory_counted: bool = False
    halves: Halves | None = None
    of_body: dict[tuple[str, str], float] = field(default_factory=dict)
    whole_covariance: np.ndarray | None = None

    @property
    def sigma_k(self) -> np.ndarray | None:
        """(2,) 1-sigma of k1 and k2."""
        return None if self.k_covariance is None else np.sqrt(np.diag(self.k_covariance))

    def ratios(self) -> dict[str, Any]:
        """k1 and k2 with their uncertainty, by the keys of a document."""
        sigma = (None, None) if self.sigma_k is None else self.sigma_k
        either = {"k1": self.k1, "k2": self.k2, "sigma_k1": sigma[0], "sigma_k2": sigma[1]}
        return {**either, "k_covariance": self.k_covariance}

    @property
    def interval(self) -> dict[str, np.ndarray]:
        """90 % intervals of `k1` and `k2`, each (2,); empty where they are not observable."""
        if self.sigma_k is None or self.k1 is None or self.k2 is None:
            return {}
        reach = NORMAL_90 * self.sigma_k
        return {
            name: np.array([k - r, k + r]) for name, k, r in zip(("k1", "k2"), (self.k1, self.k2), reach, strict=True)
        }

    def facts(self) -> dict[str, str]:
        """Name, ratios, and what is wrong with them."""
        bounds = self.interval
        shown = {"method": self.name}
        shown |= {name: number(getattr(self, name), bounds.get(name)) for name in ("k1", "k2")}
        return shown | ({"but": self.reason} if self.reason else {})
