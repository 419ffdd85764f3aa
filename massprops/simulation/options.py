"""Options of `massprops simulate` as fields of a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from massprops.errors import InputError

OF_SCENARIO = {
    "frames": "frames",
    "size": "size",
    "rate": "rate_deg",
    "fill": "fill",
    "phase": "sun_phase_deg",
    "distortion": "distortion",
    "noise": "noise",
    "background": "background",
    "stereo": "stereo_m",
    "range": "range_sigma_m",
    "hidden_mass": "hidden_mass",
    "effects": "effects",
    "model": "model",
    "seed": "seed",
}
OF_TRACKS = {
    "features": "features",
    "sigma": "sigma_px",
    "outliers": "outliers",
    "attitude": "attitude_sigma",
    "rates": "rate_sigma",
}


def changes(asked: Mapping[str, Any], tracks: bool, mark: str = "") -> dict[str, Any]:
    """What options change of a scenario, by the names of its fields.

    Args:
        asked: the options; None where one is not given.
        tracks: the scenario asks for tracks only.
        mark: before an option's name in a message.

    Raises:
        InputError: an option of tracks for a scenario of images.
    """
    of_tracks = {field: asked[name] for name, field in OF_TRACKS.items() if asked[name] is not None}
    if of_tracks and not tracks:
        *most, last = (mark + name for name in OF_TRACKS)
        raise InputError(f"{', '.join(most)} and {last} are for the scenario 'tracks' alone: leave them out")
    given = {field: asked[name] for name, field in OF_SCENARIO.items()}
    return given | of_tracks | {"effects": _several(asked["effects"])}


def _several(effects: Any) -> tuple[str, ...] | None:
    return (effects,) if isinstance(effects, str) else tuple(effects or ()) or None
