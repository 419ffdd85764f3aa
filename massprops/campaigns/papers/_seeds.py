"""What the runs of a paper share: a row for each seed, a stereo pair, columns, percentiles for people."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from massprops.errors import MasspropsError
from massprops.sensing.pinhole import Pinhole
from massprops.sequence.data import Environment, Orbit

Row = dict[str, Any]
MU = 3.986004418e14
"""Of the Earth [m^3/s^2]."""


def each_seed(run: Callable[[int], Row], seeds: Sequence[int]) -> list[Row]:
    """One row per seed; that of a run that failed says why in `error`."""
    rows = []
    for seed in seeds:
        try:
            rows.append({"seed": seed, **run(seed)})
        except (MasspropsError, np.linalg.LinAlgError, FloatingPointError, ValueError) as error:
            rows.append({"seed": seed, "error": f"{type(error).__name__}: {error}"})
    return rows


def stereo_pair(focal: float, baseline: float, R: np.ndarray | None = None) -> tuple[Pinhole, Pinhole]:
    """Two cameras of this focal length [px or rad], the second `baseline` [m] along x; R (3, 3): as of `Pinhole`."""
    lens, R = np.array([focal, focal, 0.0, 0.0]), np.eye(3) if R is None else R
    return Pinhole(lens, R, np.zeros(3)), Pinhole(lens, R, np.array([baseline, 0.0, 0.0]))


def on_circular_orbit(radius: float) -> Environment:
    """A chaser on a circular orbit about the Earth of this radius [m], its cameras' axes inertial."""
    return Environment("inertial", Orbit(MU, radius, 0.0, 0.0))


def column(rows: Sequence[Row], name: str) -> np.ndarray:
    """(n,) a column of rows, NaN where a row lacks it."""
    return np.array([row.get(name, np.nan) for row in rows], float)


def percentiles(values: Any, which: Sequence[float] = (50, 90, 100)) -> list[str]:
    """Percentiles of (n,) numbers with three digits."""
    return [f"{np.percentile(values, p):.3g}" for p in which]
