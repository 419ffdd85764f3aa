"""A scenario: which body, how it moves, how it is seen. A small YAML file, a name of ours, or a user's mesh."""

from __future__ import annotations

import os
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from massprops.documents.fields import Listed, Number, Text, YesNo, document, read
from massprops.documents.loading import load_yaml
from massprops.errors import InputError

ANY = Number("", "", -1e6, 1e6)
MESHES = {".stl", ".obj", ".ply", ".glb", ".off"}


@document()
class Scenario:
    """What is simulated with images. Lengths in metres, angles in degrees, images in pixels."""

    mesh: Annotated[str, Text("file of the body's closed mesh, beside this file or one of ours", longest=4000)] = ""
    motion: Annotated[str, Text("torque-free, camera still; or camera walks round", ("tumbling", "static"))] = (
        "tumbling"
    )
    frames: Annotated[int, Number("number of images", "", 2, 5000, whole=True)] = 110
    size: Annotated[tuple[int, int], Listed("width, height", Number("", "px", 32, 8192, whole=True), count=2)] = (
        960,
        720,
    )
    rate_hz: Annotated[float, Number("images a second", "Hz", 1e-3, 1e4)] = 10.0
    rate_deg: Annotated[float, Number("rotation of the body per image", "deg", 0, 60)] = 5.0
    spin: (
        Annotated[
            tuple[float, float, float],
            Listed(
                "angular velocity in principal axes, any length; drawn near the middle axis when `null`", ANY, count=3
            ),
        ]
        | None
    ) = None
    fill: Annotated[float, Number("greatest length of the body over the image's height", "", 0.02, 3)] = 0.85
    focal: Annotated[float, Number("focal length over the image's width", "", 0.3, 20)] = 1.6
    distortion: Annotated[tuple[float, float], Listed("radial k1, k2", ANY, count=2)] = (0.0, 0.0)
    sun_phase_deg: Annotated[float, Number("angle at the body between camera and Sun", "deg", 0, 150)] = 35.0
    background: Annotated[str, Text("behind the body", ("black", "still"))] = "black"
    ambient: Annotated[float, Number("share of light without direction", "", 0, 1)] = 0.03
    specular: Annotated[float, Number("strength of the highlight", "", 0, 2)] = 0.15
    albedo: Annotated[float, Number("mean reflectance of the body; the table's is 0.35", "", 0.02, 1)] = 0.55
    texture_m: Annotated[float, Number("size of the largest texture", "m", 1e-6, 1e6)] = 0.5
    grid_m: Annotated[float, Number("spacing of panel lines, 0 for none", "m", 0, 1e6)] = 0.0
    smooth: Annotated[bool, YesNo("shade over edges")] = False
    noise: Annotated[float, Number("1-sigma of the darkest pixels", "grey levels", 0, 60)] = 1.0
    exposure: Annotated[float, Number("grey level of a white face in full sun", "grey levels", 5, 1000)] = 215.0
    stereo_m: Annotated[float, Number("baseline of a second camera to the right, 0 for none", "m", 0, 1e4)] = 0.0
    range_sigma_m: Annotated[float, Number("noise of a range sensor, 0 for none", "m", 0, 1e4)] = 0.0
    hidden_mass: (
        Annotated[
            tuple[float, float, float, float],
            Listed("share of the mass added as a point, and its x, y, z [m]; moves the motion only", ANY, count=4),
        ]
        | None
    ) = None
    density: Annotated[float, Number("density of the body", "kg/m^3", 1e-6, 1e9)] = 1000.0
    seed: Annotated[int, Number("of everything drawn", "", 0, 2**31 - 1, whole=True)] = 0


AUTOMATIC = -1.0
"""`texture_m` that follows the size of a user's mesh."""


def known() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(p.name[:-5] for p in files("massprops.simulation.scenarios").iterdir() if p.name.endswith(".yaml"))


def load_scenario(name: str | Path, **changes: Any) -> Scenario:
    """A scenario by name, YAML file or mesh file, with some of its fields changed.

    Raises:
        InputError: no such scenario, an unknown key, or a value out of range.
    """
    path = Path(name)
    folder = Path(str(files("massprops.simulation") / "meshes"))
    if path.suffix.lower() in MESHES:
        if not path.is_file():
            raise InputError(f"{path}: no such mesh file; give STL, OBJ, PLY, GLB or OFF")
        given: dict[str, Any] = {"mesh": str(path.resolve()), "texture_m": None}
    else:
        if not (path.is_file() and path.suffix.lower() in (".yaml", ".yml")):
            path = Path(str(files("massprops.simulation.scenarios") / f"{name}.yaml"))
            if "/" in str(name) or not path.is_file():
                raise InputError(
                    f"{name}: no such scenario; give one of {', '.join(known())}, a YAML file or a mesh file (STL, OBJ, PLY, GLB, OFF)"
                )
        given = load_yaml(path)
        mesh = given.get("mesh") or ""
        if isinstance(mesh, str):
            beside = path.parent / mesh
            here = os.path.isfile(beside)  # noqa: PTH113  (no error for a name that is too long)
            given["mesh"] = str(beside if Path(mesh).is_absolute() or here else folder / mesh)
    given.update({k: v for k, v in changes.items() if v is not None})
    automatic = given.get("texture_m", 0) is None
    scenario = read(Scenario, {k: v for k, v in given.items() if not (k == "texture_m" and automatic)}, str(name))
    if scenario.spin is not None and not any(scenario.spin):
        raise InputError(
            f"{name}: spin {scenario.spin}: give a direction other than zero, or 'rate_deg: 0' for no rotation"
        )
    if scenario.hidden_mass is not None and not 0 < scenario.hidden_mass[0] < 1:
        raise InputError(
            f"{name}: hidden_mass {scenario.hidden_mass}: give a share between 0 and 1 and a place, SHARE:x,y,z"
        )
    return replace(scenario, texture_m=AUTOMATIC) if automatic else scenario
