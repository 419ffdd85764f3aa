"""Stage: metres per model unit, from whatever the footage or the user gives."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.mass.integrals import centroid
from massprops.run.job import Job

if TYPE_CHECKING:
    from massprops.sequence.data import RangeSeries

READS = ("capture", "sfm", "surface")
OPTIONS = ("scale", "scale_sigma", "distance", "marker")


def run(job: Job) -> dict[str, Any]:
    """Writes scale.json."""
    from massprops.sfm.footage import frames_folder, read_footage
    from massprops.sfm.points import SparsePoints
    from massprops.sfm.scale import ScaleInputs, find_scale
    from massprops.sfm.scale.distance import read_named
    from massprops.surface.length import model_length
    from massprops.views import Views

    job.progress(0, 1, "scale")
    with np.load(job.work("surface") / "surface.npz", allow_pickle=False) as z:
        vertices, faces, observed = z["vertices"], z["faces"], z["observed"].astype(bool)
    sfm = json.loads((job.work("sfm") / "sfm.json").read_text())
    footage = read_footage(job.work("capture"))
    o = job.options
    inputs = ScaleInputs(
        length=model_length(vertices, faces, observed)[0],
        views=Views.load(job.work("sfm") / "views.npz"),
        points=SparsePoints.load(job.work("sfm") / "points.npz"),
        centre_of_mass=centroid(vertices, faces),
        frames=frames_folder(job.run / "work"),
        range=_range(Path(o.source)) if footage.motion == "tumbling" else None,
        rig_metres=sfm.get("scale_metres_per_unit"),
        focal_sigma=float(sfm.get("focal_sigma_relative") or 0.0),
        given=o.scale,
        given_sigma=o.scale_sigma,
        distance=o.distance,
        named=read_named(Path(o.source)),
        marker=o.marker,
    )
    scale = find_scale(inputs)
    for line in scale.warnings:
        job.warn(line)
    document = scale.document()
    (job.out / "scale.json").write_text(json.dumps(document, indent=1))
    job.progress(1, 1, "scale")
    return {k: document[k] for k in ("source", "metres_per_unit", "relative_sigma")}


def _range(source: Path) -> RangeSeries | None:
    from massprops.sequence.read import sequence_with

    sequence = sequence_with(source, "range0")
    return None if sequence is None else sequence.range
