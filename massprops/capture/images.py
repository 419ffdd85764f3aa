"""Photographs: what their headers say, and their pixels, upright; damaged files named."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from datetime import UTC
from pathlib import Path
from typing import Any

import numpy as np

from massprops.core.processes import silenced_stderr
from massprops.errors import InputError

SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".heic", ".heif", ".hif"}
FORMATS = ("JPEG", "PNG", "TIFF", "BMP", "WEBP", "HEIF")
"""What Pillow may take a file for; its other readers stay closed to files of unknown origin."""

LARGEST_PIXELS = 400_000_000
QUARTER_TURNS = {1: 0, 2: 0, 3: 2, 4: 2, 5: 1, 6: 1, 7: 3, 8: 3}
"""Quarter turns clockwise from the image as stored to the image as shown, by EXIF orientation; 2, 4, 5 and 7 mirror too."""

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PLAIN_CHUNKS = (b"IHDR", b"IDAT", b"IEND", b"pHYs", b"tIME")

LAST_CLOCK_S = 2**63 // 10**9
"""Nanoseconds are counted in 64 bits: to the year 2262."""


@dataclass(frozen=True)
class Photograph:
    """What the header of one image says.

    Attributes:
        path: the file.
        size: width, height upright as shown [px].
        focal_px: at that size, or None.
        timestamp_ns: when it was taken, or -1.
        device: maker, model, focal length, its 35 mm equivalent and digital zoom as EXIF has them; all None without.
        turns: quarter turns clockwise from the sensor to the image as shown, or None where the header is silent.
    """

    path: Path
    size: tuple[int, int]
    focal_px: float | None
    timestamp_ns: int
    device: tuple[str | float | None, ...] = (None,) * 5
    turns: int | None = None


def list_images(folder: Path) -> list[Path]:
    """Image files of a folder in natural order (`2.jpg` before `10.jpg`), links that lead nowhere among them."""
    files = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.is_dir() and p.name[0] != "."]
    return sorted(
        files, key=lambda p: [(not s.isdecimal(), int(s) if s.isdecimal() else 0, s.lower()) for s in _runs(p)]
    )


def _runs(path: Path) -> list[str]:
    return [s for s in re.split(r"([0-9]+)", path.name) if s]


def printable(name: str) -> str:
    """A file's name for a message: what no terminal can show is written as its code."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in name)


def inspect(path: Path) -> Photograph:
    """What the header says; no pixel is decoded.

    The focal length is EXIF's 35 mm equivalent (`across_film`), or the focal length over the sensor's
    pixel pitch when the focal plane's resolution is there.

    Raises:
        InputError: not an image that can be read, or absurdly large.
    """
    header = _Header(path)
    focal = _focal(header.detail, header.shown)
    turns = QUARTER_TURNS.get(header.said)  # type: ignore[arg-type]
    return Photograph(path, header.shown, focal, _time(header.detail), header.device, turns)


class _Header:
    """Format, size (w, h) as stored and as shown, orientation and EXIF of a file; no pixel is decoded."""

    def __init__(self, path: Path) -> None:
        from PIL import Image
        from pillow_heif import register_heif_opener

        if not path.is_file():
            raise InputError(f"{path}: a link that leads nowhere, a pipe or a device; remove it or copy it again")
        register_heif_opener()
        Image.MAX_IMAGE_PIXELS = None
        try:
            with silenced_stderr(), Image.open(path, formats=FORMATS) as image:
                self.format = image.format or ""
                # of a TIFF, Pillow gives the size as shown
                tags = getattr(image, "tag_v2", {})
                self.stored = (int(tags.get(256, image.size[0])), int(tags.get(257, image.size[1])))
                if self.stored[0] * self.stored[1] > LARGEST_PIXELS:
                    raise InputError(
                        f"{path}: {self.stored[0]}x{self.stored[1]} pixels are too many; reduce the image first"
                    )
                main, self.detail = ({}, {}) if _plain_png(path, image) else _exif(image)
                original = image.info.get("original_orientation")
        except InputError:
            raise
        # a damaged header can raise anything in Pillow's readers
        except Exception:
            raise InputError(f"{path}: not an image that can be read; remove it or copy it again") from None
        self.said = original if self.format == "HEIF" else main.get(0x0112)
        # what libheif decodes is upright already
        self.orientation = int(self.said) if self.said in QUARTER_TURNS and self.format != "HEIF" else 1
        self.shown = self.stored if self.orientation < 5 else self.stored[::-1]
        zoom = _number(self.detail.get(0xA404))
        self.device = (
            _text(main.get(0x010F)),
            _text(main.get(0x0110)),
            _number(self.detail.get(0x920A)),
            _number(self.detail.get(0xA405)),
            zoom if zoom and zoom > 1 else None,
        )


def _plain_png(path: Path, image: Any) -> bool:
    """Whether a PNG has no EXIF and no XMP: Pillow would decode all its pixels to look behind them."""
    if image.format != "PNG" or "exif" in image.info:
        return False
    content = path.read_bytes()
    return not any(word in content for word in (b"eXIf", b"Raw profile type", b"XML:com.adobe.xmp"))


def _exif(image: Any) -> tuple[dict[int, Any], dict[int, Any]]:
    """Main and detail tags; empty where they are damaged, for a bad clock spoils no picture."""
    try:
        exif = image.getexif()
        return dict(exif), dict(exif.get_ifd(0x8769))
    except Exception:
        return {}, {}


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if np.isfinite(number) and number > 0 else None


def _text(value: Any) -> str | None:
    return value.strip("\0 ").lower() or None if isinstance(value, str) else None


def across_film(aspect: float) -> float:
    """Length on 35 mm film that the longer side of an image stands for [mm]; aspect is the shorter side over it.

    "Equivalent" compares diagonals (CIPA DCG-001), 43.27 mm on film. Only a 3:2 image then has film's 36 mm. Phones and
    compact cameras have 4:3 sensors and cut longer images from them, at full width (16:9: 1455 px calibrated, 1444 by
    this rule, 1388 by 36 mm; 4:3: 702 px, 703 and 676).
    """
    return 36.0 if abs(aspect - 2 / 3) < 0.02 else 0.8 * float(np.hypot(36.0, 24.0))


def _focal(detail: dict[int, Any], size: tuple[int, int]) -> float | None:
    longer, shorter = max(size), min(size)
    millimetres, equivalent, pitch = (_number(detail.get(tag)) for tag in (0x920A, 0xA405, 0xA20E))
    focal = None
    if equivalent:
        focal = equivalent / across_film(shorter / longer) * longer
    elif millimetres and pitch:
        per_mm = pitch / {3: 10.0, 4: 1.0}.get(int(_number(detail.get(0xA210)) or 2), 25.4)
        original = max(_number(detail.get(0xA002)) or 0.0, _number(detail.get(0xA003)) or 0.0) or longer
        focal = millimetres * per_mm * longer / original
    return focal if focal is not None and 0.2 * longer < focal < 50 * longer else None


def _time(detail: dict[int, Any]) -> int:
    from datetime import datetime

    try:
        taken = datetime.strptime(str(detail.get(0x9003)), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    except (ValueError, OverflowError):
        return -1
    seconds = int(taken.timestamp())
    return seconds * 10**9 if 0 <= seconds < LAST_CLOCK_S else -1


def load(path: Path, longest: int | None = None) -> np.ndarray:
    """One image as (h, w, 3) uint8 BGR, upright, reduced to `longest` [px]; 16 bits are cut to 8.

    Raises:
        InputError: it cannot be decoded, or is absurdly large.
    """
    import cv2

    header = _Header(path)
    if header.format == "HEIF":
        image = _by_pillow(path)
    else:
        image = decoded(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        # OpenCV's TIFF reader turns the image whether asked to or not
        if image is not None and header.format != "TIFF":
            image = turn(image, header.orientation)
    if image is None or image.shape[1::-1] != header.shown:
        raise InputError(f"{path}: its pixels cannot be decoded; remove it or copy it again")
    return reduce(image, longest)


def decoded(path: Path, how: int) -> np.ndarray | None:
    """An image file (h, w) or (h, w, 3) by OpenCV, or None where it cannot be read; `how` is one of its IMREAD flags."""
    import cv2

    try:
        with silenced_stderr():
            return cv2.imdecode(np.fromfile(path, np.uint8), how)
    except cv2.error:  # an empty file, or sides beyond OpenCV's own limit
        return None


def plain_png(path: Path, longest: int | None = None) -> bytes | None:
    """Content of a PNG of 8-bit colours or greys, no longer than `longest` [px], with no chunk by which a reader might show other pixels, such as a
    gamma, a profile, a transparent colour or EXIF; None of any other file. `png_size` tells its width and height.
    """
    content = path.read_bytes() if path.suffix.lower() == ".png" else b""
    if content[:8] != PNG_SIGNATURE or content[24:26] not in (bytes((8, 0)), bytes((8, 2))):
        return None
    at = len(PNG_SIGNATURE)
    while at < len(content):
        length, name = struct.unpack_from(">I4s", content, at) if at + 8 <= len(content) else (0, b"")
        if name not in PLAIN_CHUNKS:
            return None
        at += 12 + length
    fits = longest is None or max(png_size(content)) <= longest
    return content if fits and at == len(content) else None


def png_size(content: bytes) -> tuple[int, int]:
    """Width and height of a PNG."""
    width, height = struct.unpack_from(">II", content, 16)
    return width, height


def _by_pillow(path: Path) -> np.ndarray | None:
    from PIL import Image

    try:
        with silenced_stderr(), Image.open(path, formats=FORMATS) as image:
            return np.ascontiguousarray(np.asarray(image.convert("RGB"))[..., ::-1])
    # as for the header
    except Exception:
        return None


def orientation(path: Path) -> int:
    """EXIF orientation, 1 to 8, by which the file's pixels are to be turned.

    Raises:
        InputError: as of `inspect`.
    """
    return _Header(path).orientation


def turn(image: np.ndarray, orientation: int) -> np.ndarray:
    """The image (h, w, ...) as shown, from its pixels as stored and its EXIF orientation 1 to 8."""
    return np.ascontiguousarray(np.rot90(_mirrored(image, orientation), -QUARTER_TURNS[orientation]))


def turned_back(image: np.ndarray, orientation: int) -> np.ndarray:
    """The pixels (h, w, ...) as stored, from the image as shown: undoes `turn`."""
    return np.ascontiguousarray(_mirrored(np.rot90(image, QUARTER_TURNS[orientation]), orientation))


def _mirrored(image: np.ndarray, orientation: int) -> np.ndarray:
    """The image mirrored where an orientation says so, which undoes itself."""
    if orientation in (2, 4):
        return image[:, ::-1]
    return image[::-1] if orientation in (5, 7) else image


def reduce(image: np.ndarray, longest: int | None) -> np.ndarray:
    """The image (h, w, ...) with its longer side at most `longest` [px]."""
    import cv2

    height, width = image.shape[:2]
    if longest is None or max(height, width) <= longest:
        return image
    factor = longest / max(height, width)
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)
