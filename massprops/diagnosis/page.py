"""The page of a diagnosis by the balance of momentum."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.report.html import number, plot, table, text
from massprops.report.law import law_section
from massprops.report.page import document as whole_page

if TYPE_CHECKING:
    from massprops.diagnosis.diagnose import BalanceDiagnosis

KIND = {"none": "done", "named": "done", "ambiguous": "warning", "unexplained": "warning"}


def page(d: BalanceDiagnosis) -> str:
    """`report.html`, one file that opens offline."""
    sections = [
        ("verdict", "Verdict", _verdict(d.document)),
        ("gap", "The gap before and after", _gap(d)),
        ("where", "Where", _where(d.document)),
        ("candidates", "Candidates", _candidates(d.document)),
        ("law", "A discovered law", law_section(d.document.get("law"))),
        ("wheel", "Momentum of the wheel", _wheel(d)),
        ("torque", "A torque that nothing is known of", _torque(d)),
        ("notes", "Notes", _notes(d.document)),
    ]
    body = "".join(f'<section id="{i}"><h2>{t}</h2>{b}</section>' for i, t, b in sections if b)
    links = "".join(f'<a href="#{i}">{t}</a>' for i, t, b in sections if b)
    return whole_page("massprops · diagnosis", body, links, "")


def _verdict(doc: dict[str, Any]) -> str:
    said = f'<div class="{KIND[doc["verdict"]]}"><b>{text(doc["verdict"])}</b>. {text(doc["reason"])}</div>'
    rows = [
        (
            e["name"],
            name,
            "not shown" if v is None else f"{number(v, 4)} ± {number(e['sigma'][name], 2)}",
            e["units"][name],
        )
        for e in doc["effects"]
        for name, v in e["parameters"].items()
    ]
    if not rows:
        return said
    return (
        said + table(rows, ("effect", "parameter", "value ± 1σ", "unit"), numeric=(2,)) + f"<p>{text(doc['axes'])}</p>"
    )


def _gap(d: BalanceDiagnosis) -> str:
    gap = d.document["gap"]
    rows = [
        (p.replace("_", " "), number(gap[p]["before"], 4), number(gap[p]["after"], 4), "1")
        for p in gap
        if p != "noise_floor"
    ]
    s = d.selection
    shown = s.named[0].alone if s.named else s.base
    series = [
        (name, d.record.times, np.sqrt(np.mean(fit.residual**2, axis=1)))
        for name, fit in (("before", s.base), ("after", shown))
    ]
    return (
        "<p>Root-mean-square residuals in units of the noise.</p>"
        + table(rows, ("data", "before", "after", "noise floor"))
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
    return table(rows, ("channel", "interval", "z", "rms / σ"), numeric=(2, 3))


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
    skipped = "".join(f"<li>{text(n)}: {text(why)}</li>" for n, why in doc["skipped"].items())
    head = ("effect", "log evidence", "against an unknown torque", "chance of nothing", "left", "held out")
    return table(rows, head, numeric=(1, 2, 3, 4, 5)) + (f"<p>Not tried:</p><ul>{skipped}</ul>" if skipped else "")


def _wheel(d: BalanceDiagnosis) -> str:
    fit = d.selection.named[0].best if d.selection.named else None
    if fit is None or fit.history is None:
        return ""
    series = [("along its axis", fit.record.path.t, fit.history)]
    return plot(series, "time [s]", "momentum over mean moment [rad/s]")


def _torque(d: BalanceDiagnosis) -> str:
    s = d.selection
    if s.verdict == "none":
        return ""
    fit = s.named[0].beside if s.named and s.named[0].beside is not None else s.unknown
    beside = f"beside {s.named[0].name}" if s.named else "beside a rigid body alone"
    series = [(a, fit.record.path.t, fit.torque[:, k]) for k, a in enumerate("xyz")]
    return f"<p>Body axes, over the mean moment, {text(beside)}.</p>" + plot(series, "time [s]", "torque [rad/s²]")


def _notes(doc: dict[str, Any]) -> str:
    return "<ul>" + "".join(f"<li>{text(w)}</li>" for w in doc["warnings"]) + "</ul>" if doc["warnings"] else ""
