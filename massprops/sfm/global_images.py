"""Images and silhouettes as a global shutter would have taken them.

Dense stereo and silhouettes think that an image was taken at one moment. So each is warped by what the shutter moved, which
depends on the depth: that of the model's points in the view, and between them linear. A depth wrong by a tenth of
the body's radius moves a pixel by a twentieth of what the shutter did. Nothing here needs pycolmap.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from massprops.core.files import write_image
from massprops.core.inputs import read_image
from massprops.documents.arrays import open_arrays
from massprops.sfm.footage import FootageRecord
from massprops.sfm.points import SparsePoints, project_camera, residuals
from massprops.sfm.row_motion import Motion, Readout, Seen
from massprops.views import Views

GRID = 4
"""Depth and shift are computed at one pixel of so many, in each direction: both change slowly."""
FARTHEST = 1.0
"""Observations that do not fit by more [px] give no depth."""
SHIFTS = "shifts.npz"
"""File with the shift of every placed image, by which a silhouette goes back over the image as it was read."""
KEPT = 2
"""Of the shifts' grid every so many-th place is kept."""


def write_global(footage: FootageRecord, seen: Seen, readout: Readout, folder: Path) -> None:
    """Writes `frames/` and `masks/` of the placed images into a new folder, warped, and `SHIFTS`.

    Args:
        seen: the model adjusted with the readout.

    Raises:
        OSError: an image of the footage cannot be read.
    """
    fit = np.linalg.norm(residuals(seen.views, seen.points), axis=1) < FARTHEST
    points = seen.points.observed(fit)
    kept: dict[str, np.ndarray] = {}
    for i, name in enumerate(seen.views.names):
        coarse = grid_shifts(seen.views, points, seen.motion, readout, i)
        kept[f"shift{i}"] = coarse[::KEPT, ::KEPT].astype(np.float16)
        where = _places(coarse, GRID, seen.views.size[i])
        write_image(folder / "frames" / name, warped(read_image(footage.image(name)), where))
        if footage.mask(name).is_file():
            mask = read_image(footage.mask(name), 0)
            write_image(folder / "masks" / f"{name}.png", warped(mask, where, nearest=True))
    np.savez(folder / SHIFTS, names=np.array(seen.views.names, dtype=np.str_), **kept)  # type: ignore[arg-type]


def as_read(mask: np.ndarray, shifts: Path, name: str) -> np.ndarray:
    """A silhouette (h, w) over the image as a rolling shutter read it; itself where that was not corrected.

    Args:
        shifts: the file `SHIFTS`, which need not exist.
        name: of the frame.

    Raises:
        ValueError: the file is damaged.
    """
    if not shifts.is_file():
        return mask
    with open_arrays(shifts) as z:
        number = {str(n): i for i, n in enumerate(z["names"])}.get(name)
        coarse = None if number is None else np.asarray(z[f"shift{number}"], np.float32)
    if coarse is None:
        return mask
    size = mask.shape[::-1]
    shift, at = (_places(coarse * one, KEPT * GRID, size) for one in (1.0, 0.0))
    shift -= at
    where = at
    for _ in range(3):  # the place that the shift brings here
        where = at - warped(shift, where)
    return warped(mask, where, nearest=True)


def grid_shifts(views: Views, points: SparsePoints, motion: Motion, readout: Readout, i: int) -> np.ndarray:
    """What the shutter moved the pixels of view i by, at every `GRID`-th of them: (gh, gw, 2) float32 [px].

    Args:
        points: with observations as a global shutter would see them.
    """
    w, h = (int(s) for s in views.size[i])
    u, v = np.meshgrid(np.arange(0, w + GRID, GRID, dtype=float), np.arange(0, h + GRID, GRID, dtype=float))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    of_view = points.obs_view == i
    if not motion.known[i] or of_view.sum() < 4:
        return np.zeros((*u.shape, 2), np.float32)
    z = points.xyz[points.obs_point[of_view]] @ views.R[i, 2] + views.t[i, 2]
    shift = _shift_of(views, motion, readout, i, uv, _depth_between(points.obs_uv[of_view], z, uv))
    return shift.reshape(*u.shape, 2).astype(np.float32)


def _places(coarse: np.ndarray, step: int, size: np.ndarray | tuple[int, ...]) -> np.ndarray:
    """Every pixel (h, w, 2) moved by shifts that are given at every `step`-th of them."""
    import cv2

    w, h = (int(s) for s in size)
    at = np.stack(np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32)), axis=2)
    fine = cv2.remap(coarse, at[..., 0] / step, at[..., 1] / step, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return at + fine


def warped(image: np.ndarray, where: np.ndarray, nearest: bool = False) -> np.ndarray:
    """The image (h, w) or (h, w, 3) taken from the places (h, w, 2) float32; `nearest` for masks."""
    import cv2

    way = cv2.INTER_NEAREST if nearest else cv2.INTER_CUBIC
    return np.asarray(cv2.remap(image, where[..., 0], where[..., 1], way, borderMode=cv2.BORDER_REPLICATE))


def _depth_between(uv: np.ndarray, depth: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Depths at places (m, 2): linear between the known ones at uv (k, 2), the nearest's beyond them."""
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
    from scipy.spatial import QhullError

    near = NearestNDInterpolator(uv, depth)(at)
    try:
        between = LinearNDInterpolator(uv, depth)(at)
    except QhullError:  # all on a line
        return np.asarray(near)
    return np.where(np.isfinite(between), between, near)


def _shift_of(views: Views, motion: Motion, readout: Readout, i: int, uv: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(k, 2) what the shutter moved pixels uv (k, 2) of view i at their depths [px]."""
    import cv2
    from scipy.spatial.transform import Rotation

    k, K, D = len(uv), views.K[i], views.distortion[i]
    ray = cv2.undistortPoints(uv[:, None].copy(), K, D)[:, 0]
    place = np.column_stack([ray * depth[:, None], depth])
    centre = views.R[i] @ motion.middle + views.t[i]
    lens = np.tile(K, (k, 1, 1)), np.tile(D, (k, 1))
    seen = uv
    for _ in range(3):  # where it is seen says when, and when says where
        late = readout.delays(seen, np.tile(views.size[i], (k, 1)))[:, None]
        moved = Rotation.from_rotvec(motion.turn[i] * late).apply(place - centre) + centre + motion.shift[i] * late
        seen = project_camera(*lens, moved)
    return seen - uv
