"""What each placement of a joined object shows, carried to where it was joined."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.run.drawn_silhouettes import Visible, learned_paint, scene_in, support_in
from massprops.run.job import Job
from massprops.run.stage_images import undistorted_frame
from massprops.views import Views

if TYPE_CHECKING:
    from massprops.surface.cloud import Cloud

SUPPORT = -0.5
"""Mean log odds of something before the support in the images that a point was measured in, below which it is the support's. Of the
points at the foot of seven rendered things fewer than .005 of those on the object had this, and 0 to 79 % of those 4 px off it."""


def turned_over(place: dict[str, Any]) -> bool:
    """Whether the images show more sides than one that the object lay on; `place` is `join.json`."""
    return len(place["joined"]) > 1 and place["support_plane"] is None


def scene_by_view(job: Job, views: Views) -> Iterator[tuple[int, Visible]]:
    """Views by number, each with what its placement shows, carried to where the placement was joined."""
    from massprops.run.stages.shape import measured_folders

    work = job.work("shape")
    painted = learned_paint(measured_folders(work, _placements(work)))
    for folder, view_numbers, move in _joined(job, views):
        shown = scene_in(folder, painted).moved(*move)
        for i in view_numbers:
            yield i, shown


def _placements(work: Path) -> list[dict[str, Any]]:
    return list(json.loads((work / "shape.json").read_text())["placements"])


def _joined(job: Job, views: Views) -> Iterator[tuple[Path, list[int], tuple[np.ndarray, np.ndarray]]]:
    """The folder of each placement, the numbers of its views, and R and t that carried it to where it was joined."""
    from massprops.run.stages.shape import placement_folder

    work, alone = job.work("shape"), Views.load(job.work("sfm") / "views.npz")
    row = {name: i for i, name in enumerate(alone.names)}
    for k, placement in enumerate(_placements(work)):
        names = set(placement["images"])
        view_numbers = [i for i, name in enumerate(views.names) if name in names]
        if view_numbers:
            there = row[views.names[view_numbers[0]]]
            yield (
                placement_folder(work, k),
                view_numbers,
                views.move_from(view_numbers[0], alone.R[there], alone.t[there]),
            )


def shown_as_support(job: Job, views: Views, cloud: Cloud) -> np.ndarray:
    """(n,) bool: points of a cloud at the foot of a placement whose images show the support there.

    Args:
        views: of the join stage; cloud: in their frame.
    """
    from massprops.surface.silhouette import mean_shown

    low, support_by_view = np.zeros(len(cloud), bool), {}
    for folder, view_numbers, move in _joined(job, views):
        support = support_in(folder)
        if support is not None and len(cloud):
            support = support.moved(*move)
            low |= support.at_foot(cloud.xyz)
            support_by_view.update(dict.fromkeys(view_numbers, support))
    if not low.any():
        return low
    # one after the other: those of all images would fill the memory
    odds = (
        support_by_view[i].log_odds(views, i, undistorted_frame(job, views, i)) if i in support_by_view else None
        for i in range(len(views))
    )
    return np.asarray(low & (mean_shown(cloud, views, odds) < SUPPORT))
