"""Whether the files of a binary COLMAP model hold as much as they announce, when it is read and when it was written.

COLMAP's reader believes every count: one flipped bit makes it read on past the end of a file for hours. The layout is that
of COLMAP's documentation ("Output Format"), little endian.
"""

from __future__ import annotations

import errno
import mmap
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from massprops.errors import InputError

POSE = 7 * 8
SENSOR = 4 + 4
LEAST_CAMERA = 4 + 4 + 8 + 8 + 3 * 8
"""Number, model, width, height, and the parameters of the simplest model."""


def check_lengths(folder: Path) -> None:
    """Refuses a model of which a file announces more than it holds.

    Raises:
        InputError: names the file.
    """
    for name, walk in WALKS.items():
        path = folder / f"{name}.bin"
        if not path.is_file():
            continue
        try:
            with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                if walk(data) > len(data):
                    raise ValueError
        except (ValueError, struct.error, OverflowError):
            raise InputError(
                f"{path}: damaged: it holds less than its own counts say; export the model again"
            ) from None
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}); export the model again") from None


def write_model(model: Any, folder: Path) -> None:
    """Writes a binary model into a folder that is made for it where it is not there.

    COLMAP says nothing of a disk that refuses: what is there afterwards must hold what it announces.

    Raises:
        OSError: it does not.
    """
    folder.mkdir(parents=True, exist_ok=True)
    model.write(folder)
    try:
        check_lengths(folder)
        whole = all((folder / f"{name}.bin").is_file() for name in WALKS)
    except InputError:
        whole = False
    if not whole:
        raise OSError(errno.EIO, os.strerror(errno.EIO), str(folder))


PLACE = np.dtype([("uv", "<f8", 2), ("point", "<i8")])
POINT = np.dtype([("id", "<i8"), ("xyz", "<f8", 3), ("rgb", "u1", 3), ("error", "<f8"), ("length", "<u8")])
TRACK_ELEMENT = 4 + 4


def read_places(folder: Path) -> dict[int, np.ndarray]:
    """Features (k,) `PLACE` of every image by its number, of a model that COLMAP has just written; point: -1 of those that show none."""
    data = (folder / "images.bin").read_bytes()
    at, out = 8, {}
    for _ in range(_count(data, 0)):
        end = data.index(b"\0", at + 4 + POSE + 4)
        number, count = struct.unpack_from("<I", data, at)[0], _count(data, end + 1)
        out[number] = np.frombuffer(data, PLACE, count, end + 9)
        at = end + 9 + PLACE.itemsize * count
    return out


def read_points(folder: Path) -> np.ndarray:
    """Points (m,) `POINT` of a model that COLMAP has just written."""
    data = (folder / "points3D.bin").read_bytes()
    at, begins = 8, []
    for _ in range(_count(data, 0)):
        begins.append(at)
        at += POINT.itemsize
        at += TRACK_ELEMENT * _count(data, at - 8)
    content = np.frombuffer(data, np.uint8)
    rows = content[np.array(begins, int)[:, None] + np.arange(POINT.itemsize)]
    return np.ascontiguousarray(rows).view(POINT)[:, 0]


def _cameras(data: mmap.mmap) -> int:
    return 8 + _count(data, 0) * LEAST_CAMERA


def _images(data: mmap.mmap) -> int:
    at = 8
    for _ in range(_count(data, 0)):
        end = data.find(b"\0", at + 4 + POSE + 4)
        if end < 0:
            raise ValueError("a name without an end")
        at = end + 1 + 8 + 24 * _count(data, end + 1)
    return at


def _points(data: mmap.mmap) -> int:
    at = 8
    for _ in range(_count(data, 0)):
        at += 8 + 3 * 8 + 3 + 8
        at += 8 + 8 * _count(data, at)
    return at


def _rigs(data: mmap.mmap) -> int:
    at = 8
    for _ in range(_count(data, 0)):
        sensors = struct.unpack_from("<I", data, at + 4)[0]
        at += 8 + (SENSOR if sensors else 0)
        for _ in range(sensors - 1):
            at += SENSOR + 1 + (POSE if struct.unpack_from("<B", data, at + SENSOR)[0] else 0)
    return at


def _frames(data: mmap.mmap) -> int:
    at = 8
    for _ in range(_count(data, 0)):
        at += 4 + 4 + POSE
        at += 4 + (SENSOR + 8) * struct.unpack_from("<I", data, at)[0]
    return at


def _count(data: bytes | mmap.mmap, at: int) -> int:
    return int(struct.unpack_from("<Q", data, at)[0])


WALKS: dict[str, Callable[[mmap.mmap], int]] = {
    "cameras": _cameras, "images": _images, "points3D": _points, "rigs": _rigs, "frames": _frames,
}  # fmt: skip
