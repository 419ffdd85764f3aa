"""Every quantity with its 90 % interval, its unit, and what it means."""

from __future__ import annotations

from collections.abc import Sequence

from massprops.mass.recommended import as_recommended, quantities
from massprops.report.data import RunData
from massprops.report.html import Safe, between, number, table, text
from massprops.report.svg import GRID, box, drawing, line

TITLE, ORDER = "Mass properties", 2


def render(data: RunData) -> str:
    """Tables of scalars, tensor and axes."""
    d = as_recommended(data.document)
    if not d:
        return ""
    length, mass = data.length_unit, data.mass_unit
    inertia_unit = f"{mass} {length}²" if data.metric else "model"
    density = f"Volume at a density of {d['density']:g}{' kg/m³' if data.metric else ''} throughout."
    free = "Independent of scale and density, and visible in free motion."
    told = {
        "volume": (f"{length}³", "Enclosed by the surface."),
        "mass": (mass, density),
        "I1": (inertia_unit, "About the axis that is easiest to turn about."),
        "I2": (inertia_unit, "About the middle axis. Free rotation about it is unstable."),
        "I3": (
            inertia_unit,
            "About the axis that is hardest to turn about. Free rotation that loses energy ends up there.",
        ),
        "k1": ("", f"ln(I1/I2). {free}"),
        "k2": ("", f"ln(I2/I3). {free}"),
    }
    centre = (length, "In the mesh's axes.")
    entries = [(name, *values, *told.get(name, centre)) for name, values in quantities(d).items()]
    absolute = ("k1", "k2", "centre of mass x", "centre of mass y", "centre of mass z")
    rows = [
        (
            Safe(f'{text(name)}<span class="below">{text(meaning)}</span>'),
            Safe(f'<b>{number(value)}</b> {text(unit)}<span class="below">{_interval(bounds)}</span>'),
            Safe("" if name in absolute else bar(value, bounds)),
        )
        for name, value, bounds, unit, meaning in entries
    ]
    tensor = table(
        [[axis, *(number(value, 6) for value in row)] for axis, row in zip("xyz", d["inertia"], strict=True)],
        ("", "x", "y", "z"),
    )
    axes = table(
        [[axis, *(number(v, 4) for v in row)] for axis, row in zip("xyz", d["principal_axes"], strict=True)],
        ("", "axis of I1", "I2", "I3"),
    )
    absent = "" if d.get("interval_90") else "<p>No intervals: the mesh was given, not measured.</p>"
    return (
        f'<div class="props">{table(rows, ("quantity", "value and 90 % interval", "relative, on a ruler of ±10 %"), numeric=(1,))}</div>'
        + absent
        + f'<div class="two"><div><h3>Inertia tensor [{text(inertia_unit)}]</h3>{tensor}'
        + "<p class='soft'>About the centre of mass, in the axes of the mesh. Products are tensor elements: I_xy = −∫ x y dm.</p></div>"
        + f"<div><h3>Principal axes</h3>{axes}<p class='soft'>Unit columns in the axes of the mesh. Signs: the largest component of "
        + "axes 1 and 3 is positive; axis 2 is axis 3 × axis 1.</p></div></div>"
        + (f"<p class='soft'>Frame: {text(d['frame'])}.</p>" if d.get("frame") else "")
    )


def _interval(bounds: Sequence[float] | None) -> str:
    return f"{between(bounds)}" if bounds else ""


def bar(value: float, bounds: Sequence[float] | None) -> str:
    """The interval drawn about the value, on a ruler of ±10 %, with the relative ends as its title."""
    if not bounds or not value:
        return ""
    low, high = (100 * (b / value - 1) for b in sorted(bounds, key=lambda b: b / value))
    at = [60 + 56 * max(-1.0, min(1.0, v / 10)) for v in (low, high)]
    ruler = line(4, 7, 116, 7, GRID) + line(4, 3, 4, 11, GRID) + line(116, 3, 116, 11, GRID)
    parts = (
        f"<title>{low:+.2f} % to {high:+.2f} %, on a ruler of ±10 %</title>{ruler}",
        box(at[0], 4, max(1.5, at[1] - at[0]), 6, 'class="fill"', 2),
        line(60, 1, 60, 13, 'class="mark"'),
    )
    return drawing(
        parts, (120, 14), f"{low:+.1f} to {high:+.1f} %", "bar"
    ) + f'<span class="soft rel">{low:+.1f} / {high:+.1f} %</span>'.replace("-", "−")
