"""What came out, in one look; what stopped the run; what to be wary of."""

from __future__ import annotations

from massprops.report.data import RunData
from massprops.report.html import number, text

TITLE, ORDER = "Summary", 0


def render(data: RunData) -> str:
    """Verdict, four headline numbers, warnings."""
    parts = []
    if data.verdict.get("exit_code"):
        parts.append(f'<div class="stopped">Not finished: {text(data.verdict.get("reason", ""))}</div>')
    d = data.document
    if d:
        observed = (d.get("surface") or {}).get("observed_fraction")
        tiles = [
            ("Volume", f"{number(d['volume'])} {data.length_unit}³", _spread(d, "volume")),
            ("Mass", f"{number(d['mass'])} {data.mass_unit}", f"at {number(d['density'])} kg/m³"),
            ("k1 = ln(I1/I2)", number(d["inertia_ratios"]["k1"], 4), _range(d, "k1")),
            ("k2 = ln(I2/I3)", number(d["inertia_ratios"]["k2"], 4), _range(d, "k2")),
            (
                "Surface measured",
                "–" if observed is None else f"{100 * observed:.0f} %",
                "the rest is filled in, red below",
            ),
        ]
        body = "".join(
            f'<div class="tile"><span>{text(name)}</span><div class="big">{text(value)}</div><span>{text(note)}</span></div>'
            for name, value, note in tiles
        )
        parts.append(f'<div class="tiles">{body}</div>')
        if not data.metric:
            parts.append(
                "<p>No scale was given: lengths are in model units (one unit is the object's greatest length), and only "
                "ratios are claimed. Give <code>--scale</code>, <code>--distance</code> or <code>--marker</code> for metres.</p>"
            )
    warnings = list(dict.fromkeys([*d.get("warnings", []), *_stage_warnings(data)]))
    parts += [f'<div class="warning">{text(w)}</div>' for w in warnings]
    return "".join(parts)


def _stage_warnings(data: RunData) -> list[str]:
    stages = data.manifest.get("stages") or {}
    return [w for entry in stages.values() for w in (entry.get("warnings") or [])]


def _spread(d: dict, key: str) -> str:
    bounds = d.get("interval_90", {}).get(key)
    return f"−{100 * (1 - bounds[0] / d[key]):.1f} / +{100 * (bounds[1] / d[key] - 1):.1f} % (90 %)" if bounds else ""


def _range(d: dict, key: str) -> str:
    bounds = d.get("interval_90", {}).get(key)
    return f"{number(bounds[0], 3)} … {number(bounds[1], 3)} (90 %)" if bounds else ""
