"""Against the CAD mesh, when `massprops compare` was run into this folder."""

from __future__ import annotations

from massprops.report.data import RunData
from massprops.report.html import number, table, text

TITLE, ORDER = "Against CAD", 6


def render(data: RunData) -> str:
    """The rows of `compare.json`."""
    rows = data.comparison.get("rows")
    if not rows:
        return ""
    body = [
        (r["quantity"], number(r.get("cad")), number(r.get("ours")), r.get("error_text", ""), r.get("unit", ""))
        for r in rows
    ]
    return (
        table(body, ("quantity", "CAD", "this run", "error", "unit"))
        + f"<p class='soft'>{text(data.comparison.get('note', ''))}</p>"
    )
