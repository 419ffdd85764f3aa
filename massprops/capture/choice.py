"""What the user points at: `--object X,Y`, `--box X0,Y0,X1,Y1`, each in the first image or in `FILE:`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massprops.documents.limits import excerpt
from massprops.errors import InputError
from massprops.views import Views


@dataclass(frozen=True)
class Pointed:
    """A pixel or a rectangle of one of the user's images.

    Attributes:
        option: as given, for messages.
        file: name of the image, or empty for the first that is used.
        numbers: x, y or x0, y0, x1, y1 [px of the user's image, upright], low corner first.
    """

    option: str
    file: str
    numbers: tuple[float, ...]

    @property
    def is_box(self) -> bool:
        """Whether it is a rectangle."""
        return len(self.numbers) == 4


def parse(option: str, value: str) -> Pointed:
    """Reads `X,Y` (option `object`) or `X0,Y0,X1,Y1` (option `box`), perhaps after `FILE:`.

    Raises:
        InputError: not of that form.
    """
    file, _, rest = str(value).rpartition(":")
    wanted = 4 if option == "box" else 2
    form = "X0,Y0,X1,Y1" if option == "box" else "X,Y"
    argument = f"--{option} {excerpt(str(value))}"
    try:
        numbers = [float(n) for n in rest.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != wanted or not np.isfinite(numbers).all():
        raise InputError(f"{argument}: give {form} in pixels of the first image, or FILE:{form}")
    if option == "box":
        x, y = sorted(numbers[::2]), sorted(numbers[1::2])
        if x[1] - x[0] < 2 or y[1] - y[0] < 2:
            raise InputError(f"{argument}: an empty rectangle: give two opposite corners, {form}")
        numbers = [x[0], y[0], x[1], y[1]]
    return Pointed(argument, file, tuple(numbers))


def check_early(pointed: Pointed, source: Path) -> None:
    """Refuses, before any work, a file that is not in a folder of images and a place outside it.

    Raises:
        InputError: says the image's size.
    """
    from massprops.capture.images import inspect

    if not pointed.file or not source.is_dir() or any((source / f"cam{i}").is_dir() for i in (0, 1)):
        return
    file = source / pointed.file
    if not file.is_file():
        raise InputError(f"{pointed.option}: no image {pointed.file} in {source}")
    _refuse_outside(pointed, pointed.file, inspect(file).size)


def _refuse_outside(pointed: Pointed, name: str, size: tuple[int, ...]) -> None:
    x, y = np.array(pointed.numbers[::2]), np.array(pointed.numbers[1::2])
    # a box may reach over the rim as long as part of it lies in the image
    low_x, high_x, low_y, high_y = (x.max(), x.min(), y.max(), y.min()) if pointed.is_box else (x[0], x[0], y[0], y[0])
    if low_x < 0 or low_y < 0 or high_x > size[0] - 1 or high_y > size[1] - 1:
        raise InputError(f"{pointed.option}: outside the image {name}, which is {size[0]}x{size[1]} pixels")


@dataclass(frozen=True)
class Located:
    """What was pointed at, in one of the registered views.

    Attributes:
        pointed: by the user.
        view: its number.
        name: the user's name of the image.
        uv: (1 or 2, 2) pixels of the undistorted view.
    """

    pointed: Pointed
    view: int
    name: str
    uv: np.ndarray


def locate(pointed: Pointed, footage: dict[str, Any], views: Views) -> Located:
    """The view and pixels that the user meant.

    Args:
        pointed: by the user.
        footage: `footage.json` of the capture stage.
        views: those that could be placed.

    Raises:
        InputError: no such image, it was not used or placed, or the place lies outside it.
    """
    frames = footage["frames"]
    frame = frames[0] if not pointed.file else next((f for f in frames if _is(f, pointed.file)), None)
    usable = [f["source_name"] for f in frames if f["name"] in set(views.names)]
    instead = f"give it in another, such as {usable[0]}: FILE:X,Y" if usable else "give it in another: FILE:X,Y"
    if frame is None:
        raise InputError(f"{pointed.option}: no image {pointed.file} among those that were used; {instead}")
    name = frame["source_name"]
    camera = next(c for c in footage["cameras"] if c["id"] == frame["camera"])
    stored = (frame["width"], frame["height"])
    size = tuple(camera.get("source_size") or stored)
    size = size[::-1] if frame.get("turn", 0) % 2 and camera.get("source_size") else size
    _refuse_outside(pointed, name, size)
    if frame["name"] not in views.names:
        raise InputError(f"{pointed.option}: the image {name} could not be placed; {instead}")
    view = views.names.index(frame["name"])
    # centres of pixels at whole numbers: a reduction moves the origin by half a pixel
    pixel = (np.array(pointed.numbers).reshape(-1, 2) + 0.5) * (stored[0] / size[0]) - 0.5
    return Located(pointed, view, name, _undistorted(pixel, views.K[view], views.distortion[view]))


def _is(frame: dict[str, Any], file: str) -> bool:
    names = (frame["source_name"], frame["name"], frame["name"].split("/", 1)[-1])
    return file in names or (file.isdecimal() and frame["source_name"] == f"{int(file):06d}.png")


def _undistorted(pixel: np.ndarray, K: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    import cv2

    if not np.any(distortion):
        return pixel
    lens = np.asarray(distortion, float).reshape(-1, 1)
    return cv2.undistortPoints(pixel[:, None].astype(float), np.asarray(K, float), lens, P=np.asarray(K, float))[:, 0]
