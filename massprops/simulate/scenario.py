"""A scenario: which body, how it moves, how it is seen. A small YAML file, a name of ours, or a user's mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from massprops.errors import InputError

MESHES = {".stl", ".obj", ".ply", ".glb", ".off"}


@dataclass(frozen=True)
class Scenario:
    """What is simulated. Lengths in metres, angles in degrees, images in pixels.

    Attributes:
        mesh: file of the body's closed mesh.
        motion: `tumbling` (torque-free, camera still) or `static` (camera walks round, table below).
        frames: number of images; size: width, height.
        rate_hz: images a second; rate_deg: rotation of the body per image.
        spin: angular velocity in principal axes, any length; drawn near the middle axis when None.
        fill: greatest length of the body over the image's height.
        focal: focal length over the image's width.
        distortion: radial k1, k2.
        sun_phase_deg: angle at the body between camera and Sun; its direction round the line of sight is drawn.
        background: black or still.
        ambient: share of light without direction; specular: strength of the highlight.
        albedo: mean reflectance of the body; the table's is 0.35.
        texture_m: size of the largest texture; grid_m: spacing of panel lines, 0 for none; smooth: shade over edges.
        noise: 1-sigma of the darkest pixels [grey levels]; exposure: grey level of a white face in full sun.
        stereo_m: baseline of a second camera to the right, 0 for none; range_sigma_m: noise of a range sensor, 0 for none.
        hidden_mass: share of the body's mass added as a point, and its place: (share, x, y, z); moves the motion only.
        density: [kg/m^3]; seed: of everything drawn.
    """

    mesh: str = ""
    motion: str = "tumbling"
    frames: int = 110
    size: tuple[int, int] = (960, 720)
    rate_hz: float = 10.0
    rate_deg: float = 5.0
    spin: tuple[float, float, float] | None = None
    fill: float = 0.85
    focal: float = 1.6
    distortion: tuple[float, float] = (0.0, 0.0)
    sun_phase_deg: float = 35.0
    background: str = "black"
    ambient: float = 0.03
    specular: float = 0.15
    albedo: float = 0.55
    texture_m: float = 0.5
    grid_m: float = 0.0
    smooth: bool = False
    noise: float = 1.0
    exposure: float = 215.0
    stereo_m: float = 0.0
    range_sigma_m: float = 0.0
    hidden_mass: tuple[float, float, float, float] | None = None
    density: float = 1000.0
    seed: int = 0


RANGES: dict[str, tuple[float, float]] = {
    "frames": (2, 5000),
    "rate_hz": (1e-3, 1e4),
    "rate_deg": (0.0, 60.0),
    "fill": (0.02, 3.0),
    "focal": (0.3, 20.0),
    "sun_phase_deg": (0.0, 150.0),
    "ambient": (0.0, 1.0),
    "specular": (0.0, 2.0),
    "albedo": (0.02, 1.0),
    "texture_m": (1e-6, 1e6),
    "grid_m": (0.0, 1e6),
    "noise": (0.0, 60.0),
    "exposure": (5.0, 1000.0),
    "stereo_m": (0.0, 1e4),
    "range_sigma_m": (0.0, 1e4),
    "density": (1e-6, 1e9),
    "seed": (0, 2**31 - 1),
}


def known() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(p.name[:-5] for p in files("massprops.simulate.scenarios").iterdir() if p.name.endswith(".yaml"))


def load_scenario(name: str | Path, **changes: Any) -> Scenario:
    """A scenario by name, YAML file or mesh file, with some of its fields changed.

    Raises:
        InputError: no such scenario, an unknown key, or a value out of range.
    """
    path = Path(name)
    folder = Path(str(files("massprops.simulate") / "meshes"))
    if path.suffix.lower() in MESHES:
        if not path.is_file():
            raise InputError(f"{path}: no such mesh file; give STL, OBJ, PLY, GLB or OFF")
        given: dict[str, Any] = {"mesh": str(path.resolve()), "texture_m": None}
    else:
        if not (path.is_file() and path.suffix.lower() in (".yaml", ".yml")):
            path = Path(str(files("massprops.simulate.scenarios") / f"{name}.yaml"))
            if "/" in str(name) or not path.is_file():
                raise InputError(
                    f"{name}: no such scenario; give one of {', '.join(known())}, a YAML file or a mesh file (STL, OBJ, PLY, GLB, OFF)"
                )
        from massprops.sequence.read import load_yaml

        given = load_yaml(path)
        mesh = Path(str(given.get("mesh", "")))
        beside = (
            mesh if mesh.is_absolute() else (path.parent / mesh if (path.parent / mesh).is_file() else folder / mesh)
        )
        given["mesh"] = str(beside)
    given.update({k: v for k, v in changes.items() if v is not None})
    names = {f.name for f in fields(Scenario)}
    for key in given:
        if key not in names:
            raise InputError(f"{name}: scenario key {key!r} is not known; there are {', '.join(sorted(names))}")
    for key in ("size", "spin", "distortion", "hidden_mass"):
        if given.get(key) is not None:
            given[key] = tuple(given[key])
    automatic = given.get("texture_m", 0) is None
    try:
        scenario = Scenario(**{k: v for k, v in given.items() if not (k == "texture_m" and automatic)})
        _check(name, scenario)
    except TypeError as error:
        raise InputError(f"{name}: a value of the scenario has the wrong kind ({error})") from None
    return replace(scenario, texture_m=-1.0) if automatic else scenario


VECTORS = {"spin": 3, "distortion": 2, "hidden_mass": 4}
"""Fields that hold several numbers, and how many."""


def _check(name: str | Path, s: Scenario) -> None:
    for key, (low, high) in RANGES.items():
        value = getattr(s, key)
        if isinstance(value, bool) or not low <= value <= high:
            raise InputError(f"{name}: {key} {value}: give a value from {low:g} to {high:g}")
    for key in ("frames", "seed"):
        if not isinstance(getattr(s, key), int):
            raise InputError(f"{name}: {key} {getattr(s, key)}: give a whole number")
    for key, count in VECTORS.items():
        values = getattr(s, key)
        if values is not None and not (len(values) == count and all(math.isfinite(v) for v in values)):
            raise InputError(f"{name}: {key} {values}: give {count} finite numbers")
    if s.spin is not None and not any(s.spin):
        raise InputError(f"{name}: spin {s.spin}: give a direction other than zero, or 'rate_deg: 0' for no rotation")
    if s.motion not in ("tumbling", "static"):
        raise InputError(f"{name}: motion {s.motion!r}: give tumbling or static")
    if s.background not in ("black", "still"):
        raise InputError(f"{name}: background {s.background!r}: give black or still")
    if len(s.size) != 2 or not all(isinstance(v, int) and 32 <= v <= 8192 for v in s.size):
        raise InputError(f"{name}: size {s.size}: give width and height from 32 to 8192 pixels")
    if s.hidden_mass is not None and not 0 < s.hidden_mass[0] < 1:
        raise InputError(f"{name}: hidden mass {s.hidden_mass}: give a share between 0 and 1 and a place, SHARE:x,y,z")
