"""Simulated tracks with effects at work, `massprops diagnose` on them, and whether it names what acted.

Parameters are those of kind `estimate`, without an estimator.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from massprops.campaigns.kinds import always, as_given, checked_by, estimate
from massprops.errors import NotPossible

SENTENCE = "Simulated tracks with any effects, and whether the diagnosis names them."
OWN_THREADS = False
OUTCOMES = ("right", "among", "wrong", "missed", "false_alarm", "unexplained")


prepared = as_given
check = checked_by(lambda values: estimate.scenario_of(values, 0))


def parameters(fixed: dict[str, Any], grid: dict[str, Any]) -> list[str]:
    """Names that may be set."""
    return [name for name in estimate.parameters(fixed, grid) if name != "estimator"]


default_runs = always(10)
chunk = always(1)  # a diagnosis takes seconds to minutes
basis = always(None)


def runs(values: dict[str, Any], seeds: list[int], folder: Path | None) -> list[dict[str, Any]]:
    """Verdict and gaps of each seed."""
    return [_run(values, seed) for seed in seeds]


def _run(values: dict[str, Any], seed: int) -> dict[str, Any]:
    from massprops.diagnosis.search.diagnose import diagnose
    from massprops.simulation.tracks import simulate_tracks

    try:
        simulated = simulate_tracks(estimate.scenario_of(values, seed))
        diagnosis = diagnose(simulated.sequence)
    except NotPossible as stop:
        return {"error": f"not possible: {stop}"}
    return judged(diagnosis.document, set(simulated.truth["effects"]))


def judged(document: dict[str, Any], acted: set[str]) -> dict[str, Any]:
    """A diagnosis against what acted, flat.

    Returns:
        `verdict`, `named`; one of `OUTCOMES` is 1: `right` (exactly what acted, or rightly nothing), `among` (ambiguous,
        and what acted is among it), `wrong`, `missed` (none, though something acted), `false_alarm`, `unexplained`;
        `fitted_before`, `fitted_after`, `held_out_before`, `held_out_after`: gaps in units of the stated noise.
    """
    verdict = str(document["verdict"])
    named = [str(entry["name"]) for entry in document.get("effects") or ()]
    if verdict == "unexplained":
        outcome = "unexplained"
    elif verdict == "none":
        outcome = "missed" if acted else "right"
    elif not acted:
        outcome = "false_alarm"
    elif set(named) == acted and verdict == "named":
        outcome = "right"
    else:
        outcome = "among" if verdict == "ambiguous" and acted <= set(named) else "wrong"
    row: dict[str, Any] = {"verdict": verdict, "named": "+".join(named)}
    row |= {name: int(name == outcome) for name in OUTCOMES}
    for part in ("fitted", "held_out"):
        for when in ("before", "after"):
            value = ((document.get("gap") or {}).get(part) or {}).get(when)
            if isinstance(value, int | float) and np.isfinite(value):
                row[f"{part}_{when}"] = float(value)
    return row


def tables(plan: Any, points: list[Any]) -> list[dict[str, Any]]:
    """Outcomes counted and gaps, one line per point."""
    rows = []
    for p in points:
        counts = [int(p.values(name).sum()) for name in OUTCOMES]
        gaps = [p.values(name) for name in ("held_out_before", "held_out_after")]
        medians = [float(np.median(g)) if len(g) else None for g in gaps]
        rows.append([p.label, len(p.rows), p.failed, *counts, *medians])
    columns = ["", "runs", "failed", *(name.replace("_", " ") for name in OUTCOMES), "gap before", "after"]
    note = "Gaps: rms residual of held-out measurements in units of the stated noise, median over the runs."
    return [{"title": "What was named against what acted", "columns": columns, "rows": rows, "notes": [note]}]


TITLES = {
    "fitted_before": "residuals before, fitted data [noise]",
    "fitted_after": "residuals after, fitted data [noise]",
    "held_out_before": "residuals before, held-out data [noise]",
    "held_out_after": "residuals after, held-out data [noise]",
}
boxes = always(["fitted_before", "fitted_after", "held_out_before", "held_out_after"])
