"""Lines of `residual.csv` that are alike whichever way a diagnosis went."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

HEAD = "#timestamp [ns],channel,camera,feature,component,before [sigma],after [sigma]"


def torque_rows(stamps: Iterable[int], torque: np.ndarray, sigma: np.ndarray) -> list[str]:
    """Lines of a torque (k, 3) that names nothing and of its 1-sigma (k, 3), body axes over the mean moment [rad/s^2], at timestamps (k,)
    [ns]."""
    times = list(stamps)
    return [
        f"{t},{what} [rad s^-2],,,{name},{value:.6g},"
        for what, series in (("torque", torque), ("torque sigma", sigma))
        for t, row in zip(times, series, strict=True)
        for name, value in zip("xyz", row, strict=True)
    ]
