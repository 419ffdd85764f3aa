"""COLMAP's text model: a folder with `cameras.txt`, `images.txt` and `points3D.txt`, in the mesh's axes and units.

Poses there turn world into camera; the centre of the first pixel is at (0.5, 0.5).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from massprops.dynamics.quaternion import from_rotation_matrix
from massprops.exchange.body import Body
from massprops.exchange.cameras import ORIGIN, Cameras, read_cameras
from massprops.sfm.points import SparsePoints

NAME = "colmap-text"
SUFFIX = "_colmap"
NEEDS_METRES = False
MESHES = False
FOLDER = True


def render(body: Body, meshes: Mapping[str, str]) -> dict[str, str]:
    """The three files by their names."""
    cameras = read_cameras(body, NAME)
    head = "".join(f"# {line}\n" for line in (ORIGIN, *body.assumptions))
    views = cameras.views
    # one camera for each lens: alike in every number
    lens = np.column_stack([views.size, views.K[:, 0, 0], views.K[:, 1, 1], views.K[:, :2, 2] + 0.5, views.distortion])
    kinds, which = np.unique(lens, axis=0, return_inverse=True)
    model = "OPENCV" if views.distortion.shape[1] == 4 else "FULL_OPENCV"
    rows = [
        f"{k + 1} {model} {int(row[0])} {int(row[1])} " + " ".join(f"{v:.12g}" for v in row[2:])
        for k, row in enumerate(kinds)
    ]
    lists = _observations(cameras)
    return {
        "cameras.txt": head + "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n" + "\n".join(rows) + "\n",
        "images.txt": head + _images(cameras, which.ravel(), lists),
        "points3D.txt": head + _points(cameras, lists),
    }


def _observations(cameras: Cameras) -> list[np.ndarray]:
    """For each image, which rows of the observations are its own."""
    n = len(cameras.views)
    if cameras.points is None:
        return [np.zeros(0, int)] * n
    return [np.flatnonzero(cameras.points.obs_view == i) for i in range(n)]


def _images(cameras: Cameras, which: np.ndarray, lists: list[np.ndarray]) -> str:
    q = from_rotation_matrix(cameras.views.R)
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as (X, Y, POINT3D_ID)"]
    for i, name in enumerate(cameras.views.names):
        pose = " ".join(f"{v:.12g}" for v in (*q[i], *cameras.views.t[i]))
        lines.append(f"{i + 1} {pose} {which[i] + 1} {name}")
        lines.append(" ".join(_seen(cameras.points, row) for row in lists[i]) if cameras.points is not None else "")
    return "\n".join(lines) + "\n"


def _seen(points: SparsePoints, row: int) -> str:
    u, v = points.obs_uv[row] + 0.5
    return f"{u:.3f} {v:.3f} {int(points.obs_point[row]) + 1}"


def _points(cameras: Cameras, lists: list[np.ndarray]) -> str:
    points = cameras.points
    if points is None:
        return ""
    tracks: list[list[str]] = [[] for _ in range(len(points.xyz))]
    for i, rows in enumerate(lists):
        for place, row in enumerate(rows):
            tracks[int(points.obs_point[row])].append(f"{i + 1} {place}")
    lines = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"]
    for k, track in enumerate(tracks):
        where, colour = " ".join(f"{v:.12g}" for v in points.xyz[k]), " ".join(str(int(v)) for v in points.rgb[k])
        lines.append(f"{k + 1} {where} {colour} {points.error[k]:.6g} {' '.join(track)}")
    return "\n".join(lines) + "\n"
