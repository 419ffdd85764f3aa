"""Silhouettes that the user has, in COLMAP's naming, checked before they can do silent harm."""

from __future__ import annotations

import unicodedata
from pathlib import Path

import numpy as np

from massprops.capture.images import decoded, orientation, printable, turn, turned_back
from massprops.errors import InputError
from massprops.views import AMBIGUOUS


class GivenMasks:
    """A folder of silhouettes: `NAME.png`, or the name with `.png` in place of its own ending; in `camN/` too,
    and of several inputs in a folder of the input's name.

    NAME is the image's own, or the one under which a run stores it, so that a run's `masks/` can be mended and given
    back. Names that differ in the way accents are coded alone are the same.
    """

    def __init__(self, folder: Path) -> None:
        """Raises InputError when there is no such folder."""
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; give the folder of silhouettes to --masks")
        self.folder = folder
        places = [folder, *(p for p in sorted(folder.iterdir()) if p.is_dir() and not p.name.startswith("."))]
        self._files = {
            _same(str(file.relative_to(folder))): file for p in places for file in sorted(p.iterdir()) if file.is_file()
        }

    def find(self, stored: str, name: str) -> Path | None:
        """The mask of one image.

        Args:
            stored: its name in a run, `camN/NAME`.
            name: its file's name.
        """
        stream, image_name = stored.split("/", 1)
        names = [f"{n}.png" for n in (name, image_name, str(Path(name).with_suffix("")), Path(image_name).stem)]
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
        mask_paths = [self.find(*pair) for pair in names]
        missing = [name for (_, name), path in zip(names, mask_paths, strict=True) if path is None]
        if missing:
            some = ", ".join(printable(n) for n in missing[:3]) + (", ..." if len(missing) > 3 else "")
            raise InputError(
                f"{self.folder}: no mask for {len(missing)} of {len(names)} images ({some}); expected names like "
                f"{printable(names[0][1])}.png: add them, take those images away, or leave --masks out"
            )
        return [path for path in mask_paths if path is not None]


def _same(name: str) -> str:
    return unicodedata.normalize("NFC", name)


def load_mask(path: Path, source_size: tuple[int, int], size: tuple[int, int], image: Path | None = None) -> np.ndarray:
    """One mask at working size.

    Args:
        path: image file, black excluded.
        source_size: width, height of the image it belongs to, upright [px].
        size: width, height of the stored frame [px].
        image: that image's file; a mask drawn over its pixels as stored is turned as its EXIF turns the image.

    A mask of 0, 128 and 255 alone, as `massprops masks` writes it, keeps its 128: cannot tell.

    Returns:
        (h, w) uint8 of 0, 255, and 128 where it cannot be told; all 0 where the object is not to be seen.

    Raises:
        InputError: not an image, or another size than its image.
    """
    import cv2

    mask = decoded(path, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
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
    ambiguous = mask == AMBIGUOUS if np.isin(mask, (0, AMBIGUOUS, 255)).all() else np.zeros(mask.shape, bool)
    object_, unknown = (_resized(m, tuple(size)) for m in ((mask > 127) & ~ambiguous, ambiguous))
    return np.where(object_, 255, np.where(unknown, AMBIGUOUS, 0)).astype(np.uint8)


def _resized(mask: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    import cv2

    if mask.shape[::-1] == size:
        return mask
    return cv2.resize(np.where(mask, 255, 0).astype(np.uint8), size, interpolation=cv2.INTER_AREA) > 127


def to_original(mask: np.ndarray, source_size: tuple[int, int], exif: int = 1) -> np.ndarray:
    """A silhouette of a stored frame as `load_mask` takes it back: at the size of the user's image.

    Over the pixels as stored where EXIF turns the image on its side, as COLMAP reads them; upright where a turn could
    not be told from the size.

    Args:
        mask: (h, w) uint8 of 0, 128 and 255, of the frame, upright.
        source_size: width, height of the user's image, upright [px].
        exif: its EXIF orientation, 1 to 8.
    """
    import cv2

    size = tuple(int(v) for v in source_size)
    soft = [cv2.resize(np.where(mask == v, 1.0, 0.0), size, interpolation=cv2.INTER_LINEAR) for v in (255, AMBIGUOUS)]
    out = np.where(soft[0] > 0.5, 255, np.where(soft[1] >= 0.5, AMBIGUOUS, 0)).astype(np.uint8)
    return turned_back(out, exif) if exif >= 5 and size[0] != size[1] else out
