"""`massprops export`: a run or a mesh into a file that another program reads."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from massprops.errors import InputError
from massprops.exchange.body import Body, identifier, read_body
from massprops.exchange.formats import formats


def export(
    source: str | Path,
    to: str,
    out: str | Path | None = None,
    density: float = 1000.0,
    mass: float | None = None,
    warn: Callable[[str], None] = lambda text: None,
) -> Path:
    """Writes one export format.

    Args:
        source: run folder or mesh file.
        to: name of a format (`massprops.exchange.formats`).
        out: file to write; by default `<name><suffix>` in the run, or beside the mesh.
        density: [kg/m^3], for a mesh file.
        mass: measured mass [kg], in place of density times volume.
        warn: told what had to be repaired in a mesh file.

    Returns:
        the file written.

    Raises:
        InputError: unknown format, no mesh, no scale where metres are needed, or an impossible body.
    """
    known = formats()
    if to not in known:
        raise InputError(f"--to {to}: unknown format; one of {', '.join(known)}")
    style = known[to]
    body = read_body(source, density, mass)
    if style.NEEDS_METRES and not body.metric:
        raise InputError(
            f"{source}: lengths are in model units and {to} needs metres: run again with --scale, --distance or --marker"
        )
    if body.run is None:
        for line in body.document["warnings"]:
            warn(line)
    default = (body.run or Path(source).parent) / (body.name + style.SUFFIX)
    path = Path(out) if out is not None else default
    if path.is_dir():
        path = path / (body.name + style.SUFFIX)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        meshes = _write_meshes(body, path) if style.MESHES else {}
        write_whole(path, style.render(body, meshes).encode())
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}): choose another place with -o") from None
    return path


def _write_meshes(body: Body, path: Path) -> dict[str, str]:
    """Writes `<stem>_visual.stl` and `<stem>_collision.stl` beside the file; gives their relative names."""
    from massprops.exchange.collision import collision_mesh

    light = collision_mesh(body.mesh)
    names = {}
    for tag, mesh in (("visual", collision_mesh(body.mesh, 150_000)), ("collision", light)):
        # control characters and bytes that are no text cannot be written in XML
        stem = path.stem if path.stem.isprintable() else identifier(path.stem)
        name = f"{stem}_{tag}.stl"
        write_whole(path.parent / name, mesh.export(file_type="stl"))
        names[tag] = name
    return names


def write_whole(path: Path, content: bytes) -> None:
    """Writes to a temporary name in the same folder and renames: never half a file."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
