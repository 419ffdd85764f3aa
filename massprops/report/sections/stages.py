"""How the run went: stages, times, memory, and what each measured."""

from __future__ import annotations

from typing import Any

from massprops.report.data import RunData
from massprops.report.html import Safe, number, table, text

TITLE, ORDER = "How it was made", 9
SOURCES = {"exif": "EXIF says", "given": "given", "alike": "images of the same shape suggest", "start": "start value"}


def render(data: RunData) -> str:
    """Stage table, key facts, inputs, options, versions."""
    parts = [_stages(data.manifest.get("stages") or {})]
    facts = _facts(data)
    if facts:
        parts.append("<h3>Intermediate results</h3>" + table(facts, numeric=()))
    source = (data.manifest.get("inputs") or {}).get("source")
    options = {k: v for k, v in (data.manifest.get("options") or {}).items() if v not in (None, "") and k != "source"}
    versions = data.manifest.get("versions") or {}
    for name, value in (
        ("Input", source or ""),
        ("Options", ", ".join(f"{k} = {v}" for k, v in options.items())),
        ("Versions", ", ".join(f"{k} {v}" for k, v in versions.items())),
    ):
        if value:
            parts.append(f'<p class="soft breaks"><b>{name}</b> {text(value)}</p>')
    return "".join(parts)


def _stages(stages: dict[str, Any]) -> str:
    if not stages:
        return ""
    longest = max((entry.get("seconds") or 0.0 for entry in stages.values()), default=0.0) or 1.0
    rows: list[tuple[object, ...]] = []
    for name, entry in stages.items():
        share = 100 * (entry.get("seconds") or 0.0) / longest
        bar = Safe(f'<span class="time" style="width:{share:.1f}%"></span>')
        state = entry.get("status", "")
        shown = Safe(f'<span class="{"good" if state == "done" else "bad"}">{text(state)}</span>')
        rows.append(
            (name, shown, *(number(entry.get(k), 3) for k in ("seconds", "cpu_seconds", "peak_memory_mb")), bar)
        )
    total = [sum(e.get(k) or 0.0 for e in stages.values()) for k in ("seconds", "cpu_seconds")]
    peak = max((e.get("peak_memory_mb") or 0.0 for e in stages.values()), default=0.0)
    rows.append(("all", "", number(total[0], 4), number(total[1], 4), number(peak, 4), ""))
    return table(rows, ("stage", "state", "seconds", "CPU seconds", "peak MB", ""), numeric=(2, 3, 4))


def _facts(data: RunData) -> list[tuple[str, str]]:
    sfm, dense, footage = data.facts["sfm"], data.facts["dense"], data.facts["footage"]
    surface, silhouettes = data.facts["surface"], data.facts["silhouettes"]
    models = ", ".join(f"{m.get('images')} images, {m.get('points')} points" for m in sfm.get("models") or [])
    focal = sfm.get("focal_px")
    sigma = sfm.get("focal_sigma_relative")
    found = [
        (
            "frames given / used / placed",
            f"{footage.get('given')} / {footage.get('used')} / {sfm.get('registered', '–')}",
        )
        if footage.get("given")
        else None,
        ("models found", models) if models else None,
        ("mean reprojection error", f"{number(sfm['reprojection_error_px'], 3)} px")
        if sfm.get("reprojection_error_px") is not None
        else None,
        ("focal length", f"{number(focal, 6)} px" + (f" ± {number(100 * sigma, 2)} %" if sigma else ""))
        if isinstance(focal, int | float)
        else None,
        *_cameras(sfm.get("cameras") or []),
        ("lens", str(sfm["lens"])) if sfm.get("lens") else None,
        ("shutter", str(sfm["shutter"]["said"])) if (sfm.get("shutter") or {}).get("said") else None,
        ("method of the silhouettes", str(silhouettes["method"])) if silhouettes.get("method") else None,
        ("depth maps", str(dense["references"])) if dense.get("references") is not None else None,
        ("dense points", f"{dense['points']:,}".replace(",", " ")) if isinstance(dense.get("points"), int) else None,
        ("surface measured", f"{100 * surface['observed_fraction']:.1f} % of its area")
        if surface.get("observed_fraction") is not None
        else None,
    ]
    return [row for row in found if row is not None]


def _cameras(cameras: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """One row for each of several cameras or zooms; of one, the focal length says all."""
    rows = []
    for c in cameras if len(cameras) > 1 else ():
        prior, sigma = c.get("focal_prior_px"), c.get("focal_sigma_relative")
        focal = f"{c['focal_px'][0]:.1f} px" + (f" ± {100 * sigma:.2g} %" if sigma else "")
        focal += f" ({SOURCES.get(str(c.get('focal_source')), 'expected')} {prior:.1f})" if prior else ""
        device = f", {c['device']}" if c.get("device") else ""
        rows.append((f"camera {c['id']}{device}", f"{c['images']} of {c['given']} images placed, {focal}"))
    return rows
