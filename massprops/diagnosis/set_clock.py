"""Whether the clock of a record of rates was set in it, by the motion itself.

A line on either side of a gap tells where a slow body should be (`sensing.time_jumps`). One that turns by a tenth of a radian
from sample to sample bends too much for that. It is followed instead, by a rigid body with an unknown torque: with the times as they
stand, and with the gap closed to one usual step. The clock was set where the latter is likelier by far and leaves nothing beside the gap.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from massprops.core.robust import rms
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.record import record_of_rates
from massprops.diagnosis.unnamed import without_effects
from massprops.errors import NotPossible
from massprops.sensing.time_jumps import clock_was_set, gaps_in
from massprops.sequence.data import RateSeries

LIKELIER = 20.0
"""Log evidence by which the closed gap must be ahead. Odd racquets and flights: 50 and more where the clock was set, -50 and less over gaps."""
BESIDE, LEFT = 7, 1.3
"""Rows on either side of the gap, and what of them the closed one may leave over their noise: 1.16 at most in racquets whose clock was set,
1.6 to 2.2 of bodies that were kicked in a gap."""
MOST = 8
"""Gaps of a record up to which each is asked: more are a sensor that loses samples."""


def refuse_set_clock(series: RateSeries) -> None:
    """Refuses rates over whose gaps the motion goes on as over one usual step.

    Raises:
        NotPossible: naming the time and the length of the gap.
    """
    times = (series.timestamp_ns - series.timestamp_ns[0]) * 1e-9
    usual, gaps = gaps_in(times)
    if not 0 < len(gaps) <= MOST:
        return
    stated = _followed(series)
    for k in gaps if stated is not None else []:
        length = times[k + 1] - times[k]
        stamp = series.timestamp_ns.copy()
        stamp[k + 1 :] -= round((length - usual) * 1e9)
        closed = _followed(replace(series, timestamp_ns=stamp))
        if closed is None or stated is None or closed.evidence < stated.evidence + LIKELIER:
            continue
        if _left_beside(closed, times[k]) < LEFT:
            raise clock_was_set("imu0", times[k], length, usual)


def _followed(series: RateSeries) -> HypothesisFit | None:
    """A rigid body with an unknown torque; None where none comes near."""
    with suppress(NotPossible):
        return without_effects(record_of_rates(series))[1]
    return None


def _left_beside(fit: HypothesisFit, at: float) -> float:
    """What rows about a time [s] leave, over their noise."""
    k = int(np.searchsorted(fit.record.times, at))
    return rms(fit.residual[max(0, k - BESIDE) : k + BESIDE])
