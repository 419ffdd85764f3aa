"""What all images show of a placement that stereo did not measure, put to its first shape at the end of the shape stage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from massprops.run.drawn_silhouettes import EVIDENCE, own_points
from massprops.run.job import Job
from massprops.run.stage_images import undistorted_frame
from massprops.views import Views

COMPANY, LEAST_COMPANY = 4.0, 3
"""A point of another thing has so many points, itself among them, within so many pixels: one alone may be a wrong match."""


def with_company(xyz: np.ndarray, within: float) -> np.ndarray:
    """The points (m, 3) that do not stand alone among (n, 3)."""
    from scipy.spatial import cKDTree

    if not len(xyz):
        return xyz
    tree = cKDTree(xyz)
    return xyz[tree.query_ball_point(xyz, within, return_length=True) >= LEAST_COMPANY]


def completed(job: Job, views: Views, folder: Path, placement: dict[str, Any]) -> int:
    """Puts the parts of a placement that all images show to its `shape.npz`, and writes what the images show of its support; gives
    how many parts.

    Args:
        views: all views; folder: of the placement's files; placement: what `shape.json` says of it.
    """
    from massprops.capture.completed import evidence_of, missing_parts
    from massprops.capture.support_evidence import Looked, foot_picture, learned, reduced, reduced_image
    from massprops.dense.region import pixel_size, region_of
    from massprops.surface.cloud import Cloud

    if placement["support_plane"] is None:
        return 0
    plane = np.array(placement["support_plane"])
    row = {name: i for i, name in enumerate(views.names)}
    here = views.take(np.array([row[name] for name in placement["images"]]))
    small = reduced(here)
    with np.load(folder / "shape.npz", allow_pickle=False) as z:
        vertices, faces = z["vertices"], z["faces"]
    other = Cloud.load(folder / "other.npz").xyz
    pixel = pixel_size(small, region_of(here))
    standing = with_company(other[other @ plane[:3] + plane[3] > placement["support_rise"]], COMPANY * pixel)

    # they are looked at up to nine times
    images = [reduced_image(undistorted_frame(job, here, i), small, i) for i in range(len(here))]

    def looked_at(vertices: np.ndarray, faces: np.ndarray) -> Looked:
        return Looked.at(small, images.__getitem__, plane, (vertices, faces), standing, pixel)

    evidence = evidence_of(looked_at(vertices, faces))
    parts = [part for part in missing_parts(evidence, plane, vertices, standing, pixel) if part.sure]
    if parts:
        measured = len(faces)
        for part in parts:
            faces = np.concatenate([faces, part.faces + len(vertices)])
            vertices = np.concatenate([vertices, part.vertices])
        np.savez(folder / "shape.npz", vertices=vertices, faces=faces, measured=measured)
        # places that the parts hide are not the support's
        evidence = evidence_of(looked_at(vertices, faces))
    foot = foot_picture(evidence.seen, own_points(folder))
    learned(evidence.seen, (foot, evidence.picture)).save(folder / EVIDENCE)
    return len(parts)
