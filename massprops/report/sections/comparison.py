"""Against the CAD mesh, when `massprops compare` was run into this folder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from massprops.exchange.compare import spoken
from massprops.report.data import RunData
from massprops.report.html import Safe, between, number, table, text
from massprops.report.viewer import viewer

TITLE, ORDER = "Against CAD", 6
NAMES = {"median": "median", "mean_signed": "mean, signed", "rms": "rms", "p95": "95 %", "hausdorff": "Hausdorff"}


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
        parts.append('<p>On the mesh: <a href="#summary">“deviation from CAD”</a> under the object.</p>')
    parts.append(f"<h3>Surface distances</h3>{_distances(document.get('distances') or {})}")
    parts.append(f"<h3>Quantities, by the mesh{_marked(document, 'mesh')}</h3>{_quantities(document['rows'])}")
    if document.get("fused"):
        title = f"Quantities, by mesh and motion together{_marked(document, 'fused')}"
        parts.append(f"<h3>{title}</h3>{_quantities(document['fused'])}")
    parts.append(
        "<p class='soft'>After alignment, in the CAD's axes. Products of inertia: error as a share of the mean diagonal element; "
        "centre of mass: of the CAD's length. Axes: angle, whatever the sign.</p>"
    )
    return "".join(parts)


def _marked(document: dict[str, Any], source: str) -> str:
    return " (recommended)" if document.get("fused") and document.get("recommended") == source else ""


def _sentence(document: dict[str, Any]) -> str:
    said = []
    for source, who in (("rows", "By the mesh"), ("fused", "By mesh and motion together")):
        rows = document.get(source) or []
        held = [r for r in rows if r.get("holds") is not None]
        volume = next((r for r in rows if r["quantity"] == "volume"), None)
        if volume:
            said.append(f"{who}, the volume differs from the CAD's by {volume['error_text'].replace('-', '−')}")
            yes = sum(bool(r["holds"]) for r in held)
            said[-1] += f", and {yes} of {len(held)} intervals hold the CAD's value." if held else "."
    said.append("The scale was fitted to the CAD." if document.get("free_scale") else "The run's own scale was kept.")
    return f"<p>{text(' '.join(said))}</p>"


def _quantities(rows: Sequence[dict[str, Any]]) -> str:
    marks = {True: '<b class="good">yes</b>', False: '<b class="bad">no</b>'}
    return table(
        [
            (
                spoken(r["quantity"]),
                "" if r.get("unit") == "deg" else number(r.get("cad")),
                "" if r.get("unit") == "deg" else number(r.get("ours")),
                str(r.get("error_text", "")).replace("-", "−"),
                str(r.get("unit", "")).replace("^2", "²").replace("^3", "³").replace("1", "").replace("deg", ""),
                between(r["interval_90"]) if r.get("interval_90") else "",
                Safe("" if r.get("holds") is None else marks[bool(r["holds"])]),
            )
            for r in rows
        ],
        ("quantity", "CAD", "this run", "error", "unit", "90 % interval", "holds CAD"),
        numeric=(1, 2, 3, 5),
    )


def _distances(distances: dict[str, Any]) -> str:
    length = distances.get("length")
    if not length:
        return ""

    def cell(value: float) -> str:
        size = f"{number(1000 * value, 3)} mm" if length < 100 else f"{number(value, 3)} m"
        return f"{size} ({number(100 * value / length, 2)} %)"

    rows = [(name, cell(distances["ours"][key]), cell(distances["cad"][key])) for key, name in NAMES.items()]
    return (
        table(rows, ("", "this run to CAD", "CAD to this run"))
        + f"<p class='soft'>Percent of the CAD's greatest length, {number(length)} m. Positive: this run lies outside.</p>"
    )
