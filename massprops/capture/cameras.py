"""Which photographs share a camera: the same device at the same zoom and size, held upright or sideways."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from massprops.capture.images import Photograph

LONGEST_SHAPE = 3.0
"""Longer over shorter side beyond which an image is a panorama put together by the phone, not one projection; the
longest frame of any camera with one lens (65 x 24 mm) is 2.7."""

FEWEST_PIXELS = 64
"""Shorter side below which hardly any feature is found [px]."""

THUMBNAIL = 400
"""Longer side below which an image is left out where the others are at least four times as large [px]: its features
are not those of its neighbours."""

SAME_SHAPE = 0.01
"""Relative difference of two images' shapes that rounding to whole pixels may make in a reduced copy."""


@dataclass(frozen=True)
class CameraPrior:
    """One camera at one zoom and image size, as far as it is known before a reconstruction.

    Attributes:
        size: width, height of its images, all turned the same way [px of the source].
        focal_px: focal length at that size, or None.
        focal_source: `given`, `exif`, `alike` (of another camera's EXIF, whose images have the same shape), `start`
            (the user's, where it can only be a start) or `none`.
        principal_point, distortion: where a sensor file gives them.
        device: maker, model and focal length as EXIF has them; empty without.
        images: how many.
    """

    size: tuple[int, int]
    focal_px: float | None = None
    focal_source: str = "none"
    principal_point: tuple[float, float] | None = None
    distortion: tuple[float, ...] | None = None
    device: str = ""
    images: int = 0


def unusable(photograph: Photograph, common: float) -> str | None:
    """Why an image cannot take part, or None.

    Args:
        common: median longer side of all images [px].
    """
    width, height = photograph.size
    shorter, longer = min(width, height), max(width, height)
    if shorter < FEWEST_PIXELS:
        return f"too small, {width}x{height} pixels"
    if longer < min(THUMBNAIL, 0.25 * common):
        return f"a thumbnail, {width}x{height} pixels"
    if longer > LONGEST_SHAPE * shorter:
        return f"a panorama, {width}x{height} pixels"
    return None


def group(photographs: list[Photograph]) -> tuple[list[CameraPrior], list[int], list[int]]:
    """Cameras, largest group first; the camera of each photograph; its turn.

    The turn counts the quarter turns clockwise that bring the photograph, upright, to the way in which most of its
    camera's images are held. EXIF tells it; where it does not, sideways images are turned to the right, which is as
    good as to the left while the principal point is in the middle.
    """
    keys = [(p.device, tuple(sorted(p.size))) for p in photographs]
    count = Counter(keys)
    order = sorted(count, key=lambda k: (-count[k], keys.index(k)))
    cameras, turns = [], [0] * len(photographs)
    for key in order:
        images = [i for i, k in enumerate(keys) if k == key]
        size = Counter(photographs[i].size for i in images).most_common(1)[0][0]
        held = Counter(photographs[i].turns or 0 for i in images if photographs[i].size == size).most_common(1)[0][0]
        for i in images:
            turns[i] = _turn(photographs[i], size, held)
        focals = [f for i in images if (f := photographs[i].focal_px) is not None]
        focal = float(np.median(focals)) if focals else None
        source = "exif" if focal else "none"
        cameras.append(CameraPrior(size, focal, source, device=_label(key[0]), images=len(images)))
    cameras = [_alike(c, cameras) if c.focal_px is None else c for c in cameras]
    return cameras, [order.index(k) for k in keys], turns


def _turn(photograph: Photograph, size: tuple[int, int], held: int) -> int:
    turn = (held - (photograph.turns or 0)) % 4
    sideways = photograph.size != size
    # programs turn the pixels and leave the flag as it was
    return turn if bool(turn % 2) == sideways or size[0] == size[1] else int(sideways)


def _alike(camera: CameraPrior, others: list[CameraPrior]) -> CameraPrior:
    """With the focal length of cameras whose images have the same shape, such as the originals of reduced copies."""
    ratio = max(camera.size) / min(camera.size)
    relative = [
        c.focal_px / max(c.size)
        for c in others
        if c.focal_px and abs(max(c.size) / min(c.size) / ratio - 1) < SAME_SHAPE
    ]
    if not relative or np.ptp(relative) > 0.02 * np.median(relative):
        return camera
    return replace(camera, focal_px=float(np.median(relative)) * max(camera.size), focal_source="alike")


def with_focal(cameras: list[CameraPrior], focal: float) -> list[CameraPrior]:
    """The user's focal length for the first camera; a start for others of the same image shape and unknown zoom."""
    first = replace(cameras[0], focal_px=focal, focal_source="given")
    out = [first]
    for c in cameras[1:]:
        same = abs(max(c.size) / min(c.size) * min(first.size) / max(first.size) - 1) < SAME_SHAPE
        if c.focal_source != "exif" and same:
            c = replace(c, focal_px=focal * max(c.size) / max(first.size), focal_source="start")
        out.append(c)
    return out


def _label(device: tuple[str | float | None, ...]) -> str:
    maker, model, millimetres, equivalent, zoom = device
    name = str(model or "") if str(model or "").startswith(str(maker or "")) else f"{maker or ''} {model or ''}".strip()
    parts = [name] if name else []
    parts += [f"{millimetres:g} mm"] if millimetres else []
    parts += [f"as {equivalent:g} mm on 35 mm film"] if equivalent else []
    parts += [f"zoom {zoom:g}"] if zoom else []
    return ", ".join(parts)
