"""A film of a small body that is placed with a focal length held at a usual one, until all of it is placed.

The first images of such a film show too little perspective to tell a focal length, and one that runs away takes the model with it:
of a CubeSat eleven of 88 images were placed, and the film was refused. A focal length that is wrong by some tens of percent bends a model by
a degree or two and no more, so that 86 were placed by one 17 % too short. All of them together tell it.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import replace

import pycolmap

from massprops.sfm.attempt import ModelInputs
from massprops.sfm.database import FOCAL_FACTOR
from massprops.sfm.footage import FootageRecord
from massprops.sfm.last_adjustment import refine_options
from massprops.sfm.refine import Effort, adjust, remove_outliers

ROUNDS = 3
"""Adjustments by which a focal length that was held finds its place: from 17 % off it is 4 % off after three of 60 iterations each."""
ITERATIONS = 60
CUT = 2.0
"""Observations that are nearer than this are not taken out meanwhile [px]."""


def with_held_focal(footage: FootageRecord) -> FootageRecord | None:
    """The same with a usual focal length as if it was given; None of what is no film of a turning body, or where one was given."""
    film = footage.moving_pictures and not footage.rig and footage.motion == "tumbling"
    if not film or any(c.focal_source == "given" for c in footage.cameras):
        return None
    held = (
        replace(c, focal_px=c.focal_px or FOCAL_FACTOR * max(c.size), focal_source="given") for c in footage.cameras
    )
    return replace(footage, cameras=tuple(held))


def release(model: pycolmap.Reconstruction, given: ModelInputs, footage: FootageRecord) -> ModelInputs:
    """Adjusts a model in place with its focal length free; what it was found by, as if it had always been.

    Args:
        footage: as it was given.

    Raises:
        NotPossible: the images do not hold together.
    """
    free = replace(given.found.mapping, fixed_intrinsics=False, constant=frozenset())
    settings = refine_options(given.options, footage, free)
    for _ in range(ROUNDS):
        loss = remove_outliers(model, settings, CUT)
        adjust(model, True, False, loss, free.threads, Effort(ITERATIONS))
    options = replace(given.options, refine=settings)
    return replace(given, found=replace(given.found, mapping=free), footage=footage, options=options)
