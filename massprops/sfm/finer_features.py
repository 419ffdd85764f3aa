"""More features of a body that shows few unique ones, at the places that its free motion predicts.

Of foil and of like cells only what is unique was matched, a few hundred features of an image. Once the motion is known to a pixel or two, a
feature need not be unique: those of images that are twice as large, four to eight times as many, are matched where it predicts them.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import replace

import numpy as np
import pycolmap

from massprops.errors import NotPossible
from massprops.sfm.along_motion import WORSE, Following, match_along
from massprops.sfm.at_outlines import drop_outline_points
from massprops.sfm.attempt import ModelInputs
from massprops.sfm.convert import to_views
from massprops.sfm.database import write_database
from massprops.sfm.features import extract_all, with_denoising
from massprops.sfm.film_starts import MappedFootage
from massprops.sfm.motion_precision import tumble_precision
from massprops.sfm.refine import robust_loss

FEW = 500
"""Features of an image, in the median, below which finer ones are looked for. Of two bodies in foil and a CubeSat (Blender) that had 221, 242 and
390, attitudes were off by up to .9, .4 and .2 degrees and k1 of the motion by .026, .050 and .17; with finer ones by .35, .5 and .06, and .020,
.002 and .11. A body in foil that had 731 was right to .02 degrees either way."""


def with_finer_features(mapped: MappedFootage) -> MappedFootage:
    """The footage matched anew by finer features along the motion that its images follow, where it shows few unique ones and that makes
    their attitudes surer.

    Not where nothing repeats: of a bus half in eclipse (Blender), of 102 features an image, shape was as before and its interval too narrow.
    """
    given = mapped.given
    options, found, footage = given.options, given.found, given.footage
    following = options.refine.following
    if following is None or not found.repeats:
        return mapped
    # an image in the Earth's shadow shows none
    if np.median([len(found.features[n][0]) for n in given.images_with_features]) >= FEW:
        return mapped
    work = given.work / "finer"
    work.mkdir(parents=True)
    wanted, database = with_denoising(footage, options.enlarged), work / "database.db"
    features, _ = extract_all(
        footage, wanted, found.mapping.masked, options.threads, given.progress, options.parts, footage.frames
    )
    write_database(database, footage, features)
    given = replace(given, found=replace(found, features=features, database=database), work=work)
    try:
        model, now = match_along(mapped.model, following, given)
        surer = _stated(model, now, given) < _stated(mapped.model, following, given)
    except NotPossible:
        return mapped
    if not surer or not now.gain < WORSE:
        return mapped
    given = replace(given, options=replace(options, refine=replace(options.refine, following=now)))
    return replace(mapped, model=model, given=given)


def _stated(model: pycolmap.Reconstruction, following: Following, given: ModelInputs) -> float:
    """1-sigma of the attitudes, in the median [rad], by the features that the last adjustment will use (`refine_along`)."""
    inner = pycolmap.Reconstruction(model)
    drop_outline_points(inner, following.footage)
    names, loss = to_views(model)[0].names, robust_loss(inner, given.options.refine)
    free_focal = not given.found.mapping.fixed_intrinsics
    stated = tumble_precision(inner, following.tumble, following.clock, loss, free_focal, names)
    return float(np.median(stated.attitude))
