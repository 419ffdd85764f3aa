"""Whether a gyroscope's axis stands still while the body turns: at the end of its range, or stuck.

Neighbouring samples may be equal by chance, more often the coarser the counts. A row of equal samples that is far too long for
that, with all samples of its value left out of the count, is no measurement.
"""

from __future__ import annotations

import numpy as np

from massprops.errors import NotPossible
from massprops.sensing.noisy_plateau import refuse_plateaus

BY_CHANCE = 1e-9
"""Chance of so long a row of equal samples anywhere in a record, below which it is no measurement."""
FEWEST_NOISY = 30
"""Samples from which the others' noise is told."""
COUNTS = 3.0
"""Counts of its own that an axis's noise has where it was measured: rounding alone makes 0.3 of them."""
NEXT, MOST_OFTEN, WIDE = 3, 10, 50.0
"""Numbers next to the last one, how many times as often as each of them it may be read, and counts over which an axis reaches at least:
on fewer, counts are what is read."""
FEWEST = 5
"""Equal samples in a row that are looked at."""


def check_moving(times: np.ndarray, w: np.ndarray) -> None:
    """Refuses rates (n, 3) [rad/s] at times (n,) [s] of which an axis reads the same for longer than chance has it.

    Raises:
        NotPossible: naming the axis, its value and when.
    """
    for k, (axis, values) in enumerate(zip("xyz", w.T, strict=True)):
        _refuse_dead(axis, values, np.delete(w, k, axis=1))
        _refuse_cut(axis, values)
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
    if len(w) >= FEWEST_NOISY:
        refuse_plateaus(times, w, np.array([_noise(values) for values in w.T]))


def _refuse_dead(axis: str, values: np.ndarray, others: np.ndarray) -> None:
    """Refuses an axis (n,) that reads the same number all the time while others (n, 2) have noise: a calculated one would leave them
    without, and one that reads 0 may not have been measured.

    Raises:
        NotPossible: see above.
    """
    if len(values) < FEWEST_NOISY or np.ptp(values) > 0.0 or values[0] == 0.0:
        return
    if any(_noise(other) > COUNTS * _count(other) > 0.0 for other in others.T):
        raise NotPossible(
            f"imu0: the rate about {axis} reads {values[0]:.6g} rad/s in all {len(values)} samples while the other axes have noise: the "
            "gyroscope is stuck. Check that axis"
        )


def _refuse_cut(axis: str, values: np.ndarray) -> None:
    """Refuses an axis (n,) whose largest or smallest number comes far more often than those next to it: a range that ended each time.
    Turning back, a signal reads its last count at most 2.4 times as often as the one before.

    Raises:
        NotPossible: see above.
    """
    number, often = np.unique(values, return_counts=True)
    if len(number) <= NEXT or np.ptp(values) < WIDE * _count(values):
        return
    for at, beside in ((-1, slice(-1 - NEXT, -1)), (0, slice(1, 1 + NEXT))):
        if often[at] >= MOST_OFTEN * max(1, int(often[beside].max())):
            raise NotPossible(
                f"imu0: the rate about {axis} reads {number[at]:.6g} rad/s in {often[at]} samples and never beyond: the gyroscope is at "
                "the end of its range. Cut the record there, or record with a wider range"
            )


def _count(values: np.ndarray) -> float:
    """Smallest difference between two numbers of (n,); 0 where all are alike."""
    apart = np.diff(np.unique(values))
    return float(apart.min()) if len(apart) else 0.0


def _noise(values: np.ndarray) -> float:
    """1-sigma of what changes from sample to sample (n,), from fifth differences; 0 where neighbours' do not turn against each other
    as those of noise do."""
    fifth = np.diff(values, n=5)
    square = float(np.mean(fifth**2))
    if square == 0.0 or float(np.mean(fifth[1:] * fifth[:-1])) > -0.5 * square:
        return 0.0
    return float(np.sqrt(square / 252.0))


def _longest(values: np.ndarray) -> tuple[int, int]:
    """First and one past the last of the longest row of equal values (n,)."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
    k = int(np.argmax(np.diff(edges)))
    return int(edges[k]), int(edges[k + 1])
