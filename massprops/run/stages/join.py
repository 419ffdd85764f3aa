"""Stage `join`: all placements of the object in one frame, the object's own."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.core.inputs import read_image
from massprops.run.job import Job

if TYPE_CHECKING:
    from massprops.surface.registration import Registration

READS = ("sfm", "shape", "silhouettes")
OPTIONS = ()

AROUND = 1.5
"""Sparse points farther than this from the object's middle, in its radii, do not say how deep it lies in a view."""

TOO_COARSE = (
    "of one of them only the outline is known, by what it hides of its support, which is too coarse to be joined"
)
"""A padlock whose dark shackle was missing in most silhouettes fitted best, and by its paint too, the wrong way round."""
FEW_POINTS = 100
"""Sparse points of given poses below which stereo does not know where to look, and outlines tell where the body is."""


def run(job: Job) -> dict[str, Any]:
    """Writes views.npz and points.npz (the views and sparse points that the body is made of), other.npz where
    surroundings are known, and join.json.
    """
    from massprops.sfm.points import SparsePoints
    from massprops.views import Views

    views, sparse = Views.load(job.work("sfm") / "views.npz"), SparsePoints.load(job.work("sfm") / "points.npz")
    placements = json.loads((job.work("shape") / "shape.json").read_text())["placements"]
    left_out = json.loads((job.work("silhouettes") / "silhouettes.json").read_text())["left_out"]
    facts: dict[str, Any] = {"joined": [{"images": len(views)}], "unjoined": [], "support_plane": None}
    if not placements and len(sparse.xyz) < FEW_POINTS:
        facts["middle"], facts["radius"] = _by_outlines(job, views)
    if placements:
        views, sparse, facts = _joined(job, views, sparse, placements, set(left_out))
    views.save(job.out / "views.npz")
    sparse.save(job.out / "points.npz")
    for gone in facts["unjoined"]:
        job.warn(
            f"{gone['images']} images show another placement of the object, which could not be joined: {gone['reason']}"
        )
    (job.out / "join.json").write_text(json.dumps(facts, indent=1))
    return {"joined": len(facts["joined"]), "unjoined": len(facts["unjoined"])}


def _joined(job: Job, views, sparse, placements: list[dict[str, Any]], left_out: set[str]):  # type: ignore[no-untyped-def]
    """Views and points of the best placement, that most images show, and of those that fit onto it."""
    from massprops.run.stages.shape import placement_folder
    from massprops.sfm.points import SparsePoints
    from massprops.surface.cloud import Cloud
    from massprops.surface.registration import register
    from massprops.views import Views

    number = {name: i for i, name in enumerate(views.names)}
    index = [np.array([number[n] for n in p["images"] if n not in left_out], int) for p in placements]
    # a measured shape before one that is known by what it hides
    order = sorted(range(len(placements)), key=lambda k: (placements[k]["method"] != "measured", -len(index[k])))
    first = order[0]
    facts: dict[str, Any] = {"joined": [{"images": len(index[first])}], "unjoined": [], "support_plane": None}
    supports = [None if p["support_plane"] is None else np.array(p["support_plane"]) for p in placements]
    base = _placed(job, views.take(index[first]), first, supports[first])
    parts = [(index[first], np.eye(3), np.zeros(3), first)]
    for done, k in enumerate(order[1:]):
        job.progress(done, len(order) - 1, "joining placements")
        if any(placements[i]["method"] != "measured" for i in (first, k)):
            facts["unjoined"].append({"images": len(index[k]), "fits": True, "reason": TOO_COARSE})
            continue
        found = register(base, _placed(job, views.take(index[k]), k, supports[k]), job.seed)
        said = {"images": len(index[k]), **_said(found)}
        if found.clear:
            facts["joined"].append(said)
            parts.append((index[k], found.R, found.t, k))
        else:
            facts["unjoined"].append({**said, "fits": found.fits, "reason": _reason(found)})
    if len(parts) == 1:
        facts["support_plane"] = placements[first]["support_plane"]
        facts["support_rise"] = placements[first]["support_rise"]
    around, all_views, all_points, before = [], [], [], 0
    for member, R, t, k in parts:
        folder = placement_folder(job.work("shape"), k)
        own = Cloud.load(folder / "object.npz").xyz
        middle = np.median(own, axis=0)
        radius = float(np.percentile(np.linalg.norm(own - middle, axis=1), 99))
        if k == first:
            facts["middle"], facts["radius"] = middle.tolist(), radius
        all_views.append(views.take(member).moved(R, t))
        all_points.append(sparse.of_views(member).near(middle, AROUND * radius).moved(R, t, before))
        # lines of sight of images that were left out go
        place = {views.names[i]: n for n, i in enumerate(member)}
        kept = np.array([place.get(name, -1) for name in placements[k]["images"]])
        around.append(Cloud.load(folder / "other.npz").of_views(kept).moved(R, t, before))
        before += len(member)
    Cloud.joined(around).save(job.out / "other.npz")
    return Views.joined(all_views), SparsePoints.joined(all_points), facts


def _said(found: Registration) -> dict[str, Any]:
    """What `join.json` says of a registration."""
    return {
        "outside_px": found.outside_px,
        "own_px": found.own_px,
        "rival_px": found.rival_px,
        "colour_correlation": found.colour,
        "rival_colour_correlation": found.rival_colour,
        "colour_correlation_noise": found.colour_noise,
        "symmetric": found.symmetric,
    }


def _reason(found: Registration) -> str:
    """Why a placement is not joined."""
    if found.fits:
        return "two ways of turning it fit equally well"
    return (
        f"however it is turned, its points fall {found.outside_px:.1f} px outside the other's silhouettes: another "
        "object, or too little of it was measured"
    )


def _by_outlines(job: Job, views) -> tuple[list[float], float]:  # type: ignore[no-untyped-def]
    """Middle and radius of the body, from its silhouettes."""
    from massprops.surface.outline_cloud import ball_of_outlines
    from massprops.views import undistort

    folder = job.work("silhouettes") / "masks"
    masks = [
        undistort(read_image(folder / f"{name}.png", 0), views.K[i], views.distortion[i], nearest=True)
        for i, name in enumerate(views.names)
    ]
    middle, radius = ball_of_outlines(views, masks)
    return middle.tolist(), radius


def _placed(job: Job, views, number: int, support: np.ndarray | None):  # type: ignore[no-untyped-def]
    """A placement as the registration wants it."""
    from massprops.run.stages.shape import placement_folder, placement_points
    from massprops.surface.registration import placed
    from massprops.views import undistort

    cloud, colour = placement_points(job.work("shape"), number)
    with np.load(placement_folder(job.work("shape"), number) / "shape.npz", allow_pickle=False) as z:
        vertices, faces = z["vertices"], z["faces"]
    masks = [
        undistort(
            read_image(job.work("silhouettes") / "masks" / f"{name}.png", 0),
            views.K[i],
            views.distortion[i],
            nearest=True,
        )
        for i, name in enumerate(views.names)
    ]
    middle = centroid(vertices, faces)
    return placed(cloud, colour, views, masks, vertices, middle, support, job.seed)


def centroid(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(3,) middle of a closed mesh's volume."""
    from massprops.mass.integrals import mesh_integrals

    rows = mesh_integrals(vertices, faces)
    return rows[1:4] / rows[0]
