"""Silhouettes that the user has, in COLMAP's naming, checked before they can do silent harm."""

from __future__ import annotations

import unicodedata
from pathlib import Path

import numpy as np

from massprops.capture.images import orientation, printable, turn
from massprops.errors import InputError


class GivenMasks:
    """A folder of silhouettes: `NAME.png`, or the name with `.png` in place of its own ending; in `camN/` too.

    NAME is the image's own, or the one under which a run stores it, so that a run's `masks/` can be mended and given
    back. Names that differ in the way accents are coded alone are the same.
    """

    def __init__(self, folder: Path) -> None:
        """Raises InputError when there is no such folder."""
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; give the folder of silhouettes to --masks")
        self.folder = folder
        places = [folder, *(p for p in sorted(folder.iterdir()) if p.is_dir() and p.name.startswith("cam"))]
        self._files = {
            _same(str(file.relative_to(folder))): file for p in places for file in sorted(p.iterdir()) if file.is_file()
        }

    def find(self, stored: str, name: str) -> Path | None:
        """The mask of one image.

        Args:
            stored: its name in a run, `camN/NAME`.
            name: its file's name.
        """
        stream, own = stored.split("/", 1)
        names = [f"{n}.png" for n in (name, own, Path(name).stem, Path(own).stem)]
        for candidate in (c for n in names for c in (n, f"{stream}/{n}")):
            if (file := self._files.get(_same(candidate))) is not None:
                return file
        return None

    def check(self, names: list[tuple[str, str]]) -> list[Path]:
        """The masks of all images (stored name, file's name).

        COLMAP drops an image whose mask is missing without a word; here it is said.

        Raises:
            InputError: masks are missing.
        """
        found = [self.find(*pair) for pair in names]
        missing = [name for (_, name), path in zip(names, found, strict=True) if path is None]
        if missing:
            some = ", ".join(printable(n) for n in missing[:3]) + (", ..." if len(missing) > 3 else "")
            raise InputError(
                f"{self.folder}: no mask for {len(missing)} of {len(names)} images ({some}); expected names like "
                f"{printable(names[0][1])}.png: add them, take those images away, or leave --masks out"
            )
        return [path for path in found if path is not None]


def _same(name: str) -> str:
    return unicodedata.normalize("NFC", name)


def load_mask(path: Path, source_size: tuple[int, int], size: tuple[int, int], image: Path | None = None) -> np.ndarray:
    """One mask at working size, (h, w) uint8 of 0 and 255.

    Args:
        path: image file, black excluded.
        source_size: width, height of the image it belongs to, upright [px].
        size: width, height of the stored frame [px].
        image: that image's file; a mask drawn over its pixels as stored is turned as its EXIF turns the image.

    Raises:
        InputError: not an image, another size than its image, or all black.
    """
    import cv2

    mask = (
        cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        if path.stat().st_size
        else None
    )
    if mask is None:
        raise InputError(f"{path}: not an image that can be read")
    have = (mask.shape[1], mask.shape[0])
    if image is not None and have == tuple(source_size)[::-1] and have != tuple(source_size):
        mask = turn(mask, orientation(image))
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
