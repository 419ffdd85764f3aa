"""Measurements of a problem as flat lists, whole or in part."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from massprops.model.problem import Problem
from massprops.sensing.predict import Seen


@dataclass(frozen=True)
class Measurements:
    """o observations of features, and the epochs at which the other sensors speak.

    Attributes:
        seen: where the observations belong; uv (o, 2) [px]; sigma (o,) [px].
        range_at, rate_at, attitude_at: epochs (k,) with such a measurement.
        may_slide: the tracks were matched in images, where some follow a highlight or a shadow and not the body.
    """

    seen: Seen
    uv: np.ndarray
    sigma: np.ndarray
    range_at: np.ndarray
    rate_at: np.ndarray
    attitude_at: np.ndarray
    may_slide: bool = field(default=False, kw_only=True)

    @property
    def count(self) -> int:
        """Scalar measurements."""
        return 2 * len(self.uv) + len(self.range_at) + 3 * len(self.rate_at) + 3 * len(self.attitude_at)


def measurements_of(
    problem: Problem,
    epochs: np.ndarray | None = None,
    observed: np.ndarray | None = None,
    channels: tuple[str, ...] = ("tracks", "range", "rates", "attitude"),
) -> Measurements:
    """The measurements of some epochs (n,) and, of the tracks, of some observations (n, c, m); all by default."""
    n = len(problem.times)
    inside = np.ones(n, bool) if epochs is None else epochs
    use = problem.seen.copy() if "tracks" in channels else np.zeros_like(problem.seen)
    use &= inside[:, None, None] if observed is None else observed
    i, c, j = np.nonzero(use)
    uv = problem.uv[i, c, j]
    heights = np.array([cam.height or 2 * cam.intrinsics[3] for cam in problem.cameras] or [1.0])
    row = uv[:, 1] / heights[c] - 0.5 if len(c) else np.zeros(0)
    sigma = problem.sigma_px[c] if len(c) else np.zeros(0)

    def at(there: np.ndarray, channel: str) -> np.ndarray:
        return np.flatnonzero(there & inside) if channel in channels else np.zeros(0, int)

    return Measurements(
        Seen(i, c, j, row),
        uv,
        sigma,
        at(np.isfinite(problem.range_m), "range"),
        at(np.isfinite(problem.rates[:, 0]), "rates"),
        at(np.isfinite(problem.attitude[:, 0]), "attitude"),
    )
