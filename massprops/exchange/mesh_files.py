"""Reading a CAD mesh: STL, OBJ, PLY, GLB, OFF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massprops.errors import InputError

if TYPE_CHECKING:
    import trimesh

LARGEST_BYTES = 2_000_000_000


def read_mesh(path: str | Path) -> trimesh.Trimesh:
    """One mesh of a file; the parts of a scene are joined.

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
        mesh = trimesh.load(path, force="mesh")
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
