"""Whether a gyroscope's axis stands still while the body turns: at the end of its range, or stuck.

Neighbouring samples may be equal by chance, more often the coarser the counts. A row of equal samples that is far too long for
that, with all samples of its value left out of the count, is no measurement.
"""

from __future__ import annotations

import numpy as np

from massprops.errors import NotPossible

BY_CHANCE = 1e-9
"""Chance of so long a row of equal samples anywhere in a record, below which it is no measurement."""
FEWEST = 5
"""Equal samples in a row that are looked at."""


def check_moving(times: np.ndarray, w: np.ndarray) -> None:
    """Refuses rates (n, 3) [rad/s] at times (n,) [s] of which an axis reads the same for longer than chance has it.

    Raises:
        NotPossible: naming the axis, its value and when.
    """
    for axis, values in zip("xyz", w.T, strict=True):
        begins, ends = _longest(values)
        value, length = values[begins], ends - begins
        others = (values[1:] != value) & (values[:-1] != value)
        if length < FEWEST or np.count_nonzero(others) < FEWEST:  # an axis that never moves may be a calculated one
            continue
        equal = int(np.count_nonzero(others & (values[1:] == values[:-1])))
        share = (equal + 1.0) / (np.count_nonzero(others) + 2.0)
        if np.log(len(values)) + (length - 1) * np.log(share) < np.log(BY_CHANCE):
            where = "at the end of its range" if abs(value) == np.abs(values).max() else "stuck"
            raise NotPossible(
                f"imu0: the rate about {axis} reads {value:.6g} rad/s in {length} samples in a row from {times[begins]:.4g} s on: the "
                f"gyroscope is {where}. Cut the record there, or record with a wider range"
            )


def _longest(values: np.ndarray) -> tuple[int, int]:
    """First and one past the last of the longest row of equal values (n,)."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
    k = int(np.argmax(np.diff(edges)))
    return int(edges[k]), int(edges[k + 1])
