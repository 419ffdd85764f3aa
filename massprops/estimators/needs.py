"""What an estimator needs of a sequence, and one line that says what is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from massprops.model.problem import Problem

if TYPE_CHECKING:
    from massprops.estimators.methods import Method

SAID = {
    "tracks": "tracks of features (tracks0)",
    "stereo": "two cameras that see the same features at the same times (tracks0, cam0, cam1)",
    "range": "ranges (range0)",
    "rates": "body rates (imu0)",
    "attitude": "an attitude history (attitude0)",
}


HOW = {
    "tracks": "has_tracks",
    "stereo": "stereo",
    "range": "has_range",
    "rates": "has_rates",
    "attitude": "has_attitude",
}
"""What of a problem tells whether the sequence holds what a word of `NEEDS` asks for."""


def unmet(method: Method, problem: Problem) -> str:
    """What the sequence lacks for a method, in one line; empty when it lacks nothing."""
    missing = []
    for entry in method.NEEDS:
        words = entry.split("|")
        if not any(getattr(problem, HOW[word]) for word in words):
            missing.append(" or ".join(SAID[word] for word in words))
    if missing:
        return "needs " + ", and ".join(missing)
    further_check = getattr(method, "unmet", None)
    return str(further_check(problem) or "") if further_check is not None else ""
