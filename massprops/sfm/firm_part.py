"""The part of a film's model that many points hold together.

Of a printed cloth the few features that have no twin place most images of a film, some by a dozen points. So few leave the step from
one image to the next open by more than a cell of the print, and features that are then looked for at their predicted places are found
a cell off.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap

import numpy as np
import pycolmap

from massprops.sfm.attempt import FEWEST
from massprops.sfm.convert import take_out_images


def firm_part(model: pycolmap.Reconstruction, order: list[str], least: int) -> pycolmap.Reconstruction:
    """The longest run of a film's images with `least` points across each of its steps; the model itself where that is all of it, or
    too little to begin from.

    A point ties two parts of a film where it is seen from both, and twice from one: two rays alone fit any length of the step.

    Args:
        order: names of all images in time.
    """
    at = {name: k for k, name in enumerate(order)}
    placed = sorted((at[model.image(i).name], i) for i in model.reg_image_ids())
    row = {i: k for k, (_, i) in enumerate(placed)}
    across = np.zeros(len(placed), int)
    for point in model.points3D.values():
        seen = np.unique([row[e.image_id] for e in point.track.elements])
        if len(seen) > 2:
            across[seen[0] : seen[-1]] += 1
    runs = np.split(np.arange(len(placed)), np.flatnonzero(across[:-1] < least) + 1)
    longest = max(runs, key=len)
    if len(longest) < FEWEST or len(longest) == len(placed):
        return model
    kept = pycolmap.Reconstruction(model)
    take_out_images(kept, {placed[k][1] for k in range(len(placed))} - {placed[k][1] for k in longest})
    return kept
