"""What a user may give in place of a file, as the file or the arrays that the package works on."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from massprops.errors import InputError

if TYPE_CHECKING:
    import numpy as np


def as_path(source: Any) -> Any:
    """A path of what has one (text, a path, a run, a simulation); anything else as it is."""
    if isinstance(source, str | os.PathLike):
        return Path(source)
    folder = getattr(source, "folder", None)
    return Path(folder) if folder is not None and not _is_sequence(source) else source


def _is_sequence(source: Any) -> bool:
    return hasattr(source, "tracks") and hasattr(source, "cameras")


@contextmanager
def mesh_file(source: Any) -> Iterator[Path]:
    """A file of a mesh in memory while it is read; a path is given back as it is.

    Args:
        source: path, run, `trimesh.Trimesh`, or anything with a `mesh` (in metres).

    Raises:
        InputError: it is none of these.
    """
    path = as_path(source)
    if isinstance(path, Path):
        yield path
        return
    mesh = source if hasattr(source, "faces") else getattr(source, "mesh", None)
    if mesh is None or not hasattr(mesh, "export"):
        raise InputError(f"{type(source).__name__}: give a run folder, a mesh file, or a trimesh.Trimesh")
    with tempfile.TemporaryDirectory(prefix="massprops-") as spare:
        file = Path(spare) / "body.ply"
        mesh.export(file)
        yield file


@contextmanager
def footage(source: Any, rate_hz: float) -> Iterator[Any]:
    """The source of a reconstruction: frames in memory become a video without loss, for as long as they are read.

    Args:
        source: paths, or frames (n, h, w) grey or (n, h, w, 3) red, green, blue, uint8.
        rate_hz: frames a second.
    """
    if not hasattr(source, "ndim"):
        yield [as_path(s) for s in source] if isinstance(source, list | tuple) else as_path(source)
        return
    with tempfile.TemporaryDirectory(prefix="massprops-") as spare:
        file = Path(spare) / "frames.mkv"
        write_frames(file, source, rate_hz)
        yield file


def write_frames(path: Path, frames: np.ndarray, rate_hz: float) -> None:
    """Frames as a video whose pixels are exactly theirs (FFV1 in Matroska).

    Args:
        path: the file.
        frames: (n, h, w) or (n, h, w, 3) uint8.
        rate_hz: frames a second.

    Raises:
        InputError: other shapes or types.
    """
    import numpy as np

    from massprops.native import encode

    grey = frames.ndim == 3
    if frames.dtype != np.uint8 or not (grey or (frames.ndim == 4 and frames.shape[3] == 3)):
        raise InputError(
            f"frames of shape {frames.shape} and type {frames.dtype}: give (n, h, w) or (n, h, w, 3) uint8"
        )
    encode(path, frames, rate_hz, "ffv1", "gray" if grey else "bgr0", {})
