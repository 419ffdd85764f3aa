"""What all images show of a placement that stereo did not measure, put to its first shape at the end of the shape stage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from massprops.run.job import Job
from massprops.run.stage_images import undistorted_frame
from massprops.views import Views

LOOKED_AT = 800
"""Longer side to which images are reduced [px]: the outline's own pixels are the silhouettes stage's."""


def reduced(views: Views) -> tuple[Views, np.ndarray]:
    """The views at the size in which they are looked at, and by how much each was reduced (n,)."""
    factor = np.minimum(1.0, LOOKED_AT / views.size.max(1))
    size = np.rint(views.size * factor[:, None]).astype(views.size.dtype)
    scale = size / views.size
    K = views.K.copy()
    K[:, :2] *= scale[:, :, None]
    K[:, :2, 2] += 0.5 * scale - 0.5
    return replace(views, size=size, K=K), scale[:, 0]


def reduced_image(job: Job, views: Views, small: Views, i: int) -> np.ndarray:
    """View i (h, w, 3) uint8, undistorted, in the size of `small` views."""
    import cv2

    image = undistorted_frame(job, views, i)
    size = (int(small.size[i, 0]), int(small.size[i, 1]))
    return image if image.shape[1::-1] == size else cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def completed(job: Job, views: Views, folder: Path, placement: dict[str, Any]) -> int:
    """Puts the parts of a placement that all images show to its `shape.npz`, and what the images show of its support into
    `picture.npz` and `evidence.npy`; gives how many parts.

    Args:
        views: all views; folder: of the placement's files; placement: what `shape.json` says of it.
    """
    from massprops.capture.completed import PlacementEvidence, evidence_of, missing_parts
    from massprops.dense.region import pixel_size, region_of
    from massprops.surface.cloud import Cloud

    if placement["support_plane"] is None:
        return 0
    plane = np.array(placement["support_plane"])
    row = {name: i for i, name in enumerate(views.names)}
    here = views.take(np.array([row[name] for name in placement["images"]]))
    small, _ = reduced(here)
    with np.load(folder / "shape.npz", allow_pickle=False) as z:
        vertices, faces = z["vertices"], z["faces"]
    other = Cloud.load(folder / "other.npz").xyz
    standing = other[other @ plane[:3] + plane[3] > placement["support_rise"]]
    pixel = pixel_size(small, region_of(here))

    def seen(vertices: np.ndarray, faces: np.ndarray) -> PlacementEvidence:
        return evidence_of(
            small, lambda i: reduced_image(job, here, small, i), plane, (vertices, faces), standing, pixel
        )

    found = seen(vertices, faces)
    parts = [part for part in missing_parts(found, plane, vertices, standing, pixel) if part.sure]
    if not parts:
        return 0
    measured = len(faces)
    for part in parts:
        faces = np.concatenate([faces, part.faces + len(vertices)])
        vertices = np.concatenate([vertices, part.vertices])
    np.savez(folder / "shape.npz", vertices=vertices, faces=faces, measured=measured)
    # places that the parts hide are not the support's
    found = seen(vertices, faces)
    found.picture.save(folder / "picture.npz")
    np.save(folder / "evidence.npy", found.evidence.log_odds)
    return len(parts)


def shown_beside(job: Job, views: Views, folder: Path, i: int, place: int) -> np.ndarray | None:
    """(h, w) float32: log odds of something before the support in view i; None where no part was put to the shape.

    Args:
        views: all views; folder: of the placement; place: of the view among the placement's images.
    """
    import cv2

    from massprops.capture.support_picture import SupportPicture
    from massprops.capture.votes import Evidence

    if not (folder / "picture.npz").is_file():
        return None
    picture = SupportPicture.load(folder / "picture.npz").of_image(place)
    evidence = Evidence(np.load(folder / "evidence.npy", allow_pickle=False))
    one = views.take(np.array([i]))
    small, _ = reduced(one)
    odds = evidence.of(*picture.off(small, 0, reduced_image(job, one, small, 0)))
    w, h = (int(v) for v in views.size[i])
    return odds if odds.shape == (h, w) else cv2.resize(odds, (w, h), interpolation=cv2.INTER_LINEAR)
