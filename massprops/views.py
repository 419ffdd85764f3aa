"""The registered images of a reconstruction as plain arrays: what dense stereo and surfaces read.

Nothing here needs pycolmap, so stages that use numba or open3d never load it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from massprops.documents.arrays import open_arrays

AMBIGUOUS = 128
"""Value of a silhouette's pixel of which it cannot be told whether it shows the object; 255 does, 0 does not."""


def entries(start: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Entries of some rows of lists kept end to end, row i from start[i] to start[i + 1].

    Returns:
        (k,) which of `rows` each entry belongs to, and (k,) its place in the whole.
    """
    count = np.diff(start)[rows]
    which = np.repeat(np.arange(len(rows)), count)
    return which, (start[rows] - (np.cumsum(count) - count))[which] + np.arange(len(which))


ARRAYS = ("timestamp_ns", "size", "K", "distortion", "R", "t")
"""The arrays of `Views`, one row for each image, in order."""


LENSES = 4
"""Of so many lenses, where each pixel lies undistorted is kept: it takes longer to find than to use."""


@dataclass(frozen=True)
class Views:
    """n registered images with pinhole cameras in one world frame.

    The world of a tumbling body is the body itself; of a still object, the table. Lengths are in the units of
    the reconstruction. Camera axes: x right, y down, z forward.

    Attributes:
        names: frame names relative to `frames/`, for example `cam0/000012.png`.
        timestamp_ns: (n,) int64, -1 where the source has no clock.
        size: (n, 2) int, width and height [px].
        K: (n, 3, 3) pinhole matrix after undistortion [px].
        distortion: (n, 4) OpenCV k1, k2, p1, p2 of the original image; (n, 8) with k3 to k6 of the rational model
            where a lens is a fisheye.
        R: (n, 3, 3) rotates world vectors into the camera.
        t: (n, 3) world origin in the camera.
    """

    names: tuple[str, ...]
    timestamp_ns: np.ndarray
    size: np.ndarray
    K: np.ndarray
    distortion: np.ndarray
    R: np.ndarray
    t: np.ndarray

    def __len__(self) -> int:
        return len(self.names)

    @property
    def centres(self) -> np.ndarray:
        """(n, 3) camera centres in the world."""
        return -np.einsum("nij,ni->nj", self.R, self.t)

    @property
    def of_first_camera(self) -> np.ndarray:
        """(n,) bool: taken by cam0, or by the cameras of a folder without cameras."""
        return np.array([n.startswith("cam0/") or "/" not in n for n in self.names], bool)

    @property
    def folders(self) -> np.ndarray:
        """(n,) str, the folder of each name: one for each camera."""
        return np.array([name.rpartition("/")[0] for name in self.names])

    def take(self, index: np.ndarray) -> Views:
        """The views at `index` (integers or a mask)."""
        index = np.arange(len(self))[index]
        return Views(tuple(self.names[i] for i in index), *(getattr(self, k)[index] for k in ARRAYS))

    def moved(self, R: np.ndarray, t: np.ndarray) -> Views:
        """The same images of a world that was moved: x becomes R x + t, R (3, 3), t (3,)."""
        turned = self.R @ R.T
        return replace(self, R=turned, t=self.t - turned @ t)

    def move_from(self, i: int, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3, 3) and (3,) that carry another world, in which view i has the pose R (3, 3), t (3,), to this one."""
        return self.R[i].T @ R, self.R[i].T @ (t - self.t[i])

    @staticmethod
    def joined(parts: list[Views]) -> Views:
        """All views of several sets in one world."""
        names = tuple(name for part in parts for name in part.names)
        return Views(names, *(np.concatenate([getattr(part, k) for part in parts]) for k in ARRAYS))

    def save(self, path: Path) -> None:
        """Writes one `.npz` without pickled objects."""
        np.savez(path, names=np.array(self.names, dtype=np.str_), **{k: getattr(self, k) for k in ARRAYS})

    @staticmethod
    def load(path: Path) -> Views:
        """Reads what `save` wrote."""
        with open_arrays(path) as z:
            names = tuple(str(s) for s in z["names"])
            return Views(names, *(z[k] for k in ARRAYS))


def undistort(image: np.ndarray, K: np.ndarray, distortion: np.ndarray, nearest: bool = False) -> np.ndarray:
    """The image as a pinhole camera with the same matrix would have taken it.

    Args:
        image: (h, w) or (h, w, 3) uint8.
        K: (3, 3) [px].
        distortion: (4,) OpenCV k1, k2, p1, p2, or (8,) with k3 to k6.
        nearest: take the nearest pixel, for masks.
    """
    if not np.any(distortion):
        return image
    import cv2

    h, w = image.shape[:2]
    maps = _undistorting((w, h), *_lens(K, distortion))
    return np.asarray(cv2.remap(image, *maps, cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR))


def distort(image: np.ndarray, K: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """The image (h, w) of a pinhole camera as the lens with the same matrix shows it; arguments as those of `undistort`."""
    if not np.any(distortion):
        return image
    import cv2

    h, w = image.shape[:2]
    return np.asarray(cv2.remap(image, *_distorting((w, h), *_lens(K, distortion)), cv2.INTER_LINEAR))


def _lens(K: np.ndarray, distortion: np.ndarray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """K (3, 3) and the distortion as numbers by which what is found for a lens is kept."""
    return tuple(np.ravel(K).tolist()), tuple(np.ravel(distortion).tolist())


@lru_cache(maxsize=LENSES)
def _undistorting(
    size: tuple[int, int], K: tuple[float, ...], distortion: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Where in an image each pixel of the pinhole camera lies, (h, w) columns and rows; size: width, height [px]."""
    import cv2

    k, d = np.reshape(K, (3, 3)), np.array(distortion)
    return cv2.initUndistortRectifyMap(k, d, np.eye(3), k, size, cv2.CV_32FC1)


@lru_cache(maxsize=LENSES)
def _distorting(
    size: tuple[int, int], K: tuple[float, ...], distortion: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Where in the pinhole camera's image each pixel of the lens lies, (h, w) columns and rows; size: width, height [px]."""
    import cv2

    k, d = np.reshape(K, (3, 3)), np.array(distortion)
    w, h = size
    u, v = np.meshgrid(np.arange(w, dtype=np.float64), np.arange(h, dtype=np.float64))
    at = cv2.undistortPoints(np.column_stack([u.ravel(), v.ravel()])[:, None], k, d, P=k).reshape(h, w, 2)
    return at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)
