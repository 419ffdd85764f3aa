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
from massprops.sfm.footage import FootageRecord
from massprops.sfm.points import SparsePoints, project_camera, residuals
from massprops.sfm.row_motion import Motion, Readout, Seen
from massprops.views import Views

GRID = 4
"""Depth and shift are computed at one pixel of so many, in each direction: both change slowly."""


FARTHEST = 1.0
"""Observations that do not fit by more [px] give no depth."""


def write_global(footage: FootageRecord, seen: Seen, readout: Readout, folder: Path) -> None:
    """Writes `frames/` and `masks/` of the placed images into a new folder, warped.

    Args:
        seen: the model adjusted with the readout.

    Raises:
        OSError: an image of the footage cannot be read.
    """
    fit = np.linalg.norm(residuals(seen.views, seen.points), axis=1) < FARTHEST
    points = seen.points.observed(fit)
    for i, name in enumerate(seen.views.names):
        where = shutter_map(seen.views, points, seen.motion, readout, i)
        write_image(folder / "frames" / name, warped(read_image(footage.image(name)), where))
        if footage.mask(name).is_file():
            mask = read_image(footage.mask(name), 0)
            write_image(folder / "masks" / f"{name}.png", warped(mask, where, nearest=True))


def shutter_map(views: Views, points: SparsePoints, motion: Motion, readout: Readout, i: int) -> np.ndarray:
    """Where the pixels of view i, as a global shutter would see them, lie in its image: (h, w, 2) float32 [px].

    Args:
        points: with observations as a global shutter would see them.
    """
    import cv2

    w, h = (int(s) for s in views.size[i])
    u, v = np.meshgrid(np.arange(0, w + GRID, GRID, dtype=float), np.arange(0, h + GRID, GRID, dtype=float))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    own = points.obs_view == i
    if not motion.known[i] or own.sum() < 4:
        shift = np.zeros_like(uv)
    else:
        z = points.xyz[points.obs_point[own]] @ views.R[i, 2] + views.t[i, 2]
        shift = _shift_of(views, motion, readout, i, uv, _depth_between(points.obs_uv[own], z, uv))
    coarse = shift.reshape(*u.shape, 2).astype(np.float32)
    # pixel k of the coarse grid is pixel GRID k of the image
    at = np.stack(np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32)), axis=2)
    fine = cv2.remap(coarse, at[..., 0] / GRID, at[..., 1] / GRID, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    out: np.ndarray = at + fine
    return out


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
    shift: np.ndarray = seen - uv
    return shift
