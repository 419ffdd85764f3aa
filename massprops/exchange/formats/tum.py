"""TUM: the trajectory that evo and SLAM benchmarks read, `timestamp tx ty tz qx qy qz qw` of the camera in body axes.

Seconds; the quaternion (scalar last) turns camera axes into the mesh's. Images without a clock are counted.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from massprops.dynamics.quaternion import from_rotation_matrix
from massprops.exchange.body import Body
from massprops.exchange.cameras import ORIGIN, camera_to_body, read_cameras

NAME = "tum"
SUFFIX = ".tum"
NEEDS_METRES = False
MESHES = False


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The trajectory as text."""
    views = read_cameras(body, NAME).views
    stamps = views.timestamp_ns
    seconds = stamps * 1e-9 if (stamps >= 0).all() else np.arange(len(stamps), dtype=float)
    pose = camera_to_body(views)
    q = from_rotation_matrix(pose[:, :3, :3])
    rows = np.column_stack([seconds, pose[:, :3, 3], q[:, [1, 2, 3, 0]]])[np.argsort(seconds, kind="stable")]
    head = [f"# {body.name}: {ORIGIN}", *(f"# {line}" for line in body.assumptions)]
    head.append("# timestamp tx ty tz qx qy qz qw")
    return "\n".join([*head, *(" ".join(f"{v:.12g}" for v in row) for row in rows)]) + "\n"
