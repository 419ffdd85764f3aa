"""Sections that the pages of a diagnosis share, from the content of `diagnosis.json`, whichever way it was found."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.diagnosis.document import is_blind
from massprops.diagnosis.listed import listed
from massprops.report.html import number, table, text, unit
from massprops.report.plot import log_plot, plot

KIND = {"none": "done", "named": "done", "ambiguous": "warning", "unexplained": "warning"}
MEANS = {
    "none": "a free rigid body is enough: no effect is missing in its model",
    "named": "this effect explains what a free rigid body does not",
    "ambiguous": "what a free rigid body does not explain has several explanations",
    "unexplained": "no known effect explains what a free rigid body does not",
}
UNSEEN = "whether an effect is missing cannot be told"
"""What the verdict of a record means that turns too little."""
GAP = "Root-mean-square residuals over the noise: 1 is as good as can be."
WITHIN = 1.645
"""Sigmas of a normal law that hold 90 %."""
Series = tuple[str, np.ndarray, np.ndarray]
"""Name, times and values of a line."""


def verdict(doc: dict[str, Any]) -> str:
    """The verdict in a sentence, and the parameters of what was named; those that the data do not show have no number."""
    names = ", ".join(dict.fromkeys(e["name"] for e in doc["effects"]))
    title = doc["verdict"] + (f": {names}" if names else "")
    kind, means = ("warning", UNSEEN) if is_blind(doc) else (KIND[doc["verdict"]], MEANS[doc["verdict"]])
    statement = (
        f'<div class="{kind}"><b>{text(title)}</b> ({means}). '
        f"{text(_sentence(doc['reason']))}</div>{_predicted(doc['gap']['held_out'])}"
    )
    rows = [row for e in doc["effects"] for row in _parameters(e)]
    if not rows:
        return statement
    parameter_table = table(rows, ("effect", "parameter", "value ± 1σ", "unit"), numeric=(2,))
    return statement + parameter_table + f'<p class="soft">{text(_sentence(doc["axes"]))}</p>'


def _parameters(e: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of an effect's parameters: those that the data show, and in one row the names of the others."""
    listing = listed(e["parameters"])
    rows = [
        (
            e["name"],
            name,
            number(e["parameters"][name], 4) + (f" ± {number(e['sigma'][name], 2)}" if e["sigma"][name] else ""),
            unit(e["units"][name]),
        )
        for name in listing.rows
    ]
    if listing.more:
        rows.append((e["name"], f"{listing.more} more", "in diagnosis.json", ""))
    if listing.hidden:
        rows.append((e["name"], listing.hidden, "not shown by the data", ""))
    return rows


def residuals(lines: list[Series], measured: str) -> str:
    """Residuals over time, without and with what was found, on a logarithmic scale, with a line at the noise.

    Args:
        lines: each a name, times (n,) and rms over the noise (n,).
        measured: what, in words.
    """
    times = np.concatenate([t for _, t, _ in lines])
    series = [*lines, ("noise", np.array([times.min(), times.max()]), np.ones(2))]
    return log_plot(series, "time [s]", f"{measured}, rms / σ", [f"s{k}" for k in range(len(lines))] + ["noise"])


def _sentence(words: str) -> str:
    """With a capital and a full stop."""
    return words[:1].upper() + words[1:] + ("" if words.endswith((".", "?")) else ".")


def _predicted(held: dict[str, Any]) -> str:
    """How data that no fit has seen are predicted; empty where none were held out."""
    before, after = (number(held[k], 3) for k in ("before", "after"))
    if "–" in (before, after):
        return ""
    if before == after:
        return f"<p>Data that no fit has seen are predicted to {before} times the noise.</p>"
    return (
        f"<p>Data that no fit has seen are predicted to {after} times the noise with it, and to {before} times without "
        "it.</p>"
    )


def law(doc: dict[str, Any]) -> str:
    """The law that was looked for: its formula, its terms with their probability, and how it predicts."""
    entry = doc.get("law")
    if entry is None:
        return ""
    if entry["formula"] is None:
        return f"<p>No law: {text(entry['because'])}.</p>"
    if entry["stated"]:
        statement = (
            '<div class="done"><b>Stated</b>: each of its terms is likely, and it beats an unknown torque.</div>'
        )
    else:
        statement = f'<div class="warning"><b>Not stated</b>: {text(entry["because"])}.</div>'
    head = f"{statement}<p><code>{text(entry['formula'])}</code></p>"
    terms = [
        (
            " = ".join((t["term"], *t["same_here"])),
            f"{number(t['coefficient'], 4)} ± {number(t['sigma'], 2)}",
            unit(t["unit"]),
            number(t["probability"], 3),
        )
        for t in entry["terms"]
    ]
    gap = [
        (p.replace("_", " "), *(number(entry[p][k], 4) for k in ("before", "after"))) for p in ("fitted", "held_out")
    ]
    return (
        head
        + table(terms, ("torque over the mean moment", "coefficient ± 1σ", "unit", "probability"), numeric=(1, 3))
        + _rivals(entry["rivals"])
        + _beside(entry["catalogue"])
        + table(gap, ("residual over the noise", "without it", "with it"))
        + f"<p>{text(entry['effect'])} contains the law as an effect, {text(entry['model'])} its parameters.</p>"
    )


def simulator(doc: dict[str, Any]) -> str:
    """A user's simulator: what it leaves, and its parameters."""
    box = doc.get("simulator")
    if box is None:
        return ""
    rows = [
        (
            n,
            "not shown by the data" if v is None else f"{number(v, 4)} ± {number(box['sigma'][n], 2)}",
            unit(box["units"][n]),
        )
        for n, v in box["parameters"].items()
    ]
    sentence = f"{box['name']} leaves {number(box['fitted'], 3)} times the noise, and {number(box['held_out'], 3)} in held-out data."
    return f"<p>{text(sentence)}</p>" + table(rows, ("parameter", "value ± 1σ", "unit"), numeric=(1,))


def _rivals(rivals: list[dict[str, Any]]) -> str:
    """Terms in place of a law's that explain the record nearly as well."""
    rows = [(" + ".join(r["terms"]), number(r["log_evidence"], 2)) for r in rivals]
    return (
        table(rows, ("nearly as likely in its place", "log evidence over the likeliest"), numeric=(1,)) if rows else ""
    )


def _beside(catalogue: dict[str, Any] | None) -> str:
    """By how much a law is ahead of what the catalogue names."""
    if catalogue is None:
        return ""
    name, ahead = " + ".join(catalogue["effects"]), catalogue["log_evidence"]
    return f"<p>Over {text(name)} of the catalogue the law has {number(ahead, 2)} in log evidence.</p>"


def wheel(times: np.ndarray, momentum: np.ndarray, sigma: np.ndarray | None = None) -> str:
    """The momentum (n,) of a wheel along its axis at times (n,), with a band of 1.645 sigma (n,) where that is known."""
    bands = [] if sigma is None else [(times, momentum - WITHIN * sigma, momentum + WITHIN * sigma)]
    note = '<p class="soft">Grey: 90 % intervals.</p>' if bands else ""
    label = "momentum over mean moment [rad/s]"
    return plot([("along its axis", times, momentum)], "time [s]", label, bands=bands) + note


def torque_plot(times: np.ndarray, torque: np.ndarray, sigma: np.ndarray) -> str:
    """An unknown torque (n, 3) in body axes over times (n,), with bands of 1.645 sigma (n, 3) where these are known."""
    series = [(a, times, torque[:, k]) for k, a in enumerate("xyz")]
    low, high = torque - WITHIN * sigma, torque + WITHIN * sigma
    bands = [(times, low[:, k], high[:, k]) for k in range(3)] if np.isfinite(sigma).all() else []
    return plot(series, "time [s]", "torque [rad/s²]", bands=bands)


def not_tried(doc: dict[str, Any]) -> str:
    """The effects for which data lack, and why."""
    skipped = "".join(f"<li>{text(n)}: {text(why)}</li>" for n, why in doc["skipped"].items())
    return f"<p>Not tried, for want of data:</p><ul>{skipped}</ul>" if skipped else ""


def notes(doc: dict[str, Any]) -> str:
    """The warnings of a diagnosis as a list."""
    return "<ul>" + "".join(f"<li>{text(w)}</li>" for w in doc["warnings"]) + "</ul>" if doc["warnings"] else ""
