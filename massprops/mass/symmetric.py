"""What is said of a body whose sides look alike: `symmetric` of `massprops.json`, and a sentence of its confidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from massprops.errors import InputError
from massprops.mass.integrals import scale_integrals
from massprops.mass.properties import MassProperties, properties_of_integrals

CANDIDATES = {
    "common": "only what all the like sides share",
    "together": "on every like side what any of them shows",
}
"""The two bodies between which the body lies, should images belong to another of the like sides than they were placed at."""


def described(found: Sequence[dict[str, Any]], body: MassProperties, factor: float) -> list[dict[str, Any]]:
    """`symmetric` of `massprops.json`.

    Args:
        found: `symmetric` of `surface.json`.
        body: the mesh's, in final units.
        factor: final units per unit of the reconstruction.
    """
    out = []
    for one in found:
        candidates = {}
        for name in CANDIDATES:
            made = _properties(one.get(name), body.density, factor)
            if made is not None:
                candidates[name] = {"volume": made.volume, "k1": made.k1, "k2": made.k2}
        kept = {
            k: one[k] for k in ("fold", "images_alike", "images_apart", "shape_share", "paint_share", "paint_by_chance")
        }
        axis = int(one["axis"])
        out.append(
            {**kept, "about": f"I{axis + 1}", "axis": body.principal_axes[:, axis].tolist(), "candidates": candidates}
        )
    return out


def _properties(row: Any, density: float, factor: float) -> MassProperties | None:
    if row is None:
        return None
    scaled = scale_integrals(np.array(row, float), factor)
    try:
        return properties_of_integrals(scaled, density)
    except InputError:
        return None


def sentences(symmetric: Sequence[dict[str, Any]], body: MassProperties, images: int) -> list[str]:
    """What a reader should know of it, one sentence for each axis."""
    return [_sentence(one, body, images) for one in symmetric]


def undecided(symmetric: Sequence[dict[str, Any]], bounds: dict[str, list[Any]]) -> list[int]:
    """Places in the list of those whose images nothing places, and whose other bodies lie outside the stated intervals."""
    out = []
    for i, one in enumerate(symmetric):
        beyond = any(
            not bounds[name][0] <= other[name] <= bounds[name][1]
            for other in one["candidates"].values()
            for name in ("volume", "k1", "k2")
        )
        if one["images_apart"] and beyond:
            out.append(i)
    return out


def _sentence(one: dict[str, Any], body: MassProperties, images: int) -> str:
    """For example: symmetric: the body looks alike every 90 degrees about the axis of I1, so that 31 of 88 images ..."""
    alike, apart = len(one["images_alike"]), len(one["images_apart"])
    sentence = (
        f"symmetric: the body looks alike every {360 / one['fold']:.0f} degrees about the axis of {one['about']}, so that "
        f"{alike} of {images} images would fit as well turned by as much; "
    )
    if not apart:
        sentence += "what their neighbours in time show besides tells which way is right"
    else:
        sentence += f"for {apart} of them nothing but their own matches tells which way is right"
    other = one["candidates"]
    if len(other) < len(CANDIDATES):
        return sentence
    low, high = (100 * (other[name]["volume"] / body.volume - 1) for name in ("common", "together"))
    if max(-low, high) < 1.0:
        return sentence + "; another placement would change no mass property, only the motion"
    k = ", ".join(f"{n} {other['common'][n]:.3f} to {other['together'][n]:.3f}" for n in ("k1", "k2"))
    return sentence + f"; placed otherwise, the volume would lie between {low:+.0f} and {high:+.0f} % of this one, {k}"
