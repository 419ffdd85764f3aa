"""The law that a diagnosis discovered, as a section of its page."""

from __future__ import annotations

from typing import Any

from massprops.report.html import number, table, text


def law_section(law: dict[str, Any] | None) -> str:
    """Formula, terms and residuals of `law` in `diagnosis.json`; empty where none was looked for."""
    if law is None:
        return ""
    if law["formula"] is None:
        return f"<p>None: {text(law['because'])}.</p>"
    kind, said = ("done", "Stated.") if law["stated"] else ("warning", f"Not stated: {text(law['because'])}.")
    terms = [
        (t["term"], f"{number(t['coefficient'], 4)} ± {number(t['sigma'], 2)}", t["unit"], number(t["probability"], 2))
        for t in law["terms"]
    ]
    left = [
        (part.replace("_", " "), number(law[part]["before"], 4), number(law[part]["after"], 4))
        for part in ("fitted", "held_out")
    ]
    return (
        f'<div class="{kind}">{said}</div>'
        f"<p><code>{text(law['formula'])}</code></p>"
        "<p>Torque over the mean moment, body axes, SI. <code>law.py</code> is its effect file, <code>law.yaml</code> the "
        "model: <code>massprops estimate SEQ --effect law.py --model law.yaml</code>.</p>"
        + table(terms, ("term", "coefficient ± 1σ", "unit", "probability"), numeric=(1, 3))
        + "<h3>What it leaves, over the noise</h3>"
        + table(left, ("data", "without", "with"))
    )
