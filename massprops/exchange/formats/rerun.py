"""Rerun: a recording with the mesh, the centre of mass and axes, the cameras over time and the sparse points.

Needs the optional extra `rerun`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from massprops.errors import InputError
from massprops.exchange.body import Body
from massprops.exchange.cameras import Cameras, read_cameras

NAME = "rerun"
SUFFIX = ".rrd"
NEEDS_METRES = False
MESHES = False
COLOURS = ((242, 115, 38), (64, 179, 89), (77, 140, 250))


def render(body: Body, meshes: Mapping[str, str]) -> bytes:
    """The recording's bytes."""
    try:
        import rerun as rr
    except ImportError:
        raise InputError("--to rerun needs rerun-sdk: pip install 'massprops[rerun]'") from None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "out.rrd"
        recording = rr.RecordingStream("massprops", recording_id=body.name)
        recording.save(str(path))
        _log_body(rr, recording, body)
        # what `massprops mass` made has no cameras
        if body.run is not None and (body.run / "work" / "sfm").is_dir():
            _log_cameras(rr, recording, read_cameras(body, NAME))
        recording.flush()
        recording.disconnect()
        return path.read_bytes()


def _log_body(rr: Any, recording: Any, body: Body) -> None:
    from massprops.exchange.collision import collision_mesh

    mesh = collision_mesh(body.mesh, 150_000)
    surface = rr.Mesh3D(
        vertex_positions=np.asarray(mesh.vertices, np.float32),
        triangle_indices=np.asarray(mesh.faces, np.uint32),
        vertex_normals=np.asarray(mesh.vertex_normals, np.float32),
    )
    recording.log("body/mesh", surface, static=True)
    length = 0.6 * float(np.linalg.norm(np.ptp(np.asarray(mesh.vertices), axis=0)))
    axes = np.array(body.document["principal_axes"], float).T * length
    arrows = rr.Arrows3D(vectors=axes, origins=[body.center_of_mass] * 3, colors=COLOURS, labels=["I1", "I2", "I3"])
    recording.log("body/principal_axes", arrows, static=True)
    recording.log("body/notes", rr.TextDocument("\n".join(body.remarks)), static=True)


def _log_cameras(rr: Any, recording: Any, cameras: Cameras) -> None:
    views = cameras.views
    if cameras.points is not None:
        points = rr.Points3D(cameras.points.xyz.astype(np.float32), colors=cameras.points.rgb)
        recording.log("points", points, static=True)
    clock = bool((views.timestamp_ns >= 0).all())
    for i, centre in enumerate(views.centres):
        if clock:
            recording.set_time("time", duration=float(views.timestamp_ns[i]) * 1e-9)
        else:
            recording.set_time("image", sequence=i)
        recording.log("camera", rr.Transform3D(translation=centre, mat3x3=views.R[i].T))
        recording.log("camera/image", rr.Pinhole(image_from_camera=views.K[i], resolution=views.size[i]))
