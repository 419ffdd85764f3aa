"""hu2024: errors of a filter that may follow any of the 24 principal frames of the target."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.dynamics.inertia import ratios_of_moments
from massprops.dynamics.quaternion import rotate, rotation_matrix
from massprops.estimators.filters import Run

SYMMETRIES = np.array(
    [
        np.linalg.det(np.eye(3)[list(order)] * np.array([[a], [b], [1.0]]))
        * np.eye(3)[list(order)]
        * np.array([[a], [b], [1.0]])
        for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))
        for a in (1.0, -1.0)
        for b in (1.0, -1.0)
    ]
)
"""(24, 3, 3) rotations that take principal axes into principal axes."""


def scores(
    c: dict[str, Any], truth: dict[str, np.ndarray], f: np.ndarray, run: Run, unique: int, hidden: np.ndarray
) -> dict[str, float]:
    """Errors of one filter, before, during and after the occlusions.

    Attitude is scored against three of the 24 true principal frames: the one that was nearest when the first occlusion began,
    as a filter must not leave the frame it has; the nearest at every epoch, which forgives even that; and the unique one.

    Args:
        unique: number of the unique frame among the 24; hidden: (n,) True while occluded.
    """
    times = truth["times"]
    T = rotation_matrix(run.q)
    turn = np.einsum("nji,njk->nik", rotation_matrix(truth["q"]), T)
    match = np.einsum("sij,nij->ns", SYMMETRIES, turn)
    begin = int(np.searchsorted(times, c["occlusions_s"][0][0])) - 1
    first_frame = int(np.argmax(match[begin])) if np.isfinite(match[begin]).all() else 0
    angle = np.degrees(np.arccos(np.clip((match - 1) / 2, -1, 1)))
    fixed = np.where(np.isfinite(angle[:, first_frame]), angle[:, first_frame], 180.0)
    nearest = np.where(np.isfinite(angle).all(axis=1), angle.min(axis=1), 180.0)
    frame = SYMMETRIES[first_frame]
    w = np.nan_to_num(np.linalg.norm(run.w - truth["w"] @ frame, axis=1), nan=1e3)
    points = np.nan_to_num(np.linalg.norm(run.last.features - f @ frame, axis=1), nan=1e3)
    moments = np.diag(frame.T @ np.diag(c["inertia_kg_m2"]) @ frame)
    k = np.abs(run.k - ratios_of_moments(moments)).max(axis=1)
    late = times > times[-1] - 10.0
    before = (times > c["occlusions_s"][0][0] - 10) & (times < c["occlusions_s"][0][0])
    position = np.nan_to_num(np.linalg.norm(run.position - truth["r"], axis=1), nan=1e3)
    velocity = np.nan_to_num(np.linalg.norm(run.velocity - truth["v"], axis=1), nan=1e3)
    body = np.einsum("nji,nj->ni", T, rotate(truth["q"], truth["w"]))
    error = np.stack([run.w - body, run.position - truth["r"], run.velocity - truth["v"]], axis=1)
    at = run.last.places()
    sigma = np.stack([run.sigma[:, at[name]] for name in ("w", "position", "velocity")], axis=1)
    seen = ~hidden & (times > 5.0)
    nees = np.mean((error[seen] / np.maximum(sigma[seen], 1e-300)) ** 2)
    named = moments[0] > moments[1] > moments[2]
    return {
        "frame_ordered": float(named),
        "attitude_deg before": rms(fixed[before]),
        "attitude_deg hidden": float(fixed[hidden].max()),
        "attitude_deg end": rms(fixed[late]),
        "nearest_deg hidden": float(nearest[hidden].max()),
        "nearest_deg end": rms(nearest[late]),
        "unique_deg before": rms(angle[before, unique]),
        "unique_deg end": rms(np.where(np.isfinite(angle[late, unique]), angle[late, unique], 180.0)),
        "left_frame": float(np.any(np.argmax(match[begin:], axis=1) != first_frame) or not np.isfinite(match).all()),
        "rate before": rms(w[before]),
        "rate hidden": float(w[hidden].max()),
        "rate end": rms(w[late]),
        "k end": float(np.sqrt(np.mean(np.minimum(np.nan_to_num(k[late], nan=1e3), 1e3) ** 2))),
        "features end": rms(points),
        "position hidden": float(position[hidden].max()),
        "position end": rms(position[late]),
        "velocity end": rms(velocity[late]),
        "nees": float(min(nees, 1e9)) if np.isfinite(nees) else 1e9,
        "innovation": float(run.nis.sum() / max(run.used.sum(), 1)),
        "refused": float(run.gated.sum() / max(run.gated.sum() + run.used.sum(), 1)),
    }


def rms(x: np.ndarray) -> float:
    """Root mean square of values (n,) that may be huge."""
    return float(np.sqrt(np.mean(np.square(np.minimum(x, 1e100)))))
