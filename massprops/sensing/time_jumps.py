"""Times that jump: a gap in the timestamps over which the body moved no further than from one sample to the next.

Over a real gap it moves on at its rate. Where it moved as over one usual step instead, and its rate is the same before and after, the
clock was set and the body was not.
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.quaternion import conjugate, from_rotation_vector, multiply, rotation_vector
from massprops.errors import NotPossible

LONG = 3.0
"""A gap over the usual one, from which on it is looked at."""
FEWEST = 4
"""Samples on each side of a gap from which the motion there is told."""
FARTHEST = 1.5
"""Turn over a gap [rad] beyond which the motion before it does not tell where the body is after it.

In 14 flights, 8 tossed cubes and 7 records of Basilisk, times that were set ahead by 3 to 80 samples at places drawn at random were noticed
in 1154 of 1390; in 8 racquets, which turn by a tenth of a radian between samples, in 11 of 240 (`diagnosis.set_clock` tells those). Of as many gaps none was
taken for a jump."""
OFF, NEAR = 0.5, 0.2
"""Part of what a gap of its length should move, by which the motion is off from that, and by which it may be off from one usual step."""
EXACT = 0.1
"""Part of one usual step within which a body that may have turned far must be where that step alone would have it."""
STEADY = 0.3
"""Relative change of the rate over the gap, above which something may have happened in it."""


def check_attitude_times(times: np.ndarray, q: np.ndarray) -> None:
    """Refuses attitudes (n, 4) at rising times (n,) [s] over whose gaps the clock jumps.

    Raises:
        NotPossible: naming the time and the length of the gap.
    """
    usual, gaps = gaps_in(times)
    for k in gaps:
        before, after = slice(max(0, k + 1 - FEWEST), k + 1), slice(k + 1, k + 1 + FEWEST)
        if len(times[before]) < FEWEST or len(times[after]) < FEWEST:
            continue
        w = [_rate(times[side], q[side]) for side in (before, after)]
        moved = rotation_vector(multiply(conjugate(q[k]), q[k + 1]))
        _judge("attitude0", times[k], times[k + 1], usual, w, moved)


def gaps_in(times: np.ndarray) -> tuple[float, np.ndarray]:
    """The usual step of times (n,) [s], and the indices before gaps; none in a short record."""
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(times) > 2 * FEWEST else np.inf
    return usual, np.flatnonzero(steps > LONG * usual)


def _rate(times: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(3,) mean rate over a few attitudes, body axes at the ends [rad/s]."""
    steps = rotation_vector(multiply(conjugate(q[:-1]), q[1:]))
    return np.asarray(steps.sum(axis=0) / (times[-1] - times[0]))


def check_rate_times(times: np.ndarray, w: np.ndarray) -> None:
    """Refuses body rates (n, 3) [rad/s] at rising times (n,) [s] over whose gaps the clock jumps.

    Raises:
        NotPossible: naming the time and the length of the gap.
    """
    usual, gaps = gaps_in(times)
    for k in gaps:
        gap = times[k + 1] - times[k]
        if gap * np.linalg.norm(w[k]) > FARTHEST:
            continue
        before = (times > times[k] - gap) & (times <= times[k])
        after = (times >= times[k + 1]) & (times < times[k + 1] + gap)
        if min(before.sum(), after.sum()) < FEWEST:
            continue
        (a, slope_a), (b, slope_b) = (
            _line(times[before] - times[k], w[before]),
            _line(times[after] - times[k + 1], w[after]),
        )
        _judge("imu0", times[k], times[k + 1], usual, [slope_a, slope_b], b - a, turns=False)


def _line(since: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(3,) value at 0 and (3,) slope of a line through values (n, 3)."""
    slope, value = np.polyfit(since, values, 1)
    return value, slope


def _judge(
    what: str, start: float, end: float, usual: float, speed: list[np.ndarray], moved: np.ndarray, turns: bool = True
) -> None:
    """Refuses a gap over which something moved (3,) as over one usual step; speed: (3,) before and after it."""
    gap, mean = end - start, 0.5 * (speed[0] + speed[1])
    far = gap * float(np.linalg.norm(mean))
    if far == 0.0 or np.linalg.norm(speed[1] - speed[0]) > STEADY * np.linalg.norm(mean):
        return

    def off(seconds: float) -> float:
        if not turns:
            return float(np.linalg.norm(moved - seconds * mean))
        back = multiply(conjugate(from_rotation_vector(seconds * mean)), from_rotation_vector(moved))
        return float(np.linalg.norm(rotation_vector(back)))

    if turns and far > FARTHEST:  # it may be back by chance, but seldom so exactly
        jumps = off(usual) < EXACT * usual * np.linalg.norm(mean)
    else:
        jumps = off(gap) > OFF * far and off(usual) < NEAR * far
    if jumps:
        raise clock_was_set(what, start, gap, usual)


def clock_was_set(what: str, start: float, gap: float, usual: float) -> NotPossible:
    """What is said of times that jump by a gap [s] at a time [s], over which the body moved as over a usual step [s]."""
    return NotPossible(
        f"{what}: the times jump by {gap:.4g} s at {start:.4g} s, while the body moves on as within {usual:.4g} s: the clock was set. "
        "Correct the times after that, or cut the record there"
    )
