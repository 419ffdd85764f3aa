"""Nerfstudio, and others that read `transforms.json`: intrinsics, image files and camera-to-world matrices.

Camera axes are OpenGL's there (x right, y up, looking along -z); the world is the mesh's axes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from massprops.errors import InputError
from massprops.exchange.body import Body
from massprops.exchange.cameras import ORIGIN, camera_to_body, read_cameras

NAME = "nerfstudio"
SUFFIX = "_transforms.json"
NEEDS_METRES = False
MESHES = False


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The document as text; images by their absolute paths."""
    cameras = read_cameras(body, NAME)
    views, pose = cameras.views, camera_to_body(cameras.views)
    pose[:, :3, 1:3] *= -1.0
    if views.distortion.shape[1] > 4:
        raise InputError(
            "--to nerfstudio: the camera is a fisheye, of another kind than that format describes: use --to colmap-text"
        )
    frames = []
    for i, name in enumerate(views.names):
        frame: dict[str, Any] = {"file_path": str((cameras.frames / name).resolve())}
        mask = cameras.frames.parents[2] / "masks" / f"{name}.png"
        if mask.is_file():
            frame["mask_path"] = str(mask.resolve())
        K = views.K[i]
        frame |= {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5}
        frame |= {"w": int(views.size[i, 0]), "h": int(views.size[i, 1])}
        frame |= dict(zip(("k1", "k2", "p1", "p2"), np.asarray(views.distortion[i], float).tolist(), strict=True))
        frames.append({**frame, "transform_matrix": pose[i].tolist()})
    notes = [ORIGIN, *body.remarks]
    return json.dumps({"camera_model": "OPENCV", "comment": "; ".join(notes), "frames": frames}, indent=1) + "\n"
