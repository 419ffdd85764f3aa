"""What the viewer of a run shows beside the mesh: cameras, cloud, in how many images a place was seen, and the film."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from massprops.documents.arrays import open_arrays
from massprops.report.data import RunData
from massprops.report.html import data_uri
from massprops.report.thumbnail import thumbnail
from massprops.sfm.footage import frame_file

MOST_POINTS, MOST_FRAMES, FILM_WIDTH = 12_000, 60, 220
FRUSTUM = 0.22
"""Depth of a drawn camera over the body's reach."""


@dataclass(frozen=True)
class Frame:
    """One image of the film. image: data address; label: its time or name; R: (3, 3) mesh axes to camera."""

    image: str
    label: str
    R: np.ndarray


@dataclass(frozen=True)
class Scene:
    """In the mesh's axes and units; every part may be empty.

    Attributes:
        frusta: (n, 5, 3) camera centres and the corners of what they see.
        points: (p, 3) of the cloud; colours: (p, 3) uint8.
        seen_in: (v,) images that measured each vertex of the shape, or None.
        film: frames in the order of time.
        still: the body stood still, so that the film goes round it.
    """

    frusta: np.ndarray = field(default_factory=lambda: np.zeros((0, 5, 3)))
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    colours: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    seen_in: np.ndarray | None = None
    film: tuple[Frame, ...] = ()
    still: bool = False


def read_scene(data: RunData) -> Scene:
    """The scene of a run; parts whose files are missing or changed are left out."""
    frusta = np.zeros((0, 5, 3)) if data.views is None else frusta_of(data)
    cloud = None if "work/dense" in data.changed else _cloud(data.folder / "work" / "dense" / "points.npz")
    points, colours, seen_in = np.zeros((0, 3)), np.zeros((0, 3), np.uint8), None
    if cloud is not None:
        xyz, rgb, views = cloud
        keep = np.unique(np.linspace(0, len(xyz) - 1, min(MOST_POINTS, len(xyz))).astype(int))
        points, colours = xyz[keep] * data.factor, rgb[keep]
        if data.shape is not None:
            seen_in = seen_in_images(data.shape.vertices, xyz * data.factor, views)
    still = data.facts.get("footage", {}).get("motion") == "static"
    return Scene(frusta, points, colours, seen_in, film_of(data), still)


def frusta_of(data: RunData) -> np.ndarray:
    """(n, 5, 3) camera centres and the four corners at `FRUSTUM` of the body's reach before them."""
    views, centres = data.views, data.camera_centres
    reach = 1.0 if data.shape is None else float(np.ptp(data.shape.vertices, axis=0).max())
    width, height = views.size[:, 0].astype(float), views.size[:, 1].astype(float)
    corners = np.stack([[[0, 0, 1], [w, 0, 1], [w, h, 1], [0, h, 1]] for w, h in zip(width, height, strict=True)])
    rays = np.einsum("nij,nkj->nki", np.linalg.inv(views.K), corners.astype(float))
    world = np.einsum("nji,nkj->nki", views.R, rays)
    return np.concatenate([centres[:, None], centres[:, None] + FRUSTUM * reach * world], axis=1)


def _cloud(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Points (p, 3) [units of the structure from motion], colours (p, 3), and how many images measured each (p,)."""
    try:
        with open_arrays(path) as z:
            xyz, rgb, start = z["xyz"].astype(float), z["rgb"], z["view_start"]
    except (OSError, ValueError, KeyError):
        return None
    if not (len(xyz) and len(rgb) == len(xyz) == len(start) - 1):
        return None
    return xyz, rgb, np.diff(start)


def seen_in_images(vertices: np.ndarray, points: np.ndarray, views: np.ndarray) -> np.ndarray:
    """(v,) images of the nearest cloud point of each vertex; 0 where none is near.

    Args:
        vertices: (v, 3); points: (p, 3); views: (p,) images of each point.
    """
    from scipy.spatial import cKDTree

    away, nearest = cKDTree(points).query(vertices)
    near = away < 0.02 * float(np.ptp(vertices, axis=0).max())
    return np.where(near, views[nearest], 0)


def film_of(data: RunData) -> tuple[Frame, ...]:
    """Small images of the placed frames with the attitude that each was found in."""
    import cv2

    if data.views is None:
        return ()
    order = np.argsort(data.views.timestamp_ns, kind="stable")
    first = [i for i in order if data.views.names[i].split("/")[0] == data.views.names[order[0]].split("/")[0]]
    film_frames = []
    for i in np.array(first)[np.unique(np.linspace(0, len(first) - 1, MOST_FRAMES).astype(int))]:
        image = cv2.imread(str(frame_file(data.folder / "work", data.views.names[i])))
        if image is None:
            continue
        stamp = int(data.views.timestamp_ns[i])
        label = f"{stamp / 1e9:.2f} s" if stamp >= 0 else f"image {len(film_frames) + 1}"
        small = thumbnail(image, None, FILM_WIDTH)
        film_frames.append(Frame(data_uri(small, quality=60), label, data.views.R[i]))
    return tuple(film_frames) if len(film_frames) > 1 else ()


def packed_scene(scene: Scene, middle: np.ndarray, size: float) -> dict[str, Any]:
    """The scene for the page, in units of the body's reach `size` about its middle (3,)."""
    from massprops.report.html import packed

    points = np.clip((scene.points - middle) / size, -2, 2)
    return {
        "frusta": np.round((scene.frusta - middle) / size, 4).tolist(),
        "points": packed(np.round(points * 16383).astype("<i2")) if len(points) else None,
        "pointColours": packed(scene.colours.astype(np.uint8)) if len(points) else None,
        "seenIn": None if scene.seen_in is None else packed(np.minimum(scene.seen_in, 255).astype(np.uint8)),
        "film": [{"image": f.image, "label": f.label, "R": np.round(f.R, 5).tolist()} for f in scene.film],
    }
