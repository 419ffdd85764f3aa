"""Silhouettes that the user has, in COLMAP's naming, checked before they can do silent harm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from massprops.errors import InputError


def find_mask(folder: Path, camera: int, name: str) -> Path | None:
    """`NAME.png`, `camN/NAME.png`, or the name with `.png` in place of its own ending."""
    for candidate in (
        folder / f"{name}.png",
        folder / f"cam{camera}" / f"{name}.png",
        folder / f"{Path(name).stem}.png",
        folder / f"cam{camera}" / f"{Path(name).stem}.png",
    ):
        if candidate.is_file():
            return candidate
    return None


def check_masks(folder: Path, camera: int, names: list[str]) -> None:
    """COLMAP drops an image whose mask is missing without a word; here it is said.

    Raises:
        InputError: masks are missing.
    """
    missing = [name for name in names if find_mask(folder, camera, name) is None]
    if missing:
        some = ", ".join(missing[:3]) + (", ..." if len(missing) > 3 else "")
        raise InputError(
            f"{folder}: no mask for {len(missing)} of {len(names)} images ({some}); expected names like {names[0]}.png"
        )


def load_mask(path: Path, source_size: tuple[int, int], size: tuple[int, int]) -> np.ndarray:
    """One mask at working size, (h, w) uint8 of 0 and 255.

    Args:
        path: image file, black excluded.
        source_size: width, height of the image it belongs to [px].
        size: width, height of the stored frame [px].

    Raises:
        InputError: not an image, another size than its image, or all black.
    """
    import cv2

    mask = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_GRAYSCALE) if path.stat().st_size else None
    if mask is None:
        raise InputError(f"{path}: not an image that can be read")
    have = (mask.shape[1], mask.shape[0])
    if have not in (tuple(source_size), tuple(size)):
        raise InputError(
            f"{path}: mask is {have[0]}x{have[1]}, its image {source_size[0]}x{source_size[1]}; they must agree"
        )
    if not (mask > 127).any():
        raise InputError(f"{path}: mask holds none of the object (all black); white is the object")
    if have != tuple(size):
        mask = cv2.resize(mask, tuple(size), interpolation=cv2.INTER_AREA)
    return np.where(mask > 127, 255, 0).astype(np.uint8)
