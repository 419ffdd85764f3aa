"""Against the CAD mesh, when `massprops compare` was run into this folder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from massprops.exchange.compare import DISTANCES, quantity_label
from massprops.report.data import RunData
from massprops.report.html import Safe, between, number, table, text
from massprops.report.viewer import viewer

TITLE, ORDER = "Comparison with CAD", 6


def render(data: RunData) -> str:
    """Distances, the coloured mesh, and the rows of `compare.json`."""
    document = data.comparison
    if not document.get("rows"):
        return ""
    parts = [f'<div class="warning">{text(w)}</div>' for w in document.get("warnings") or []]
    parts.append(_sentence(document))
    limit = document.get("colour_limit")
    if data.compared is not None and data.compared.distance is not None and limit:
        parts.append(viewer(data.compared, limit=limit))
    elif limit:
        parts.append(
            '<p>To see the distances on the mesh, choose <a href="#summary">“deviation from CAD”</a> under the object above.</p>'
        )
    parts.append(f"<h3>Surface distances</h3>{_distances(document.get('distances') or {})}")
    for key, who in _sides(document):
        mark = " (recommended)" if document.get("fused") and document.get("recommended") == SOURCE[key] else ""
        parts.append(f"<h3>Quantities from {who}{mark}</h3>{_quantities(document[key])}")
    parts.append(
        "<p class='soft'>After alignment, in the axes of the CAD mesh. Errors of products of inertia are relative to the mean "
        "diagonal element, errors of the centre of mass to the length of the CAD mesh. Axes: angle, ignoring the sign.</p>"
    )
    return "".join(parts)


SOURCE = {"rows": "mesh", "fused": "fused"}
"""What `recommended` calls the tables of a comparison."""


def _sides(document: dict[str, Any]) -> list[tuple[str, str]]:
    """Keys of the tables there are and whose they are, what the run recommends first."""
    sides = [
        (key, who) for key, who in (("rows", "the mesh"), ("fused", "mesh and motion together")) if document.get(key)
    ]
    return sorted(sides, key=lambda side: SOURCE[side[0]] != document.get("recommended"))


def _sentence(document: dict[str, Any]) -> str:
    sentences = []
    for key, who in _sides(document):
        rows = document[key]
        held = [r for r in rows if r.get("holds") is not None]
        volume = next((r for r in rows if r["quantity"] == "volume"), None)
        if volume:
            sentences.append(
                f"From {who}, the volume differs from that of the CAD mesh by {volume['error_text'].replace('-', '−')}"
            )
            yes = sum(bool(r["holds"]) for r in held)
            sentences[-1] += f", and {yes} of {len(held)} intervals contain the CAD value." if held else "."
    sentences.append(
        "The scale was fitted to the CAD mesh." if document.get("free_scale") else "The run's own scale was kept."
    )
    return f"<p>{text(' '.join(sentences))}</p>"


def _quantities(rows: Sequence[dict[str, Any]]) -> str:
    marks = {True: '<b class="good">yes</b>', False: '<b class="bad">no</b>'}
    return table(
        [
            (
                quantity_label(r["quantity"]),
                "" if r.get("unit") == "deg" else number(_zeroed(r.get("cad"))),
                "" if r.get("unit") == "deg" else number(r.get("ours")),
                str(r.get("error_text", "")).replace("-", "−"),
                str(r.get("unit", "")).replace("^2", "²").replace("^3", "³").replace("1", "").replace("deg", ""),
                between(r["interval_90"]) if r.get("interval_90") else "",
                Safe("" if r.get("holds") is None else marks[bool(r["holds"])]),
            )
            for r in rows
        ],
        ("quantity", "CAD", "this run", "error", "unit", "90 % interval", "contains CAD"),
        numeric=(1, 2, 3, 5),
    )


def _zeroed(value: float | None) -> float | None:
    """A CAD mesh about its own centre of mass has that at zero, but for the last bits."""
    return 0.0 if value is not None and abs(value) < 1e-7 else value


def _distances(distances: dict[str, Any]) -> str:
    length = distances.get("length")
    if not length:
        return ""

    def cell(value: float) -> str:
        size = f"{number(1000 * value, 3)} mm" if length < 100 else f"{number(value, 3)} m"
        return f"{size} ({number(100 * value / length, 2)} %)"

    rows = [(name, cell(distances["ours"][key]), cell(distances["cad"][key])) for key, name in DISTANCES.items()]
    return (
        table(rows, ("", "this run to CAD", "CAD to this run"))
        + f"<p class='soft'>Percentages are of the greatest length of the CAD mesh, {number(length)} m. Positive: this run's surface lies outside.</p>"
    )
