"""Effects of the catalogue that follow something a sequence holds beside the motion: a wheel's measured rate."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from massprops.effects import effects, of_record
from massprops.errors import InputError
from massprops.sequence.data import RotorSeries, Sequence

MOST_SAMPLES = 2000
"""Of a wheel's rate: more are taken as means over equal stretches."""


def effects_beside(sequence: Sequence) -> list[ModuleType]:
    """The effects of the catalogue as what was measured makes them; none where nothing was.

    Raises:
        InputError: what was measured does not reach over the record.
    """
    rotor = sequence.rotor
    if rotor is None:
        return []
    return [of_record(effects()["internal-rotor"], _of_wheel(rotor, *_bounds(sequence)))]


def _bounds(sequence: Sequence) -> tuple[int, int]:
    """First and last time of the record that effects are told in [ns]."""
    series = [sequence.attitude, sequence.tracks, sequence.rates]
    if sequence.tracks is None:  # a gyroscope beside attitudes is used within theirs
        series = [sequence.attitude or sequence.rates]
    stamps = np.concatenate([s.timestamp_ns for s in series if s is not None] or [np.zeros(1, np.int64)])
    return int(stamps.min(initial=2**62)), int(stamps.max(initial=0))


def _of_wheel(rotor: RotorSeries, first: int, last: int) -> dict[str, object]:
    """What `internal_rotor.measured` takes."""
    stamp, rate = rotor.timestamp_ns, rotor.rate
    if len(stamp) < 2 or not np.any(rate):
        raise InputError("rotor0 shows no turning wheel: give rates that are not all zero, or remove it")
    slack = float(np.median(np.diff(stamp)))
    if stamp[0] > first + slack or stamp[-1] < last - slack:
        a, b, end = ((v - first) * 1e-9 for v in (stamp[0], stamp[-1], last))
        raise InputError(
            f"rotor0 reaches from {a:.4g} to {b:.4g} s and the record from 0 to {end:.4g} s: give the wheel's rate over all of the "
            "record, or cut the record to it"
        )
    own = slice(max(int(np.searchsorted(stamp, first)) - 1, 0), int(np.searchsorted(stamp, last)) + 2)
    times, rate = (stamp[own] - first) * 1e-9, rate[own]
    block = max(1, len(times) // MOST_SAMPLES)
    if block > 1:
        use = len(times) // block * block
        times, rate = (x[:use].reshape(-1, block).mean(axis=1) for x in (times, rate))
    known = {
        "axis": None if rotor.axis is None else rotor.axis.tolist(),
        "inertia_kg_m2": rotor.inertia_kg_m2,
    }
    given = {"times_s": times.tolist(), "rate_rad_s": rate.tolist()}
    return given | {k: v for k, v in known.items() if v is not None}
