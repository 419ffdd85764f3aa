"""Every quantity with its 90 % interval, its unit, and what it means."""

from __future__ import annotations

from massprops.report.data import RunData
from massprops.report.html import between, number, table, text

TITLE, ORDER = "Mass properties", 2


def render(data: RunData) -> str:
    """Tables of scalars, tensor and axes."""
    d = data.document
    if not d:
        return ""
    length, mass = data.length_unit, data.mass_unit
    interval = d.get("interval_90", {})
    rows = [
        ("volume", number(d["volume"]), between(interval.get("volume")), f"{length}³", "what the closed surface holds"),
        (
            "mass",
            number(d["mass"]),
            between(interval.get("mass")),
            mass,
            f"volume at {number(d['density'])} kg/m³ throughout",
        ),
    ]
    centre = interval.get("center_of_mass") or [None] * 3
    for axis, value, bounds in zip("xyz", d["center_of_mass"], centre, strict=True):
        rows.append((f"centre of mass {axis}", number(value), between(bounds), length, "in the mesh's axes"))
    for i, value in enumerate(d["principal_moments"]):
        bounds = (interval.get("principal_moments") or [None] * 3)[i]
        rows.append(
            (
                f"I{i + 1}",
                number(value),
                between(bounds),
                f"{mass} {length}²",
                "principal moment about the centre of mass",
            )
        )
    for k, meaning in (("k1", "ln(I1/I2): free of scale and density"), ("k2", "ln(I2/I3): free of scale and density")):
        rows.append((k, number(d["inertia_ratios"][k]), between(interval.get(k)), "", meaning))
    scale = d.get("scale", {})
    source = scale.get("source", "none")
    said = (
        "no scale"
        if source == "none"
        else f"scale from {source}, one sigma {100 * (scale.get('relative_sigma') or 0):.2g} %"
    )
    tensor = table([[number(value, 6) for value in row] for row in d["inertia"]], numeric_from=0)
    axes = table(
        [[number(v, 4) for v in row] for row in d["principal_axes"]], ("axis of I1", "I2", "I3"), numeric_from=0
    )
    return (
        table(rows, ("quantity", "value", "90 % interval", "unit", "meaning"), 1)
        + f'<div class="two"><div><h3>Inertia tensor [{text(mass)} {text(length)}²]</h3>{tensor}'
        + "<p class='soft'>About the centre of mass, mesh axes, products as tensor elements (I_xy = −∫ x y dm).</p></div>"
        + f"<div><h3>Principal axes (columns)</h3>{axes}<p class='soft'>Of columns 1 and 3 the largest component is positive; "
        + "column 2 = column 3 × column 1.</p></div></div>"
        + f"<p class='soft'>{text(said)}. {text(d.get('frame', ''))}</p>"
    )
