"""What came out, in one look; what stopped the run; what to be wary of."""

from __future__ import annotations

from typing import Any

from massprops.report.data import RunData
from massprops.report.html import between, number, text

TITLE, ORDER = "Summary", 0


def render(data: RunData) -> str:
    """Confidence and its reasons, verdict, warnings, headline numbers, the scale in words."""
    parts = [_confidence(data), _verdict(data)]
    warnings = list(dict.fromkeys([*data.document.get("warnings", []), *_stage_warnings(data)]))
    if data.changed:
        warnings.append(f"left out, since it is not what was written there: {', '.join(data.changed)}")
    parts += [f'<div class="warning">{text(w)}</div>' for w in warnings]
    if data.document:
        parts.append(_tiles(data))
        parts.append(f"<p>{scale_in_words(data)}</p>")
    return "".join(parts)


def scale_in_words(data: RunData) -> str:
    """Where metres come from, and how well they are known."""
    scale = data.document.get("scale") or {}
    source, sigma = scale.get("source", "none"), scale.get("relative_sigma")
    if not data.metric:
        return (
            "<b>No scale was given.</b> Lengths are in model units (one unit is the object's greatest length), and only "
            "ratios are claimed: k1, k2, the principal axes and the shape. For metres, run again with <code>--scale</code>, "
            "<code>--distance</code> or <code>--marker</code>, or with a stereo baseline."
        )
    names = {
        "given": "the length that was given",
        "baseline": "the stereo baseline",
        "range": "the range sensor",
        "distance": "a known distance between two points",
        "marker": "a marker of known size",
    }
    known = names.get(str(source), str(source))
    if not sigma:
        return f"<b>Metres</b> come from {text(known)}, taken as exact: the intervals hold no error of scale."
    return (
        f"<b>Metres</b> come from {text(known)}, one sigma {number(100 * sigma, 2)} %. It counts three times in the volume "
        "and five times in the inertia, and not at all in k1 and k2."
    )


BOXES = {"high": "done", "medium": "warning", "low": "stopped"}


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


def _verdict(data: RunData) -> str:
    if data.verdict.get("exit_code"):
        stage = data.verdict.get("stage")
        where = f" in stage <b>{text(stage)}</b>" if stage else ""
        return (
            f'<div class="stopped"><b>Done in part.</b> The run stopped{where}: {text(data.verdict.get("reason", ""))}. '
            "What was computed before is below.</div>"
        )
    images = data.document.get("images") or {}
    if images.get("given"):
        said = (
            f"{images.get('registered')} of {images.get('used')} frames placed, out of {images.get('given')} given."
            if images.get("registered") is not None
            else f"{images.get('used')} of {images.get('given')} frames used."
        )
        return f'<div class="done"><b>Done.</b> {text(said)}</div>'
    return '<div class="done"><b>Done.</b> From a finished mesh.</div>' if data.document else ""


def _tiles(data: RunData) -> str:
    d: dict[str, Any] = data.document
    interval = d.get("interval_90") or {}
    observed = (d.get("surface") or {}).get("observed_fraction")
    length = data.length_unit
    tiles = [
        ("Volume", f"{number(d['volume'], 4)} {length}³", _bounds(interval, "volume")),
        ("Mass", f"{number(d['mass'], 4)} {data.mass_unit}", f"at {d['density']:g} kg/m³" if data.metric else ""),
        ("k1 = ln(I1/I2)", number(d["inertia_ratios"]["k1"], 4), _bounds(interval, "k1")),
        ("k2 = ln(I2/I3)", number(d["inertia_ratios"]["k2"], 4), _bounds(interval, "k2")),
    ]
    if observed is not None:
        tiles.append(
            ("Surface measured", f"{100 * observed:.0f} %", "the rest is filled in" if observed < 0.995 else "")
        )
    return '<div class="tiles">{}</div>'.format(
        "".join(
            f'<div class="tile"><span>{text(name)}</span><div class="big">{text(value)}</div><span>{text(note)}</span></div>'
            for name, value, note in tiles
        )
    )


def _bounds(interval: dict[str, Any], key: str) -> str:
    return f"90 %: {between(interval[key], 4)}" if interval.get(key) else "no interval"


def _stage_warnings(data: RunData) -> list[str]:
    stages = data.manifest.get("stages") or {}
    return [w for entry in stages.values() if isinstance(entry, dict) for w in (entry.get("warnings") or [])]
