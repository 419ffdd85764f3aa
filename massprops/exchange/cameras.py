"""The cameras of a run, in the units and axes of its mesh, for the formats that carry them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from massprops.documents.scale_json import has_scale, read_scale
from massprops.errors import InputError
from massprops.exchange.body import Body
from massprops.sfm.footage import frames_folder
from massprops.sfm.points import SparsePoints
from massprops.views import Views

ORIGIN = "camera poses and points in the mesh's axes and units: the object is at rest, the camera moves round it"


@dataclass(frozen=True)
class Cameras:
    """views: registered images, poses in final units; points: sparse points, likewise, or None; frames: their folder."""

    views: Views
    points: SparsePoints | None
    frames: Path


def read_cameras(body: Body, to: str) -> Cameras:
    """The cameras of a body's run.

    Args:
        body: of a run folder. to: name of the format, for the message.

    Raises:
        InputError: a bare mesh, or a run without cameras.
    """

    if body.run is None:
        raise InputError(f"--to {to}: needs the cameras of a run: give a run folder in place of a mesh")
    work = body.run / "work"
    try:
        views = Views.load(work / "sfm" / "views.npz")
    except (OSError, ValueError, KeyError):
        raise InputError(f"{body.run}: no cameras in work/sfm, which --to {to} needs: make the run again") from None
    factor = read_scale(body.run).factor if has_scale(body.run) else 1.0
    try:
        points: SparsePoints | None = SparsePoints.load(work / "sfm" / "points.npz")
    except (OSError, ValueError, KeyError):
        points = None
    if points is not None:
        points = replace(points, xyz=points.xyz * factor)
    return Cameras(replace(views, t=views.t * factor), points, frames_folder(work))


def camera_to_body(views: Views) -> np.ndarray:
    """(n, 4, 4) from camera axes (x right, y down, z forward) to the mesh's axes."""
    out = np.tile(np.eye(4), (len(views), 1, 1))
    out[:, :3, :3] = np.swapaxes(views.R, 1, 2)
    out[:, :3, 3] = views.centres
    return out
