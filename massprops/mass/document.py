"""`massprops.json`: the mass properties as the document that users and other programs read."""

from __future__ import annotations

from massprops.mass.properties import MassProperties

FRAME = (
    "axes and origin of the structure from motion, fixed in the body (tumbling) or to its support (static); "
    "mesh, cloud, cameras and centre of mass share them; inertia about the centre of mass in these axes"
)


def document(
    properties: MassProperties,
    interval_90: dict[str, list],
    scale: dict,
    surface: dict,
    warnings: list[str],
    frame: str = FRAME,
) -> dict:
    """The content of `massprops.json`, less `images`.

    Args:
        properties: in final units.
        interval_90: of `massprops.mass.intervals.intervals`.
        scale: `source`, `metres_per_unit` (None when there is none), `relative_sigma`.
        surface: `watertight`, `area`, `observed_fraction`.
        warnings: one sentence each.
        frame: what the axes are.
    """
    metric = scale.get("metres_per_unit") is not None and scale.get("source") != "none"
    return {
        "format": "massprops/1",
        "units": {"length": "m", "mass": "kg"} if metric else {"length": "model", "mass": "model"},
        "density": properties.density,
        "volume": properties.volume,
        "mass": properties.mass,
        "center_of_mass": properties.center_of_mass.tolist(),
        "inertia": properties.inertia.tolist(),
        "principal_moments": properties.principal_moments.tolist(),
        "principal_axes": properties.principal_axes.tolist(),
        "inertia_ratios": {"k1": properties.k1, "k2": properties.k2},
        "interval_90": interval_90,
        "scale": {k: scale.get(k) for k in ("source", "metres_per_unit", "relative_sigma")},
        "surface": surface,
        "frame": frame,
        "warnings": list(warnings),
    }
