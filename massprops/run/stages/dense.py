"""Stage `dense`: measured surface points by multi-view stereo."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from massprops.errors import NotPossible
from massprops.run.job import Job
from massprops.run.stage_images import mask_for_stereo, undistorted_frame

READS = ("capture", "silhouettes", "join")
OPTIONS = ("dense_views",)


def run(job: Job) -> dict[str, Any]:
    """Writes points.npz and dense.json."""

    from massprops.dense.fusion import nothing_measured
    from massprops.dense.reconstruct import DenseOptions, dense_points
    from massprops.sfm.points import SparsePoints
    from massprops.views import Views

    views = Views.load(job.work("join") / "views.npz")
    sparse = SparsePoints.load(job.work("join") / "points.npz")
    footage = json.loads((job.work("capture") / "footage.json").read_text())
    place = json.loads((job.work("join") / "join.json").read_text())
    if not len(sparse.xyz) and place.get("middle") is not None:
        # poses that were given without points: the ball that holds the object says how deep it lies
        sparse = SparsePoints.filling(np.array(place["middle"], float), float(place["radius"]))

    def image(i: int) -> tuple[np.ndarray, np.ndarray]:
        return undistorted_frame(job, views, i), mask_for_stereo(job, views, i, footage)

    try:
        options = DenseOptions(job.options.dense_views, job.seed, job.threads)
        points, facts = dense_points(views, image, sparse, options, job.progress, job.parts)
    except NotPossible as error:
        if place.get("middle") is None:
            raise
        job.warn(f"nothing could be measured on the object: its outlines alone give the shape ({error})")
        points, facts = nothing_measured(), {"points": 0, "reason": str(error)}
    np.savez(job.out / "points.npz", **vars(points))
    (job.out / "dense.json").write_text(json.dumps(facts, indent=1))
    return facts
