"""Whether records of one body agree on what they share: ratios and axes of inertia and parameters of the body, one by one.

The log evidence of sharing rises with every unknown that need not be found again, so it may be high where one ratio is far apart. What
each record tells of one number, x_r with 1-sigma s_r, is therefore asked as well: sum (x_r - mean)^2 / s_r^2 about the weighted mean
has a chi-square law of n - 1 degrees of freedom if it is one number. So has the same sum over all common unknowns, by their
covariances; where it is too large, something acts that no record's sigmas hold, and all common sigmas grow by the root of the sum over its
degrees of freedom (Birge 1932).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.common_parameters import Common, Law, of_rows
from massprops.diagnosis.effect_columns import follows_measured
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.momentum_balance import INERTIA, inertia_jacobian
from massprops.dynamics.inertia import principal_axes, ratio_derivatives, ratios_of_moments

OF_INERTIA = ("k1", "k2", "axis_turn_1", "axis_turn_2", "axis_turn_3")
"""What the records share of the inertia: ratios, and turns [rad] of its axes in the body from the common ones, least moment first."""
LARGEST_TURN_SD = 0.5
"""1-sigma [rad] of such a turn from which a record does not show the axes."""


@dataclass(frozen=True, kw_only=True)
class Shared:
    """A number that the records share.

    Attributes:
        effect, name: whose and which; no effect for those of the inertia. values, sigma: (n,) as each record tells it, NaN where it does
            not; p_value: chance of values so far apart.
    """

    effect: str
    name: str
    values: np.ndarray
    sigma: np.ndarray
    p_value: float

    @property
    def differs(self) -> bool:
        """Whether the records do not tell one number."""
        return self.p_value < criteria.SIGNIFICANT

    @property
    def scatter(self) -> float:
        """1-sigma of the mean by how the records scatter."""
        told = self.values[np.isfinite(self.values)]
        return float(told.std(ddof=1) / np.sqrt(len(told)))

    @property
    def words(self) -> str:
        """Its name in words, with the effect that has it."""
        if self.effect:
            return f"{self.name} of {self.effect}"
        return self.name.replace("axis_turn_", "the turn [rad] about principal axis ")


def shared_numbers(common: Common) -> list[Shared]:
    """Ratios and axes of inertia and those of the body's parameters that enter linearly, as each record tells them near the common
    solution."""
    records = _by_one_prior(common)
    if len(records) < 2:
        return []
    moments, axes = principal_axes(common.inertia)
    slopes = np.concatenate(ratio_derivatives(moments, axes, inertia_jacobian(common.shape)))
    at = np.concatenate([ratios_of_moments(moments), np.zeros(3)])
    out = []
    for name, value, slope in zip(OF_INERTIA, at, slopes, strict=True):
        if common.turns is not None and name.startswith("axis"):
            continue  # each record's sensors have axes of their own
        values = np.array([value + slope @ (r.mean[:INERTIA] - common.shape) for r in records])
        sigma = np.sqrt([slope @ r.covariance[:INERTIA, :INERTIA] @ slope for r in records])
        told = sigma < (LARGEST_TURN_SD if name.startswith("axis") else np.inf)
        out.append(_shared("", name, values, sigma, told))
    for k, (effect, name) in enumerate(common.names):
        if effect:
            values, sigma = np.array([(r.mean[k], r.covariance[k, k] ** 0.5) for r in records]).T
            out.append(_shared(effect, name, values, sigma, np.array([_says(r, k) for r in records])))
    return [n for n in out if np.isfinite(n.values).sum() > 1]


def own_numbers(fits: list[HypothesisFit]) -> list[Shared]:
    """The body's numbers that effects which follow a measurement tell in each record by itself."""
    told: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for fit in fits:
        for term in (t for t in fit.hypothesis.terms if follows_measured(t.effect)):
            sd = np.sqrt(np.diag(fit.covariance[term.name]))
            for k, unknown in enumerate(term.unknowns):
                word, factor = term.of_body_as(unknown)
                told.setdefault((term.name, word), []).append((fit.values[term.name][k] / factor, sd[k] / factor))
    out = []
    for (effect, word), values_and_sigmas in told.items():
        values, sigma = np.array(values_and_sigmas).T
        out.append(_shared(effect, word, values, sigma, np.ones(len(values_and_sigmas), bool)))
    return out


def stretch(common: Common) -> float:
    """Factor on all common sigmas by which the records scatter as these have it; 1 where they do not scatter by more than chance."""
    records = _by_one_prior(common)
    if len(records) < 2:
        return 1.0
    assert common.law is not None
    square, free, every = 0.0, 0.0, np.zeros_like(common.law.covariance)
    for r in records:
        L = of_rows(np.linalg.inv(r.covariance), r.sd)
        away = r.mean - common.law.mean
        square += float(away @ L @ away)
        # of the unknowns only those count that a record's rows determine
        free += float(np.trace(L @ r.covariance))
        every += L
    free -= float(np.trace(every @ common.law.covariance))
    return float(np.sqrt(square / free)) if free > 0.0 and chance(free, square) < criteria.SIGNIFICANT else 1.0


def chance(free: float, square: float) -> float:
    """Of a sum of squares this large, of `free` degrees of freedom."""
    from scipy.special import chdtrc  # scipy.stats takes a second to load

    return float(chdtrc(free, square))


def _by_one_prior(common: Common) -> list[Law]:
    """What each record says if its prior is the common one: one that hardly shows an effect has found it to be nothing."""
    if common.law is None:
        return []
    out, prior = [], np.diag(common.law.sd**-2.0)
    for r in common.records:
        by = np.linalg.solve(r.covariance, r.mean)
        covariance = np.linalg.inv(of_rows(np.linalg.inv(r.covariance), r.sd) + prior)
        out.append(Law(mean=covariance @ by, covariance=covariance, sd=common.law.sd))
    return out


def _says(law: Law, k: int) -> bool:
    """Whether a record says more of an unknown than its prior."""
    return bool(law.covariance[k, k] < (1.0 - 1e-9) * law.sd[k] ** 2)


def _shared(effect: str, name: str, values: np.ndarray, sigma: np.ndarray, told: np.ndarray) -> Shared:
    weight = np.where(told, sigma, np.inf) ** -2.0
    mean = float(weight @ values / max(weight.sum(), 1e-300))
    square = float(weight @ (values - mean) ** 2)
    return Shared(
        effect=effect, name=name, values=np.where(told, values, np.nan), sigma=np.where(told, sigma, np.nan),
        p_value=chance(max(int(told.sum()) - 1, 1), square),
    )  # fmt: skip
