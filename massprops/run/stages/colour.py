"""Stage `colour`: the photographs' colours on the mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.run.job import Job
from massprops.run.stage_images import undistorted_frame

READS = ("capture", "join", "surface")
OPTIONS = ()


def run(job: Job) -> dict[str, Any]:
    """Writes colour.npz: rgb (v, 3) uint8 of the surface's vertices, and which of them were seen."""
    from massprops.surface.colour import vertex_colours
    from massprops.views import Views

    views = Views.load(job.work("join") / "views.npz")
    with np.load(job.work("surface") / "surface.npz", allow_pickle=False) as z:
        vertices, faces = z["vertices"], z["faces"]

    def image(i: int) -> np.ndarray:
        job.progress(i + 1, len(views), "colours")
        return undistorted_frame(job, views, i)

    rgb, seen = vertex_colours(vertices, faces, views, image)
    np.savez(job.out / "colour.npz", rgb=rgb, seen=seen)
    return {"seen": float(seen.mean())}
