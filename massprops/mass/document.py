"""`massprops.json`: the mass properties as the document that users and other programs read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from massprops.documents.fields import as_written, read
from massprops.documents.loading import load_json
from massprops.documents.massprops_json import FORMAT, MassFile, RecommendedFile
from massprops.dynamics.inertia import is_physical
from massprops.errors import InputError
from massprops.mass.properties import MassProperties
from massprops.mass.recommended import by_mesh

FRAME = (
    "axes and origin of the structure from motion, fixed in the body (tumbling) or to its support (static); "
    "mesh, cloud, cameras and centre of mass share them; inertia about the centre of mass in these axes"
)

METRES_FROM = {
    "given": "the length that was given",
    "baseline": "the stereo baseline",
    "range": "the range sensor",
    "distance": "a known distance between two points",
    "marker": "a marker of known size",
}
"""Sources of a scale, in words."""


def document(
    properties: MassProperties,
    interval_90: dict[str, list[Any]],
    scale: dict[str, Any],
    surface: dict[str, Any],
    warnings: list[str],
    frame: str = FRAME,
    density_assumed: bool = False,
) -> dict[str, Any]:
    """The content of `massprops.json`, less `images`.

    Args:
        properties: in final units.
        interval_90: of `massprops.mass.intervals.intervals`.
        scale: `source`, `metres_per_unit` (None when there is none), `relative_sigma`.
        surface: `watertight`, `area`, `observed_fraction`.
        warnings: one sentence each.
        frame: what the axes are.
        density_assumed: whether nobody gave the density.
    """
    metric = scale.get("metres_per_unit") is not None and scale.get("source") != "none"
    content = {
        "format": FORMAT,
        "units": {"length": "m", "mass": "kg"} if metric else {"length": "model", "mass": "model"},
        "density": properties.density,
        "density_assumed": density_assumed,
        **properties.values(),
        "interval_90": interval_90,
        "scale": {k: scale.get(k) for k in ("source", "metres_per_unit", "relative_sigma")},
        "surface": surface,
        "frame": frame,
        "warnings": list(warnings),
    }
    content["recommended"] = by_mesh(content)
    return as_written(MassFile, content, "massprops.json")


def read_document(path: Path) -> dict[str, Any]:
    """`massprops.json`, every number of it checked.

    Raises:
        InputError: no such file, damaged, or mass properties that no body has.
    """
    content = load_json(path)
    try:
        mass_file = read(MassFile, content, str(path))
    except InputError as error:
        raise InputError(f"{error}: make the run again") from None
    for body in (mass_file, mass_file.recommended):
        if body is not None and (wrong := _impossible(body)):
            raise InputError(f"{path}: {wrong}: make the run again")
    # what holds for any body of one density, where the file leaves it out
    content = {**_in_rows(content, mass_file), "density": mass_file.density or mass_file.mass / mass_file.volume}
    if mass_file.recommended is not None:
        content["recommended"] = _in_rows(content["recommended"], mass_file.recommended)
    return content


def _in_rows(content: dict[str, Any], body: MassFile | RecommendedFile) -> dict[str, Any]:
    """The content with its arrays as lists of rows, in whatever form the file had them."""
    keys = ("center_of_mass", "inertia", "principal_moments", "principal_axes")
    return {**content, **{key: getattr(body, key).tolist() for key in keys}}


def _impossible(body: MassFile | RecommendedFile) -> str:
    """Why no body has these values; empty where one may."""
    inertia, axes = body.inertia, body.principal_axes
    if not np.allclose(inertia, inertia.T, rtol=1e-9, atol=1e-12 * float(np.abs(inertia).max())):
        return "inertia is not symmetric"
    moments = np.linalg.eigvalsh(inertia)
    if not is_physical(moments):
        listed_moments = ", ".join(f"{m:.4g}" for m in moments)
        return f"principal moments {listed_moments} break the triangle inequality, so no body has them"
    return (
        ""
        if np.allclose(axes.T @ axes, np.eye(3), atol=1e-6)
        else "principal_axes are not unit vectors at right angles"
    )
