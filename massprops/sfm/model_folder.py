"""Where in a folder a COLMAP model lies."""

from __future__ import annotations

from pathlib import Path

from massprops.errors import InputError


def find_model(folder: Path) -> Path:
    """The folder itself, or its `sparse/0`, `sparse` or `0`, that holds a COLMAP model.

    Raises:
        InputError: none of them does.
    """
    for place in (folder, folder / "sparse" / "0", folder / "sparse", folder / "0"):
        if any((place / f"images.{ext}").is_file() for ext in ("bin", "txt")):
            return place
    raise InputError(
        f"{folder}: no COLMAP model (cameras, images, points3D as .bin or .txt) there; give the folder of one"
    )
