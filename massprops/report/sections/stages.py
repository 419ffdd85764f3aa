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
    focal, sigma, error = (sfm.get(k) for k in ("focal_px", "focal_sigma_relative", "reprojection_error_px"))
    given, used, placed = footage.get("given"), footage.get("used"), sfm.get("registered", "–")
    points, observed = dense.get("points"), surface.get("observed_fraction")
    around = f" ± {number(100 * sigma, 2)} %" if sigma else ""
    rows = [
        ("frames given / used / placed", f"{given} / {used} / {placed}" if given else None),
        ("models found", models),
        ("mean reprojection error", None if error is None else f"{number(error, 3)} px"),
        ("focal length", f"{number(focal, 6)} px{around}" if isinstance(focal, int | float) else None),
        *_cameras(sfm.get("cameras") or []),
        ("lens", sfm.get("lens")),
        ("shutter", (sfm.get("shutter") or {}).get("said")),
        ("method of the silhouettes", silhouettes.get("method")),
        ("depth maps", dense.get("references")),
        ("dense points", f"{points:,}".replace(",", " ") if isinstance(points, int) else None),
        ("surface measured", None if observed is None else f"{100 * observed:.1f} % of its area"),
    ]
    return [(name, str(value)) for name, value in rows if value not in (None, "")]


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
