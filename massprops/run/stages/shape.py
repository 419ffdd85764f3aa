"""Stage `shape`: a still object found in space, before there is any silhouette.

Dense stereo of all that lies about what the cameras look at; the plane that carries it; the piece that stands on the
plane; a first closed shape of that piece, carved by the lines of sight of everything else.
"""

from __future__ import annotations

import json

import numpy as np

from massprops.errors import NotPossible
from massprops.run.files import read_image
from massprops.run.job import Job

READS = ("capture", "sfm")
OPTIONS = ()

REFERENCES = 30
"""Depth maps of the first, rough stereo."""
PIXELS = 40_000
"""Pixels of the region in each of them."""
POINTS = 20_000
"""Points that carry the first shape."""
LEAST_POINTS = 500
"""Dense points of the object without which there is no shape."""


def run(job: Job) -> dict:
    """Writes shape.npz (vertices, faces), object.npz and other.npz (dense points), and shape.json.

    Footage whose silhouettes the capture stage knows needs none of it: then only shape.json is written.
    """
    from massprops.capture.support import find_support, region_of, split
    from massprops.surface.cloud import Cloud
    from massprops.surface.reconstruct import reconstruct_surface
    from massprops.views import Views

    views = Views.load(job.work("sfm") / "views.npz")
    if all((job.work("capture") / "masks" / f"{name}.png").is_file() for name in views.names):
        return _said(job, {"found": False, "support_plane": None})
    region = region_of(views)
    cloud = _dense(job, views, region)
    plane = find_support(cloud.xyz, cloud.normal, views.centres, region, job.seed)
    pixel = float(np.median(np.linalg.norm(views.centres - region.centre, axis=1) / views.K[:, 0, 0]))
    found = split(cloud.xyz, cloud.normal, plane, region, pixel)
    if found.member.sum() < LEAST_POINTS:
        what = "nothing stands out" if plane is None else "nothing rises from the plane"
        raise NotPossible(
            f"{what} where the cameras look: keep the object in the middle of the images, give it texture or side light, "
            "or give its silhouettes with --masks"
        )
    job.progress(0, 1, "first shape")
    own, other = cloud.take(np.flatnonzero(found.member)), cloud.take(np.flatnonzero(found.other))
    surface = reconstruct_surface(
        views, [], own, POINTS, job.seed, job.progress, found.plane, moving=False, surroundings=other, fill=0.0
    )
    np.savez(job.out / "shape.npz", vertices=surface.vertices, faces=surface.faces)
    for name, part in (("object", own), ("other", other)):
        np.savez(job.out / f"{name}.npz", **{k: getattr(part, k) for k in Cloud.__dataclass_fields__})
    return _said(
        job,
        {
            "found": True,
            "support_plane": None if found.plane is None else found.plane.tolist(),
            "object_points": int(found.member.sum()),
            "other_points": int(found.other.sum()),
            "region_radius": region.radius,
        },
    )


def _said(job: Job, facts: dict) -> dict:
    (job.out / "shape.json").write_text(json.dumps(facts, indent=1))
    return facts


def _dense(job: Job, views, region):  # type: ignore[no-untyped-def]
    """Dense points of the region, whatever they belong to."""
    from massprops.dense.reconstruct import dense_points
    from massprops.surface.cloud import Cloud
    from massprops.views import undistort

    with np.load(job.work("sfm") / "points.npz", allow_pickle=False) as z:
        xyz, obs_view, obs_point = z["xyz"], z["obs_view"], z["obs_point"]
    # the depth range of a view comes from its sparse points
    near = np.linalg.norm(xyz - region.centre, axis=1) < 1.3 * region.radius
    seen = near[obs_point]
    number = np.cumsum(near) - 1

    def image(i: int) -> tuple[np.ndarray, np.ndarray]:
        colour = read_image(job.work("capture") / "frames" / views.names[i])
        return undistort(colour, views.K[i], views.distortion[i]), region.mask(views, i)

    points, _ = dense_points(
        views, image, xyz[near], obs_view[seen], number[obs_point[seen]], REFERENCES, job.seed, job.threads,
        job.progress, PIXELS,
    )  # fmt: skip
    return Cloud(*(np.asarray(getattr(points, k)) for k in Cloud.__dataclass_fields__)).finite()
