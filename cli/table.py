"""Mass properties as a table for the terminal: the recommended values, and whose they are."""

from __future__ import annotations

from typing import Any

from massprops.core.text import table
from massprops.mass.document import METRES_FROM
from massprops.mass.recommended import as_recommended, quantities


def mass_table(document: dict[str, Any]) -> str:
    """How far to trust it, then a few lines: value, 90 % interval and unit of every quantity that the run claims."""
    document = as_recommended(document)
    metric = document["units"]["length"] == "m"
    length = "m" if metric else "unit"
    trust = document.get("confidence") or {}
    above = [f"confidence {trust['level']}: {'; '.join(trust['because'])}"] if trust else []
    block = document.get("recommended") or {}
    if block.get("source") == "fused":
        above.append(f"values {block['because']}")
    titles = {"k1": "k1 = ln(I1/I2)", "k2": "k2 = ln(I2/I3)"} | {f"I{i}": f"principal moment I{i}" for i in (1, 2, 3)}
    units = {"volume": f"{length}^3", "mass": "kg", "k1": "", "k2": "", "I1": "kg m^2", "I2": "kg m^2", "I3": "kg m^2"}
    rows = []
    for name, (value, bounds) in quantities(document).items():
        if metric or name not in ("mass", "I1", "I2", "I3"):  # without a length neither mass nor moments mean anything
            ends = f"[{bounds[0]:.5g}, {bounds[1]:.5g}]" if bounds else ""
            rows.append([titles.get(name, name), f"{value:.6g}", ends, units.get(name, length)])
    surface, scale = document["surface"], document["scale"]
    rows.append(["measured surface", f"{100 * (surface.get('observed_fraction') or 0):.1f} %"])
    if surface.get("inferred_fraction"):
        rows.append(["closed at the support", f"{100 * surface['inferred_fraction']:.1f} %"])
    assumed = "  (assumed: water; give --density)" if document.get("density_assumed") else ""
    if metric:
        rows.append(["density", f"{document['density']:.6g}", "", f"kg/m^3{assumed}"])
        sigma = scale.get("relative_sigma") or 0.0
        error = f"1-sigma error {100 * sigma:.2g} %" if sigma else "taken as exact; --scale-sigma widens the intervals"
        below = f"metres from {METRES_FROM.get(scale['source'], scale['source'])}: {error}"
    else:
        below = (
            "no length given: values in model units (1 unit = the object's greatest length); only ratios are meaningful"
        )
    return "\n".join([*above, *table(("", "value", "90 % interval", "unit"), rows, left=(0, 2, 3)), f"  {below}"])
