"""Placements of an object that could not be joined, each measured by itself: what they say of the one that is used."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.errors import NotPossible
from massprops.mass.integrals import mesh_integrals
from massprops.run.job import Job
from massprops.run.stage_images import undistorted_mask
from massprops.surface.hollow import Hollows, hollows, water_held
from massprops.surface.reconstruct import Surface, reconstruct_surface
from massprops.views import Views

POINTS = 20_000
"""Points that carry such a surface."""
VESSEL = 0.1
"""Water that stands in a placement's upper side, over its volume, from which on it is a vessel: a rim 3 mm deep on a
tin 100 mm high holds .03, a cup more than the volume of its walls."""


@dataclass(frozen=True)
class Unjoined:
    """body (10,) and its replicates rows (r, 10): integrals in the axes of its own placement; vessel: its upper side is
    hollow, and that is not the upper side of the placement that is used; images: how many show it."""

    body: np.ndarray
    rows: np.ndarray
    vessel: bool
    images: int


def unjoined(job: Job, place: dict[str, Any], focal_sigma: float) -> list[Unjoined]:
    """What stereo measured of each placement that could not be joined; `place` is `join.json`."""
    numbers = [gone["placement"] for gone in place["unjoined"] if "placement" in gone]
    measured = (_measured(job, k, focal_sigma) for k in numbers)
    return [one for one in measured if one is not None]


def _measured(job: Job, number: int, focal_sigma: float) -> Unjoined | None:
    """One placement; None where no closed body was measured, or nothing is known of what it stood on."""
    from massprops.run.stages.shape import placement_folder, placement_points
    from massprops.surface.cloud import Cloud
    from massprops.surface.spread import ErrorSources, replicates

    placement = json.loads((job.work("shape") / "shape.json").read_text())["placements"][number]
    if placement["method"] != "measured" or placement["support_plane"] is None:
        return None
    left_out = set(json.loads((job.work("silhouettes") / "silhouettes.json").read_text())["left_out"])
    views = Views.load(job.work("sfm") / "views.npz")
    row = {name: i for i, name in enumerate(views.names)}
    used = [name for name in placement["images"] if name not in left_out]
    place = {name: i for i, name in enumerate(used)}
    kept = np.array([place.get(name, -1) for name in placement["images"]])
    here = views.take(np.array([row[name] for name in used], int))
    cloud = placement_points(job.work("shape"), number)[0].of_views(kept)
    other = Cloud.load(placement_folder(job.work("shape"), number) / "other.npz").of_views(kept)
    support = np.array(placement["support_plane"])
    masks = [undistorted_mask(job, here, i) for i in range(len(here))]
    try:
        surface = reconstruct_surface(
            here, masks, cloud, POINTS, job.seed, support=support, moving=False, surroundings=other
        )
    except NotPossible:
        return None
    body = mesh_integrals(surface.vertices, surface.faces)
    rows, _ = replicates(surface, len(here), ErrorSources(focal_sigma), seed=job.seed)
    water = water_held(surface.vertices, surface.faces, support, surface.spacing)
    return Unjoined(body, rows, water > VESSEL * body[0], len(here))


def underside_may_be_hollow(place: dict[str, Any], others: list[Unjoined]) -> bool:
    """Whether the side that the object stood on may be hollow: it is the upper side of a placement that could not be joined,
    and hollow there or not measured. `place` is `join.json`, `others` of `unjoined`.
    """
    return len(others) < len(place["unjoined"]) or any(other.vessel for other in others)


def on_support_hollows(surface: Surface, support: np.ndarray, underside_hollow: bool = False) -> Hollows:
    """Space that may be empty in a body that stands on a plane (4,).

    Args:
        surface: of the body; support: the plane.
        underside_hollow: there is reason to think that the side it stands on is hollow, and then all of it may be a thin shell:
            of a toy car the wheels, seen from both sides, were many times as thick as its walls.
    """
    possible_hollows = hollows(
        surface.vertices,
        surface.faces,
        surface.observed,
        support,
        surface.noise,
        surface.spacing,
        walls_alike=not underside_hollow,
    )
    return Hollows(possible_hollows.possible, possible_hollows.possible) if underside_hollow else possible_hollows
