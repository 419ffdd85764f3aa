"""What a sequence's sensors say of themselves, before a motion is looked for: a record that is none gets one line."""

from __future__ import annotations

from massprops.sensing.free_flight import Lever, check_free_flight
from massprops.sensing.stuck_sensor import check_moving
from massprops.sensing.time_jumps import check_attitude_times, check_rate_times
from massprops.sequence.data import Sequence


def check_sensors(sequence: Sequence) -> Lever | None:
    """The lever from the centre of mass to the accelerometer, None without one.

    Raises:
        NotPossible: an axis of the gyroscope stands still or ends its range; times jump; the accelerometer says that this is no free
            flight.
    """
    first = sequence.first_ns
    if sequence.attitude is not None and len(sequence.attitude.q):
        check_attitude_times((sequence.attitude.timestamp_ns - first) * 1e-9, sequence.attitude.q)
    if sequence.rates is None or not len(sequence.rates.w):
        return None
    times = (sequence.rates.timestamp_ns - first) * 1e-9
    check_moving(times, sequence.rates.w)
    check_rate_times(times, sequence.rates.w)
    return check_free_flight(sequence)
