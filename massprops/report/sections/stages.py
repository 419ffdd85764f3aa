"""How the run went: stages, times, memory, and what each measured."""

from __future__ import annotations

from massprops.report.data import RunData
from massprops.report.html import number, table, text

TITLE, ORDER = "How it was made", 9


def render(data: RunData) -> str:
    """Stage table, key facts, versions."""
    stages = data.manifest.get("stages") or {}
    rows = [
        (
            name,
            entry.get("status", ""),
            number(entry.get("seconds"), 4),
            number(entry.get("cpu_seconds"), 4),
            number(entry.get("peak_memory_mb"), 4),
        )
        for name, entry in stages.items()
    ]
    parts = [table(rows, ("stage", "state", "seconds", "CPU seconds", "peak MB"), 2)] if rows else []
    sfm, dense, footage = data.facts["sfm"], data.facts["dense"], data.facts["footage"]
    facts = [
        (
            "frames given / used / registered",
            f"{footage.get('given', '–')} / {footage.get('used', '–')} / {sfm.get('registered', '–')}",
        ),
        ("models found (images)", ", ".join(str(m.get("images")) for m in sfm.get("models", [])) or "–"),
        ("mean reprojection error", f"{number(sfm.get('reprojection_error_px'), 3)} px"),
        (
            "focal length",
            f"{number(sfm.get('focal_px'), 6)} px ± {number(100 * (sfm.get('focal_sigma_relative') or 0), 2)} %",
        ),
        ("silhouettes", data.facts["silhouettes"].get("method", "–")),
        ("depth maps, dense points", f"{dense.get('references', '–')}, {dense.get('points', '–')}"),
    ]
    parts.append("<h3>Measured on the way</h3>" + table(facts))
    versions = data.manifest.get("versions") or {}
    options = data.manifest.get("options") or {}
    if versions:
        parts.append(f"<p class='soft'>{text(', '.join(f'{k} {v}' for k, v in versions.items()))}</p>")
    if options:
        parts.append(
            f"<p class='soft'>options: {text(', '.join(f'{k}={v}' for k, v in options.items() if v not in (None, '')))}</p>"
        )
    return "".join(parts)
