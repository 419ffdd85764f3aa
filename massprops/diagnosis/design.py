"""`massprops diagnose --design`: a planned record, simulated as free motion, and what it could show and tell apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from massprops.diagnosis.isolability import APART, POWER, Plan, plan
from massprops.diagnosis.sequence_record import record_of_sequence
from massprops.errors import InputError
from massprops.simulation.track_scenario import TrackScenario

BETTER_ATTITUDE = 1e-3
"""1-sigma [rad] of the attitudes that a plan without any is tried with."""
OTHER_SPIN = (0.3, 1.0, 0.3)
"""Rotation near the middle axis, in principal axes: the body turns over, and shows all its sides."""


def design(scenario: str | Path) -> dict[str, Any]:
    """What a planned record could show: the content of `design.json`.

    Args:
        scenario: `tracks`, or a YAML file of `kind: tracks` (`massprops simulate`); its effects are left out.

    Raises:
        InputError: no such scenario.
        NotPossible: its sensors show no rotation.
    """
    planned = _scenario(scenario)
    outlook = _plan(planned)
    return {
        "format": "massprops-design/1",
        "scenario": str(scenario),
        "epochs": len(outlook.record.times),
        "seconds": outlook.record.path.span,
        "measured": "body rates" if outlook.record.rows.rates else "attitudes",
        "sigma": float(np.median(outlook.record.rows.sigma)),
        "power": POWER,
        "effects": [
            {
                "name": s.name,
                "unit": s.unit,
                "shows_from": _finite(s.shows_from),
                "in_the_best_direction": _finite(s.best),
                "in_the_worst_direction": _finite(s.worst),
            }
            for s in outlook.signals
        ],
        "told_apart": {
            a.name: {b.name: _finite(outlook.apart[i, j]) for j, b in enumerate(outlook.signals) if j != i}
            for i, a in enumerate(outlook.signals)
        },
        "confused": [list(pair) for pair in outlook.confused],
        "apart_up_to": APART,
        "would_help": _help(planned, outlook),
        "skipped": outlook.skipped,
    }


def _scenario(scenario: str | Path) -> TrackScenario:
    from massprops.documents.loading import load_yaml
    from massprops.simulation.track_scenario import track_scenario

    path = Path(scenario)
    given: dict[str, Any] = {}
    if str(scenario) != "tracks":
        if not path.is_file() or path.suffix.lower() not in (".yaml", ".yml"):
            raise InputError(f"--design {scenario}: give 'tracks', or a YAML file with 'kind: tracks'")
        given = load_yaml(path)
        if given.get("kind") != "tracks":
            raise InputError(f"--design {scenario}: only scenarios with 'kind: tracks' can be planned")
    return replace(track_scenario(given, str(scenario)), effects=(), model=None, outliers=0.0)


def _plan(planned: TrackScenario) -> Plan:
    from massprops.simulation.tracks import simulate_tracks

    made = simulate_tracks(planned)
    return plan(record_of_sequence(made.sequence), made.state.inertia)


def _help(planned: TrackScenario, found: Plan) -> list[dict[str, Any]]:
    """Changes of the plan, with the pairs that each would tell apart."""
    changes = {
        "a record twice as long": {"frames": min(2 * planned.frames, 100_000)},
        "a rotation near the middle axis": {"spin": OTHER_SPIN},
    }
    if planned.attitude_sigma == 0.0:
        changes[f"attitudes of {BETTER_ATTITUDE:g} rad"] = {"attitude_sigma": BETTER_ATTITUDE}
    out = []
    for words, change in changes.items():
        other = _plan(replace(planned, **change))  # type: ignore[arg-type]
        gained = [pair for pair in found.confused if pair not in other.confused]
        out.append({"change": words, "tells_apart": [list(pair) for pair in gained]})
    return sorted(out, key=lambda e: -len(e["tells_apart"]))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
