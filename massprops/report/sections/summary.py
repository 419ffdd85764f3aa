"""The answer in one look: the object, its mass properties, how far to trust them and why; what stopped the run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from massprops.mass.document import METRES_FROM
from massprops.mass.recommended import as_recommended
from massprops.report.data import RunData
from massprops.report.html import Safe, number, table, text
from massprops.report.scene import read_scene
from massprops.report.viewer import viewer

TITLE, ORDER = "Answer", 0
MOMENTS = ("smallest principal moment", "middle principal moment", "largest principal moment")
RATIOS = {"k1": "ln(I1/I2)", "k2": "ln(I2/I3)"}
BOXES = {"high": "done", "medium": "warning", "low": "stopped"}


def render(data: RunData) -> str:
    """Confidence, cross-check and CAD in a sentence each; the numbers; the object; then warnings."""
    parts = [_stopped(data), _confidence(data), _crosscheck(data), _against_cad(data)]
    numbers = _answer(data) if data.document else ""
    shown = _object(data)
    body = f'<div class="answer"><div>{numbers}</div><div>{shown}</div></div>' if numbers and shown else numbers + shown
    return "".join(parts) + body + _warnings(data)


def _stopped(data: RunData) -> str:
    if not data.verdict.get("exit_code"):
        return ""
    stage = data.verdict.get("stage")
    where = f" in stage <b>{text(stage)}</b>" if stage else ""
    return (
        f'<div class="stopped"><b>Done in part.</b> The run stopped{where}: {text(data.verdict.get("reason", ""))}. '
        "What was computed before that is below.</div>"
    )


def _confidence(data: RunData) -> str:
    """How far to trust the numbers, and why, in one sentence."""
    trust = data.document.get("confidence") or {}
    because = "; ".join(str(reason) for reason in trust.get("because") or [])
    level = str(trust.get("level") or "")
    if not level:
        return ""
    return (
        f'<div class="{BOXES.get(level, "warning")} confidence"><b>Confidence {text(level)}</b>'
        f"{': ' if because else ''}{text(because)}.</div>"
    )


def _crosscheck(data: RunData) -> str:
    verdict, p = data.crosscheck.get("verdict"), data.crosscheck.get("p_value")
    if not verdict or not data.document:
        return ""
    kind = {"consistent": "done", "inconsistent": "stopped"}.get(str(verdict), "neutral")
    chance = f" (p = {number(p, 2)})" if p is not None else ""
    reason = text(data.crosscheck.get("reason") or "")
    return f'<div class="{kind}"><b>Shape against motion: {text(verdict)}</b>{chance}{": " if reason else ""}{reason}.</div>'


def _against_cad(data: RunData) -> str:
    """Deviations of the recommended values, and of the surface."""
    comparison = data.comparison
    rows = (comparison.get("fused") if comparison.get("recommended") == "fused" else None) or comparison.get("rows")
    if not rows:
        return ""
    by = {r["quantity"]: r for r in rows}
    held = [bool(r["holds"]) for r in rows if r.get("holds") is not None]
    parts = [f"{name} {100 * by[name]['relative_error']:+.1f} %" for name in ("volume", "I1", "I2", "I3")]
    parts += [f"{key} {by[key]['error']:+.4f}" for key in ("k1", "k2")]
    distance = comparison.get("distances") or {}
    if distance.get("length"):
        median = distance["ours"]["median"]
        parts.append(f"median distance of the surfaces {number(100 * median / distance['length'], 2)} % of the length")
    kind = "done" if all(held) else "warning"
    holds = f" {sum(held)} of {len(held)} intervals contain the CAD value." if held else ""
    return f'<div class="{kind}"><b>Difference from CAD:</b> {text(", ".join(parts)).replace("-", "−")}.{holds}</div>'


def _answer(data: RunData) -> str:
    d: dict[str, Any] = as_recommended(data.document)
    interval, length, mass = d.get("interval_90") or {}, data.length_unit, data.mass_unit
    inertia = f"{mass} {length}²"
    moments = interval.get("principal_moments") or [None] * 3
    rows = [_row("Volume", d["volume"], f"{length}³", interval.get("volume"))]
    if data.metric:  # without a length neither mass nor moments mean anything
        rows.append(_row("Mass", d["mass"], mass, interval.get("mass"), _density(data)))
    place = len(rows)
    if data.metric:
        rows += [_row(f"I{i + 1}", m, inertia, moments[i], MOMENTS[i]) for i, m in enumerate(d["principal_moments"])]
    rows += [_row(k, d["inertia_ratios"][k], "", interval.get(k), note, relative=False) for k, note in RATIOS.items()]
    centre, wide = ", ".join(number(v, 4) for v in d["center_of_mass"]), interval.get("center_of_mass")
    off = "" if not wide else f"± {number(max(0.5 * (high - low) for low, high in wide), 2)} {length}"
    named = Safe('Centre of mass<span class="below">x, y, z in the axes of the mesh</span>')
    rows.insert(place, (named, Safe(f'<b class="triple">{centre}</b> {text(length)}<span class="below">{off}</span>')))
    block = data.document.get("recommended") or {}
    whose = f'<p class="soft">These values are {text(block["because"])}.</p>' if block.get("because") else ""
    observed = (d.get("surface") or {}).get("observed_fraction")
    seen = "" if observed is None else f"{100 * observed:.0f} % of the surface was measured{_rest(d)}. "
    return (
        table(rows, ("", "value, 90 % interval"), label="the answer")
        + whose
        + f'<p class="soft">{seen}{_images(data)}</p><p class="soft">{scale_in_words(data)}</p>'
    )


def _row(
    name: str, value: float, unit: str, bounds: Sequence[float] | None, note: str = "", relative: bool = True
) -> tuple[object, object]:
    """One quantity; its interval in per cent of it, or from end to end where a share means nothing."""
    shown = "no interval"
    if bounds and relative and value:
        low, high = (100 * (b / value - 1) for b in bounds)
        shown = f"{low:+.1f} … {high:+.1f} %".replace("-", "−")
    elif bounds:
        shown = f"{number(bounds[0], 3)} … {number(bounds[1], 3)}"
    below = f'<span class="below">{text(note)}</span>' if note else ""
    cell = f'<b>{number(value, 4)}</b> <span class="unit">{text(unit)}</span><span class="below">{shown}</span>'
    return Safe(f"{text(name)}{below}"), Safe(cell)


def _density(data: RunData) -> str:
    if not data.metric:
        return ""
    density = f"{data.document['density']:g} kg/m³"
    return (
        f"density assumed: {density} (water)" if data.document.get("density_assumed") else f"at a density of {density}"
    )


def _rest(document: dict[str, Any]) -> str:
    surface = document.get("surface") or {}
    if surface.get("observed_fraction", 1.0) > 0.995:
        return ""
    inferred = surface.get("inferred_fraction") or 0.0
    closed = f", {100 * inferred:.0f} % closed at the support" if inferred > 0.005 else ""
    return f"{closed}, the rest is filled in"


def _images(data: RunData) -> str:
    images = data.document.get("images") or {}
    if not images.get("given"):
        return "From a finished mesh."
    if images.get("registered") is None:
        return f"{images.get('used')} of {images.get('given')} images used."
    return (
        f"{images.get('registered')} of {images.get('used')} images used were placed; {images.get('given')} were given."
    )


def _object(data: RunData) -> str:
    if data.shape is None:
        return ""
    axes, size = data.document.get("principal_axes"), np.ptp(data.shape.vertices, axis=0)
    unit = "m" if data.metric else "model units" if data.document else "arbitrary units"
    return (
        viewer(
            data.shape,
            centre=data.centre if axes else None,
            axes=np.array(axes) if axes else None,
            scene=read_scene(data),
            limit=data.comparison.get("colour_limit"),
        )
        + f'<p class="soft">Size along the axes of the mesh: {" × ".join(number(float(v), 4) for v in size)} {unit}. Drag to '
        + "turn. Drag with Shift, the right button or two fingers to move. Use the wheel or pinch to zoom.</p>"
    )


def scale_in_words(data: RunData) -> str:
    """Where metres come from, and how well they are known."""
    scale = data.document.get("scale") or {}
    source, sigma = scale.get("source", "none"), scale.get("relative_sigma")
    if not data.metric:
        return (
            "<b>No length was given.</b> Lengths are in model units: one unit is the greatest length of the object. Only "
            "ratios are meaningful: k1, k2, the principal axes and the shape. For metres, run again with <code>--scale</code>, "
            "<code>--distance</code> or <code>--marker</code>, or with a stereo baseline."
        )
    known = METRES_FROM.get(str(source), str(source))
    if not sigma:
        return f"<b>Metres</b> come from {text(known)}, which is taken as exact. The intervals contain no error of the scale."
    return (
        f"<b>Metres</b> come from {text(known)} (1-sigma error {number(100 * sigma, 2)} %). That error counts three "
        "times in the volume, five times in the inertia, and not at all in k1 and k2."
    )


def _warnings(data: RunData) -> str:
    warnings = list(dict.fromkeys([*data.document.get("warnings", []), *_stage_warnings(data)]))
    if data.changed:
        warnings.append(f"not shown, because the files were changed after the run: {', '.join(data.changed)}")
    return "".join(f'<div class="warning">{text(w)}</div>' for w in warnings)


def _stage_warnings(data: RunData) -> list[str]:
    stages = data.manifest.get("stages") or {}
    return [w for entry in stages.values() if isinstance(entry, dict) for w in (entry.get("warnings") or [])]
