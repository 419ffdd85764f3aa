"""`massprops export`: a run or a mesh into a file that another program reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from massprops.core.files import hash_of, make_folder, write_whole
from massprops.core.outputs import Outputs, deliver
from massprops.errors import InputError
from massprops.exchange.body import Body, identifier, read_body
from massprops.exchange.formats import formats

OWNER = "export"


def export(
    source: str | Path,
    to: str,
    out: str | Path | None = None,
    density: float | None = None,
    mass: float | None = None,
    warn: Callable[[str], None] = lambda text: None,
    force: bool = False,
) -> Path:
    """Writes one export format.

    Args:
        source: run folder or mesh file.
        to: name of a format (`massprops.exchange.formats`).
        out: file to write; by default `<name><suffix>` in the run, or beside the mesh.
        density: [kg/m^3], for a mesh file; None takes that of water, and says so.
        mass: measured mass [kg], in place of density times volume.
        warn: told what had to be repaired in a mesh file.
        force: another file of that name may be replaced; the mesh itself may not.

    Returns:
        the file written; of a format of several files, their folder.

    Raises:
        InputError: unknown format, no mesh, no scale where metres are needed, or an impossible body.
    """
    known = formats()
    if to not in known:
        raise InputError(f"--to {to}: unknown format; one of {', '.join(known)}")
    style = known[to]
    body = read_body(source, density, mass, recommended=True)
    if style.NEEDS_METRES and not body.metric:
        raise InputError(
            f"{source}: lengths are in model units and {to} needs metres: run again with --scale, --distance or --marker"
        )
    if body.run is None:
        for line in body.document["warnings"]:
            warn(line)
    default = (body.run or Path(source).parent) / (body.name + style.SUFFIX)
    path = Path(out) if out is not None else default
    if path.is_dir() and not getattr(style, "FOLDER", False):
        path = path / (body.name + style.SUFFIX)
    meshes = _meshes(body, path.stem) if style.MESHES else {}
    names = {tag: name for tag, (name, _) in meshes.items()}
    contents: dict[str, str | bytes] = dict(meshes.values())
    rendered = style.render(body, names)
    inputs = list(body.files)
    if isinstance(rendered, dict):
        _write_elsewhere(path, rendered, inputs, force)
        return path
    contents[path.name] = rendered
    if body.run is not None and path.parent.is_dir() and path.parent.samefile(body.run):
        key = hash_of([Outputs(body.run).base, to, density, mass])
        keep = [n for n, e in Outputs(body.run).files.items() if e["by"] == OWNER]
        deliver(body.run, OWNER, contents, key, inputs, force, derived=True, keep=keep)
    else:
        _write_elsewhere(path.parent, contents, inputs, force)
    return path


def _write_elsewhere(folder: Path, contents: Mapping[str, str | bytes], inputs: list[Path], force: bool) -> None:
    """Writes files into a user's folder. A file that exists already is accepted only if it is equal, byte for byte.

    Raises:
        InputError: another file is there and `force` is not given, or it is an input, or the folder cannot be written.
    """
    data = {name: text.encode() if isinstance(text, str) else text for name, text in contents.items()}
    try:
        changed = {name: new for name, new in data.items() if not _same(folder / name, new)}
        Outputs(folder).check(OWNER, changed, inputs, force)
        make_folder(folder)
        for name, new in changed.items():
            write_whole(folder / name, new)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}): choose another place with -o") from None


def _same(path: Path, content: bytes) -> bool:
    return path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content


def _meshes(body: Body, stem: str) -> dict[str, tuple[str, bytes]]:
    """`<stem>_visual.stl` and `<stem>_collision.stl`, by what they are for: name and content."""
    from massprops.exchange.collision import collision_mesh

    # control characters and bytes that are no text cannot be written in XML
    stem = stem if stem.isprintable() else identifier(stem)
    kinds = {"visual": collision_mesh(body.mesh, 150_000), "collision": collision_mesh(body.mesh)}
    return {tag: (f"{stem}_{tag}.stl", mesh.export(file_type="stl")) for tag, mesh in kinds.items()}
