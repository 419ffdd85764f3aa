"""Reading a CAD mesh: STL, OBJ, PLY, GLB, OFF."""

from __future__ import annotations

import contextlib
import logging
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massprops.documents.loading import excerpt
from massprops.errors import InputError
from massprops.memory import refuse_beyond

if TYPE_CHECKING:
    import trimesh

LARGEST_BYTES = 2_000_000_000
KINDS = (".stl", ".obj", ".ply", ".glb", ".off")
BYTES_PER_BYTE = 40
"""Memory that trimesh takes at most for a byte of a file, measured on a sphere of 82 000 faces: 35 for PLY, 33 for GLB,
19 for OFF, 16 for OBJ, 13 for STL."""


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
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise InputError(
            f"{path}: {excerpt(kind) or 'no ending'} is no mesh that is read; give STL, OBJ, PLY, GLB or OFF"
        )
    refuse_beyond(BYTES_PER_BYTE * path.stat().st_size, f"{path}: its mesh", "reduce the mesh first")
    _refuse_hollow_header(path)
    try:
        with _without_warnings():
            mesh = trimesh.load(path, force="mesh", process=process)
    except (Exception, SystemExit) as error:
        reason = excerpt(error, 80) if str(error) else type(error).__name__
        raise InputError(f"{path}: not a mesh that can be read ({reason}); give STL, OBJ, PLY, GLB or OFF") from None
    if not hasattr(mesh, "faces") or len(mesh.faces) == 0:
        raise InputError(f"{path}: has no faces; give a surface, not a point cloud")
    if np.shape(mesh.vertices)[1:] != (3,):
        raise InputError(f"{path}: has corners without three coordinates; export it again")
    if not np.isfinite(mesh.vertices).all():
        raise InputError(f"{path}: has coordinates that are not finite; export it again")
    if np.asarray(mesh.faces).min() < 0 or np.asarray(mesh.faces).max() >= len(mesh.vertices):
        raise InputError(f"{path}: has faces with corners that the file does not hold; export it again")
    return mesh


@contextlib.contextmanager
def _without_warnings() -> Iterator[None]:
    """Silences trimesh's log, which shows tracebacks of failed attempts, and numpy's warnings."""
    log = logging.getLogger("trimesh")
    before = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(before)


def _refuse_hollow_header(path: Path) -> None:
    """PLY and OFF say how many corners and faces follow; memory is taken for them before they are read."""
    if path.suffix.lower() not in (".ply", ".off"):
        return
    with path.open("rb") as file:
        head = file.read(4000)
    counts = re.findall(rb"element\s+\w+\s+(\d+)", head.split(b"end_header")[0])
    if path.suffix.lower() == ".off":
        lines = [line for line in head.splitlines() if line.strip() and not line.startswith(b"#")]
        counts = re.findall(rb"\d+", b" ".join(lines[:2]))[:2]
    # the shortest entry of either format takes two bytes
    most = max((int(n[:20]) for n in counts), default=0)
    if most > path.stat().st_size:
        raise InputError(f"{path}: its header announces {most:.3g} entries, more than its bytes hold: export it again")


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
        raise InputError(f"{path}: {error}") from None


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
