"""The page of a diagnosis by the balance of momentum."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.diagnosis.hypothesis_fit import torque_sd
from massprops.diagnosis.page_parts import GAP, law, not_tried, notes, residuals, simulator, torque_plot, verdict, wheel
from massprops.report.html import number, table, text
from massprops.report.page import of_sections

if TYPE_CHECKING:
    from massprops.diagnosis.diagnose import BalanceDiagnosis


BINS = 120
"""Points of a line of residuals over time, at most."""


def page(d: BalanceDiagnosis) -> str:
    """`report.html`, one file that opens offline."""
    return of_sections(
        "massprops · diagnosis",
        [
            ("verdict", "Verdict", verdict(d.document)),
            ("law", "A law for the residuals", law(d.document)),
            ("simulator", "Your simulator", simulator(d.document)),
            ("gap", "Residuals before and after", _gap(d)),
            ("where", "Where", _where(d.document)),
            ("candidates", "Candidates", _candidates(d.document)),
            ("wheel", "Momentum of the wheel", _wheel(d)),
            ("torque", "Unknown torque", _torque(d)),
            ("lever", "Accelerometer", _lever(d.document)),
            ("notes", "Notes", notes(d.document)),
        ],
    )


def _gap(d: BalanceDiagnosis) -> str:
    gap = d.document["gap"]
    rows = [
        (p.replace("_", " "), *(number(gap[p][k], 4) for k in ("before", "after", "beside_unknown")), "1")
        for p in ("fitted", "held_out")
    ]
    head = ("data", "before", "after", "after, beside an unknown torque", "noise floor")
    return f"<p>{GAP}</p>{table(rows, head)}{''.join(_over_time(d))}"


def _over_time(d: BalanceDiagnosis) -> list[str]:
    """Residuals over time of what was measured, and of a gyroscope beside attitudes by itself."""
    s, count = d.selection, len(d.record.times)
    name, fit = ("after", s.named[0].alone) if s.named else ("with an unknown torque", s.likeliest_unknown)
    shown = s.base if s.verdict == "none" else fit
    fits = [s.base] if shown is s.base else [s.base, shown]
    squares = [np.mean((f.residual / s.noise) ** 2, axis=1) for f in fits]
    plots = []
    for measured, channel_rows in (
        ("rate" if d.record.rows.rates else "attitude", slice(0, count)),
        ("rate of the gyroscope", slice(count, None)),
    ):
        t = d.record.row_times[channel_rows]
        parts = np.array_split(np.arange(len(t)), min(BINS, max(1, len(t))))
        middle = np.array([t[p].mean() for p in parts if len(p)])
        means = [np.sqrt([x[channel_rows][p].mean() for p in parts if len(p)]) for x in squares]
        if len(middle):
            lines = [(n, middle, v) for n, v in zip(("before", name), means, strict=False)]
            plots.append(residuals(lines, measured))
    return plots


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
        "named only if both are well above 0. p-value: chance that parameters lie so far from zero where "
        "nothing acts. Fitted, held out: "
        "residuals over the noise, of the data in the fit and of data that it has not seen."
    )
    listed = table(rows, head, numeric=(1, 2, 3, 4, 5))
    return (f'<p class="soft">{note}</p>{listed}' if rows else "<p>No effect was tried.</p>") + not_tried(doc)


def _wheel(d: BalanceDiagnosis) -> str:
    fit = d.selection.named[0].best if d.selection.named else None
    if fit is None or fit.history is None:
        return ""
    return wheel(fit.record.path.t, fit.history, fit.history_sd)


def _lever(doc: dict[str, Any]) -> str:
    """Where the sensor sits, and what that does not explain."""
    if "lever" not in doc:
        return ""
    lever = doc["lever"]
    rows = [
        (a, f"{number(1e3 * r, 4)} ± {number(1e3 * s, 2)} mm")
        for a, r, s in zip("xyz", lever["sensor_from_centre_of_mass_m"], lever["sigma"], strict=True)
    ]
    sentence = f"One lever leaves {number(lever['left_m_s2'], 3)} m/s² of what the accelerometer measured: this is free flight."
    return f"<p>{sentence}</p>" + table(rows, ("axis", "from the centre of mass to the sensor"))


def _torque(d: BalanceDiagnosis) -> str:
    s = d.selection
    if s.verdict == "none":
        return ""
    fit = s.with_torque
    beside = f"beside {s.named[0].name}" if fit.names else "beside a rigid body alone"
    alike = [(c["with"].replace(" by ", " with "), number(c["r"], 2)) for c in d.document["latent"]["correlates"]]
    return (
        f"<p>The smooth torque that explains best what is left, body axes, over the mean moment, {text(beside)}. "
        "Grey: 90 % intervals.</p>"
        + torque_plot(fit.record.path.t, fit.torque, torque_sd(fit))
        + (table(alike, ("goes along with", "correlation")) if alike else "")
    )
