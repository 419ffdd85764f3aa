"""Stage: dense points and silhouettes -> a closed mesh, which of its faces were measured, and its replicates."""

from __future__ import annotations

import json

import numpy as np

from massprops.core.inputs import read_image
from massprops.errors import NotPossible
from massprops.run.job import Job

READS = ("capture", "sfm", "silhouettes", "join", "dense")
OPTIONS = ("seed",)

FAR = 15.0
"""Spacings of the mesh beyond which a measured point is not on it."""
MOST_LOST = 0.03
"""Above this share of measured points that lie far off the mesh, a part of the body is missing in it."""
NOTHING_LEFT = 0.5
"""Above this share the mesh is not what was measured."""
MOST_FILLED = 0.6
"""Above this share of filled area the mesh is kept, but called partial."""
FOCAL_SIGMA = 0.003
"""Relative 1-sigma of a self-calibrated focal length when the structure from motion could not give its own."""

BALL = 1.4
"""Radius in which a body known by its outlines alone is looked for, in radii of its first shape."""


def lost_share(vertices: np.ndarray, xyz: np.ndarray, far: float) -> float:
    """Share of points (n, 3) that lie farther than `far` from every vertex (v, 3)."""
    from scipy.spatial import cKDTree

    return float(np.mean(cKDTree(vertices).query(xyz, distance_upper_bound=far)[0] > far))


def run(job: Job) -> dict:
    """Writes surface.npz (vertices, faces, observed, replicate_integrals, replicate_length) and surface.json."""
    import cv2

    from massprops.surface.cloud import Cloud
    from massprops.surface.outline_cloud import surface_of_outlines
    from massprops.surface.reconstruct import reconstruct_surface
    from massprops.surface.silhouette import agreement, shown_as_object
    from massprops.surface.spread import replicates
    from massprops.surface.unlit import spare_unlit
    from massprops.views import Views, undistort

    views = Views.load(job.work("join") / "views.npz")
    footage = json.loads((job.work("capture") / "footage.json").read_text())
    sfm = json.loads((job.work("sfm") / "sfm.json").read_text())
    masks = []
    for i, name in enumerate(views.names):
        path = job.work("silhouettes") / "masks" / f"{name}.png"
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if mask is None:
            raise NotPossible(f"surface: silhouette {path.name} is missing; run the silhouettes again")
        masks.append(undistort(mask, views.K[i], views.distortion[i], nearest=True))
    cloud = Cloud.load(job.work("dense") / "points.npz")
    place = json.loads((job.work("join") / "join.json").read_text())
    stand = place["support_plane"]
    support = None if stand is None else np.array(stand, float)
    # what turns on a support is no free body: other things may stand there
    tumbling, given = footage["motion"] == "tumbling" and support is None, bool(footage["masks_given"])
    # one still camera before black sky: what is unlit is dark, and the Sun keeps its place
    still = len(footage["cameras"]) == 1 and not any(f.get("turn") for f in footage["frames"])
    if tumbling and footage["background"] == "black" and not given and still:
        grey = []
        for i, name in enumerate(views.names):
            image = read_image(job.work("capture") / "frames" / name, 0)
            grey.append(undistort(image, views.K[i], views.distortion[i]))
        masks = spare_unlit(views, masks, grey, cloud, job.seed)
    beside = None
    if (job.work("join") / "other.npz").is_file():
        beside = Cloud.load(job.work("join") / "other.npz")
        beside = beside.take(np.flatnonzero(~shown_as_object(beside, views, masks)))
    try:
        surface = reconstruct_surface(
            views,
            masks,
            cloud,
            seed=job.seed,
            progress=job.progress,
            support=support,
            moving=tumbling or given,
            surroundings=beside,
        )
    except NotPossible:
        if place.get("middle") is None:
            raise
        middle, radius = np.array(place["middle"], float), BALL * float(place["radius"])
        surface = surface_of_outlines(views, masks, middle, radius, job.seed, job.progress, support)
    lost = lost_share(surface.vertices, surface.cloud.xyz, FAR * surface.spacing)
    if lost > NOTHING_LEFT:
        raise NotPossible(
            f"surface: {100 * lost:.0f} % of the measured points are not on the closed surface that fits them best: no "
            "closed body was measured; give images with more overlap and from more sides"
        )
    focal = sfm.get("focal_sigma_relative")
    focal = FOCAL_SIGMA if focal is None else float(focal)
    rows, lengths = replicates(surface, len(views), focal, seed=job.seed)

    corners = surface.vertices[surface.faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    observed, inferred = (float(area[w].sum() / area.sum()) for w in (surface.observed, surface.inferred))
    filled = 1 - observed - inferred
    warnings = []
    if filled > 0.1:
        warnings.append(f"{100 * filled:.0f} % of the surface was not measured but filled from the silhouettes")
    if inferred > 0.02:
        warnings.append(f"{100 * inferred:.0f} % of the surface stood on its support, unseen, and was closed there")
    overlap = agreement(surface.vertices, surface.faces, views, masks)
    partial = None
    if filled > MOST_FILLED:
        partial = f"only {100 * observed:.0f} % of the surface was measured: the body is mostly filled in"
        warnings.append(partial)
    if lost > MOST_LOST:
        partial = (
            f"{100 * lost:.0f} % of the measured points are not on the mesh: a part that hangs by little is missing"
        )
        warnings.append(partial)
    for line in warnings:
        job.warn(line)
    np.savez(
        job.out / "surface.npz",
        vertices=surface.vertices,
        faces=surface.faces,
        observed=surface.observed,
        inferred=surface.inferred,
        replicate_integrals=rows,
        replicate_length=lengths,
    )
    facts = {
        "watertight": closed(surface.vertices, surface.faces),
        "observed_fraction": observed,
        "inferred_fraction": inferred,
        "area": float(area.sum()),
        "vertices": len(surface.vertices),
        "faces": len(surface.faces),
        "spacing": surface.spacing,
        "silhouette_overlap": float(np.nanmedian(overlap)),
        "silhouette_overlap_by_image": {
            name: round(float(o), 4) for name, o in zip(views.names, overlap, strict=True) if np.isfinite(o)
        },
        "views_that_carve": surface.hull.need,
        "warnings": warnings,
        "partial": partial,
    }
    (job.out / "surface.json").write_text(json.dumps(facts, indent=1))
    return {k: facts[k] for k in ("watertight", "observed_fraction", "faces", "partial")}


def closed(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether the mesh is a volume in trimesh's sense."""
    import trimesh

    return bool(trimesh.Trimesh(vertices, faces, process=False).is_volume)
