"""The page of a diagnosis by the balance of momentum."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.diagnosis.page_parts import GAP, law, not_tried, notes, verdict, wheel
from massprops.report.html import number, table, text
from massprops.report.page import of_sections
from massprops.report.plot import plot

if TYPE_CHECKING:
    from massprops.diagnosis.diagnose import BalanceDiagnosis


def page(d: BalanceDiagnosis) -> str:
    """`report.html`, one file that opens offline."""
    return of_sections(
        "massprops · diagnosis",
        [
            ("verdict", "Verdict", verdict(d.document)),
            ("law", "A law for the residuals", law(d.document)),
            ("gap", "Residuals before and after", _gap(d)),
            ("where", "Where", _where(d.document)),
            ("candidates", "Candidates", _candidates(d.document)),
            ("wheel", "Momentum of the wheel", _wheel(d)),
            ("torque", "Unknown torque", _torque(d)),
            ("notes", "Notes", notes(d.document)),
        ],
    )


def _gap(d: BalanceDiagnosis) -> str:
    gap = d.document["gap"]
    rows = [
        (p.replace("_", " "), *(number(gap[p][k], 4) for k in ("before", "after", "beside_unknown")), "1")
        for p in ("fitted", "held_out")
    ]
    s = d.selection
    shown = s.named[0].alone if s.named else s.base
    series = [
        (name, d.record.times, np.sqrt(np.mean((fit.residual / s.noise) ** 2, axis=1))[: len(d.record.times)])
        for name, fit in (("before", s.base), ("after", shown))
    ]
    return (
        f"<p>{GAP}</p>"
        + table(rows, ("data", "before", "after", "after, beside an unknown torque", "noise floor"))
        + plot(series, "time [s]", "residual, rms / σ")
    )


def _where(doc: dict[str, Any]) -> str:
    rows = [
        (
            w["channel"],
            f"{number(w['interval_s'][0], 3)}–{number(w['interval_s'][1], 4)} s",
            number(w["z"], 3),
            number(w["size"], 3),
        )
        for w in doc["where"]
    ]
    note = (
        "Where a free rigid body fails most. z: how far beyond chance, in standard deviations. rms / σ: size of the "
        "residuals over the noise."
    )
    return f'<p class="soft">{note}</p>' + table(rows, ("measured", "time", "z", "rms / σ"), numeric=(2, 3))


def _candidates(doc: dict[str, Any]) -> str:
    rows = [
        (
            f"{c['name']}{' (any history)' if c['form'] != 'simple' else ''}",
            number(c["evidence"], 5),
            number(c["evidence_against_unknown"], 5),
            number(c["significance"], 2),
            number(c["fitted"], 4),
            number(c["held_out"], 4),
        )
        for c in doc["candidates"]
    ]
    head = ("effect", "log evidence", "against an unknown torque", "p-value", "fitted", "held out")
    note = (
        "Log evidence: against a free rigid body, and against a smooth torque of which nothing is known; an effect is "
        "named only if both are well above 0. p-value: chance that a free rigid body leaves as much. Fitted, held out: "
        "residuals over the noise, of the data in the fit and of data that it has not seen."
    )
    listed = table(rows, head, numeric=(1, 2, 3, 4, 5))
    return (f'<p class="soft">{note}</p>{listed}' if rows else "<p>No effect was tried.</p>") + not_tried(doc)


def _wheel(d: BalanceDiagnosis) -> str:
    fit = d.selection.named[0].best if d.selection.named else None
    if fit is None or fit.history is None:
        return ""
    return wheel(fit.record.path.t, fit.history)


def _torque(d: BalanceDiagnosis) -> str:
    s = d.selection
    if s.verdict == "none":
        return ""
    fit = s.named[0].with_latent if s.named and s.named[0].with_latent is not None else s.unknown
    beside = f"beside {s.named[0].name}" if s.named else "beside a rigid body alone"
    series = [(a, fit.record.path.t, fit.torque[:, k]) for k, a in enumerate("xyz")]
    return f"<p>Body axes, over the mean moment, {text(beside)}.</p>" + plot(series, "time [s]", "torque [rad/s²]")
