"""A wheel inside the body whose rate was measured (`rotor0`), as an effect and as a model to begin with."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from massprops.effects import effects, of_record
from massprops.errors import InputError
from massprops.sequence.data import RotorSeries

MOST_SAMPLES = 2000
"""Of a wheel's rate: more are taken as means over equal stretches."""


def measured_wheel(rotor: RotorSeries, first: int, last: int, zero: int) -> ModuleType:
    """`internal-rotor` with the measured rate, of a record from `first` to `last` [ns], whose times count from `zero` [ns].

    Raises:
        InputError: the rate does not reach over the record, or the wheel stands still.
    """
    stamp, rate = rotor.timestamp_ns, rotor.rate
    if len(stamp) < 2:
        raise InputError(f"rotor0 holds {len(stamp)} rates: give the wheel's rate over all of the record, or remove it")
    slack = float(np.median(np.diff(stamp)))
    if stamp[0] > first + slack or stamp[-1] < last - slack:
        a, b, end = ((v - first) * 1e-9 for v in (stamp[0], stamp[-1], last))
        raise InputError(
            f"rotor0 reaches from {a:.4g} to {b:.4g} s and the record from 0 to {end:.4g} s: give the wheel's rate over all of the "
            "record, or cut the record to it"
        )
    in_record = slice(max(int(np.searchsorted(stamp, first)) - 1, 0), int(np.searchsorted(stamp, last)) + 2)
    times, rate = (stamp[in_record] - zero) * 1e-9, rate[in_record]
    if not np.any(rate):
        raise InputError("rotor0 shows no turning wheel in this record: give rates that are not all zero, or remove it")
    block = max(1, len(times) // MOST_SAMPLES)
    if block > 1:
        use = len(times) // block * block
        times, rate = (x[:use].reshape(-1, block).mean(axis=1) for x in (times, rate))
    known = {
        "axis": None if rotor.axis is None else rotor.axis.tolist(),
        "inertia_kg_m2": rotor.inertia_kg_m2,
    }
    given = {"times_s": times.tolist(), "rate_rad_s": rate.tolist()}
    return of_record(effects()["internal-rotor"], given | {k: v for k, v in known.items() if v is not None})
