"""Reading a CAD mesh: STL, OBJ, PLY, GLB, OFF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massprops.errors import InputError

if TYPE_CHECKING:
    import trimesh

LARGEST_BYTES = 2_000_000_000


def read_mesh(path: str | Path, process: bool = True) -> trimesh.Trimesh:
    """One mesh of a file; the parts of a scene are joined.

    Args:
        path: the file.
        process: join equal vertices, as formats without shared ones need.

    Raises:
        InputError: no such file, not a mesh, or no faces.
    """
    import trimesh

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give a mesh as STL, OBJ, PLY, GLB or OFF")
    if path.stat().st_size > LARGEST_BYTES:
        raise InputError(f"{path}: {path.stat().st_size / 1e9:.1f} GB is too large; reduce the mesh first")
    try:
        mesh = trimesh.load(path, force="mesh", process=process)
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path}: not a mesh that can be read ({reason}); give STL, OBJ, PLY, GLB or OFF") from None
    if not hasattr(mesh, "faces") or len(mesh.faces) == 0:
        raise InputError(f"{path}: has no faces; give a surface, not a point cloud")
    if not np.isfinite(mesh.vertices).all():
        raise InputError(f"{path}: has coordinates that are not finite; export it again")
    return mesh


def read_solid(path: str | Path) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """A closed mesh with outward faces, and what had to be repaired.

    Raises:
        InputError: as `read_mesh`, or not closed and not to be closed honestly.
    """
    from massprops.mass.repair import repair

    mesh = read_mesh(path)
    try:
        return repair(mesh)
    except InputError as error:
        raise InputError(f"{path}: not watertight: {error}") from None


UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
"""Metres per unit of a CAD file."""


def in_metres(
    mesh: trimesh.Trimesh, unit: str = "auto", expected_length: float | None = None
) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """The mesh with its coordinates in metres, and what was assumed of them.

    STL, OBJ, PLY and OFF carry no unit. `auto` takes metres, unless the body then is as many times longer than
    `expected_length` (greatest length in metres, from a run with a scale) as a metre is than another unit, to 15 %.

    Raises:
        InputError: an unknown unit.
    """
    from massprops.mass.integrals import greatest_length

    notes: tuple[str, ...] = ()
    if unit not in (*UNITS, "auto"):
        raise InputError(f"--cad-unit {unit}: give auto, {', '.join(UNITS)}")
    if unit == "auto":
        unit = "m"
        ratio = greatest_length(np.asarray(mesh.vertices))[0] / expected_length if expected_length else 1.0
        for name, size in UNITS.items():
            if name != "m" and abs(np.log(ratio * size)) < 0.14:
                unit = name
                notes = (
                    f"CAD is {ratio:.4g} times longer than the run: taken to be in {name}; --cad-unit says otherwise",
                )
        if unit == "m" and abs(np.log(ratio)) > 0.25:
            notes = (
                f"CAD is {ratio:.3g} times longer than the run: check the run's scale and --cad-unit, or use --free-scale",
            )
    if UNITS[unit] == 1.0:
        return mesh, notes
    mesh = mesh.copy()
    mesh.apply_scale(UNITS[unit])
    return mesh, notes
