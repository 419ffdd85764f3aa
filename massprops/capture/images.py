"""Folders of photographs: natural order, orientation and focal length from EXIF, damaged files named."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC
from pathlib import Path

import numpy as np

from massprops.errors import InputError

SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp"}
LARGEST_PIXELS = 400_000_000


@dataclass(frozen=True)
class Photograph:
    """path; size (width, height) upright as shown [px]; focal_px from EXIF at that size, or None; time [ns] or -1."""

    path: Path
    size: tuple[int, int]
    focal_px: float | None
    timestamp_ns: int


def list_images(folder: Path) -> list[Path]:
    """Image files of a folder in natural order (`2.jpg` before `10.jpg`)."""
    files = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file() and not p.name.startswith(".")]
    return sorted(files, key=lambda p: [int(s) if s.isdigit() else s.lower() for s in re.split(r"(\d+)", p.name)])


def inspect(path: Path) -> Photograph:
    """Size, focal length and time of one photograph, from its header.

    The focal length is EXIF's 35 mm equivalent (36 mm over the longer side), or the focal length over the sensor's
    pixel pitch when the focal plane's resolution is there.

    Raises:
        InputError: not an image that can be read, or absurdly large.
    """
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = None
    try:
        with Image.open(path) as image:
            width, height = image.size
            if width * height > LARGEST_PIXELS:
                raise InputError(f"{path}: {width}x{height} pixels are too many; reduce the image first")
            exif = image.getexif()
            detail = exif.get_ifd(0x8769)
    except (OSError, SyntaxError, ValueError, ZeroDivisionError) as error:
        raise InputError(f"{path}: not an image that can be read ({error}); remove it or copy it again") from None
    longer = max(width, height)
    focal = None
    equivalent, millimetres, pitch, unit = (detail.get(tag) for tag in (0xA405, 0x920A, 0xA20E, 0xA210))
    try:
        if equivalent:
            focal = float(equivalent) / 36.0 * longer
        elif millimetres and pitch:
            per_mm = float(pitch) / {2: 25.4, 3: 10.0, 4: 1.0}.get(int(unit or 2), 25.4)
            original = float(detail.get(0xA002) or longer)
            focal = float(millimetres) * per_mm * longer / max(original, float(detail.get(0xA003) or 0))
    except (TypeError, ValueError, ZeroDivisionError):
        focal = None
    if focal is not None and not 0.2 * longer < focal < 50 * longer:
        focal = None
    if int(exif.get(0x0112, 1) or 1) >= 5:
        width, height = height, width
    return Photograph(path, (width, height), focal, _time(detail))


def _time(detail) -> int:  # type: ignore[no-untyped-def]
    from datetime import datetime

    text = detail.get(0x9003)
    try:
        return int(datetime.strptime(str(text), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC).timestamp()) * 10**9
    except ValueError:
        return -1


def load(path: Path, longest: int | None = None) -> np.ndarray:
    """One image as (h, w, 3) uint8 BGR, upright, reduced to `longest` [px].

    Raises:
        InputError: it cannot be decoded.
    """
    import cv2

    data = np.fromfile(path, np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    if image is None:
        raise InputError(f"{path}: not an image that can be read; remove it or copy it again")
    return reduce(image, longest)


def reduce(image: np.ndarray, longest: int | None) -> np.ndarray:
    """The image with its longer side at most `longest` [px]."""
    import cv2

    height, width = image.shape[:2]
    if longest is None or max(height, width) <= longest:
        return image
    factor = longest / max(height, width)
    return cv2.resize(image, (round(width * factor), round(height * factor)), interpolation=cv2.INTER_AREA)
