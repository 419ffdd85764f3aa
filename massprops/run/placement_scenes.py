"""What each placement of a joined object shows, carried to where it was joined."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from massprops.run.drawn_silhouettes import Visible, learned_paint, scene_in
from massprops.run.job import Job
from massprops.run.stage_images import undistorted_frame
from massprops.views import Views

if TYPE_CHECKING:
    from massprops.surface.cloud import Cloud

SUPPORT = -0.5
"""Mean log odds of something before the support in the images that a point was measured in, below which it is the support's. Of the
points at the foot of seven rendered things fewer than .005 of those on the object had this, and 0 to 79 % of those 4 px off it."""


def scene_by_view(job: Job, views: Views) -> Iterator[tuple[int, Visible]]:
    """Views by number, each with what its placement shows, carried to where the placement was joined."""
    from massprops.run.stages.shape import measured_folders, placement_folder

    work, alone = job.work("shape"), Views.load(job.work("sfm") / "views.npz")
    placements = json.loads((work / "shape.json").read_text())["placements"]
    painted = learned_paint(measured_folders(work, placements))
    row = {name: i for i, name in enumerate(alone.names)}
    for k, placement in enumerate(placements):
        names = set(placement["images"])
        own = [i for i, name in enumerate(views.names) if name in names]
        if not own:
            continue
        there = row[views.names[own[0]]]
        move = views.move_from(own[0], alone.R[there], alone.t[there])
        shown = scene_in(placement_folder(work, k), painted).moved(*move)
        for i in own:
            yield i, shown


def shown_as_support(job: Job, views: Views, cloud: Cloud) -> np.ndarray:
    """(n,) bool: points of a cloud at the foot of a placement whose images show the support there.

    Args:
        views: of the join stage; cloud: in their frame.
    """
    from massprops.surface.silhouette import mean_shown

    low = np.zeros(len(cloud), bool)
    maps: list[np.ndarray | None] = [None] * len(views)
    if not len(cloud):
        return low
    for i, shown in scene_by_view(job, views):
        if shown.support is not None:
            low |= shown.support.at_foot(cloud.xyz)
            maps[i] = shown.support.log_odds(views, i, undistorted_frame(job, views, i))
    return np.asarray(low & (mean_shown(cloud, views, maps) < SUPPORT))
