"""The closed surface of a plain body that turns before a black sky: its brightness measures what is lit, the rest is filled in.

Where features tell nothing, stereo has little to match but creases, and what it finds between them is wrong: of a body of plaster its points were 5 px
off, and the body made of them 15 % too small. So such a body is asked first whether one paint explains how bright its images are (`shading`).
What is shown lit then stands for measured points, and what is not is filled in as that of any other body (`reconstruct`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.core.progress import Progress, silent
from massprops.errors import NotPossible
from massprops.mass.integrals import mesh_integrals
from massprops.surface.fill_by_motion import Balance
from massprops.surface.level_set import level_set
from massprops.surface.outline_cloud import WIDE, body_of_hull, hull_of_outlines
from massprops.surface.reconstruct import FILLED, Fill, Surface, reconstruct_surface
from massprops.surface.shading import shaded
from massprops.surface.unlit import brighter
from massprops.views import Views

COARSE, LEAST_PIXELS = 60, 2.5
"""Steps of the grid from which the mesh is made that is fitted, along the width of the space that holds the body, none below so many pixels."""
THIN = 0.05
"""Share of the volume that such a mesh may lack or have too much: of a body with thin parts, more."""
BEYOND = 1.1
"""Radius of the ball that closes the hull where no outline that faces the Sun does, over that of the ball which holds all that was lit."""
PLACE_PIXELS = 0.5
"""1-sigma of a place beside its neighbours [px]."""


def surface_by_brightness(
    views: Views,
    masks: list[np.ndarray],
    grey: list[np.ndarray],
    ball: tuple[np.ndarray, float],
    fill: Fill | Balance = FILLED,
    seed: int = 0,
    progress: Progress = silent,
) -> Surface | None:
    """The surface that its brightness shows; None where it does not explain the images, or where several cameras, thin parts or no
    common direction of the light do not allow the fit.

    Args:
        views: n views of one still camera, in the body's frame.
        masks: n silhouettes (h, w), 255 lit, 0 sky, none behind what is lit (`unlit.spare_behind_light`); grey: n images (h, w) uint8.
        ball: middle (3,) and radius of a ball that holds all that was lit.
        fill, seed, progress: as for `reconstruct_surface`.
    """
    towards = brighter(masks, grey)
    if towards is None or len(np.unique(views.folders)) > 1:
        return None
    middle, radius = ball
    try:
        hull = hull_of_outlines(views, masks, middle, WIDE * radius)
        body = body_of_hull(hull, middle, WIDE * radius, within=BEYOND * radius)
        progress(1, 3, "hull")
        coarser = max(1, round(max(len(body.value) / COARSE, LEAST_PIXELS * hull.pixel / body.step)))
        step = coarser * body.step
        mesh = level_set(body.value[::coarser, ::coarser, ::coarser], body.origin, step)
        if abs(mesh_integrals(*mesh)[0] / (np.count_nonzero(body.value < 0) * body.step**3) - 1) > THIN:
            return None
        fitted = shaded(mesh, step, views, masks, grey, towards, hull)
        if fitted is None:
            return None
        progress(2, 3, "brightness")
        cloud = fitted.cloud(PLACE_PIXELS * hull.pixel)
        surface = reconstruct_surface(views, masks, cloud, seed=seed, fill=fill)
    except NotPossible:
        return None
    progress(3, 3, "surface by brightness")
    return replace(surface, slope=fitted.slope)
