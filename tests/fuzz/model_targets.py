"""Fuzzed: a COLMAP model that somebody gives with `--sparse`, as binary files and as text."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

FRAMES, POINTS = 4, 25


@cache
def _files() -> dict[str, bytes]:
    """By path: `binary/images.bin`, `text/images.txt` and so on."""
    import pycolmap

    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, FRAMES
    options.num_points3D = POINTS
    pycolmap.set_random_seed(0)
    model = pycolmap.synthesize_dataset(options)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for kind in ("binary", "text"):
            (folder / kind).mkdir()
        model.write_binary(folder / "binary")
        model.write_text(folder / "text")
        return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@cache
def _names() -> tuple[str, ...]:
    import pycolmap

    with tempfile.TemporaryDirectory() as place:
        around(Path(place))
        model = pycolmap.Reconstruction(Path(place) / "binary")
        return tuple(sorted(image.name for image in model.images.values()))


def around(folder: Path) -> None:
    """Both models whole."""
    for name, content in _files().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def _sparse(folder: Path, name: str) -> object:
    from massprops.sfm.footage import CameraRecord, FootageRecord, FrameRecord
    from massprops.sfm.sparse_import import import_sparse

    frames = tuple(FrameRecord(image, 0, -1, i, image) for i, image in enumerate(_names()))
    cameras = (CameraRecord(0, (1024, 768)),)
    record = FootageRecord(folder, "fuzz", "images", "tumbling", "black", False, cameras, frames)
    return import_sparse(folder / name.split("/")[0], record)


def model_targets(target: Any) -> dict[str, Any]:
    """The target by its name; `target` is the class."""
    return {"sparse-models": lambda: target({name: [data] for name, data in _files().items()}, _sparse, around)}
