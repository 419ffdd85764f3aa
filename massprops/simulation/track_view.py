"""What the cameras of a simulation of tracks see of the body's points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.errors import NotPossible
from massprops.geometry.vectors import unit
from massprops.model.linearise import Predicted, body_points
from massprops.model.measurements import Measurements
from massprops.model.problem import Problem
from massprops.sensing.pinhole import pinhole_of
from massprops.sensing.predict import Seen, image, in_chaser
from massprops.sequence.data import Camera, Environment
from massprops.simulation.track_scenario import TrackScenario

ROWS_SOUGHT = 5
"""Times that the row of a point is sought where rows are taken at times of their own."""


def cameras_of(s: TrackScenario) -> dict[int, Camera]:
    """One camera or two, none without features."""
    if not s.features:
        return {}
    intrinsics = np.array([s.focal_px, s.focal_px, s.size[0] / 2, s.size[1] / 2])
    first = Camera(s.size, intrinsics, sigma_px=max(s.sigma_px, 1e-6), rate_hz=s.rate_hz)
    if s.baseline_m <= 0:
        return {0: first}
    pose = np.eye(4)
    pose[0, 3] = s.baseline_m
    return {0: first, 1: Camera(s.size, intrinsics, T_BS=pose, sigma_px=first.sigma_px, rate_hz=s.rate_hz)}


def blank_problem(
    s: TrackScenario,
    times: np.ndarray,
    cameras: dict[int, Camera] | None = None,
    environment: Environment | None = None,
) -> Problem:
    """A problem of the scenario's shape at times (n,) [s] without measurements."""
    cameras = cameras_of(s) if cameras is None else cameras
    pinholes = tuple(pinhole_of(cameras[k], cameras[0]) for k in cameras)
    uv = np.full((len(times), len(cameras), s.features, 2), np.nan)
    blank = Problem.of_tracks(times, pinholes, uv, max(s.sigma_px, 1e-6), environment)
    return replace(blank, sigma_range=1.0, sigma_rate=1.0)


def visible(s: TrackScenario, problem: Problem, at: Predicted) -> Measurements:
    """Which features are seen when: those that face the camera, and stay inside the picture.

    Raises:
        NotPossible: hardly any is ever seen.
    """
    n, c, m = problem.uv.shape[:3]
    i, k, j = (a.reshape(-1) for a in np.meshgrid(np.arange(n), np.arange(c), np.arange(m), indexing="ij"))
    none = np.zeros(0, int)
    every = Measurements(Seen(i, k, j, np.zeros(len(i))), np.zeros((len(i), 2)), np.ones(len(i)), none, none, none)
    if not len(i):
        return every
    points, sensed, p = body_points(at, every), at.state.model.sensed, at.state.model.flat(False)
    for _ in range(ROWS_SOUGHT if sensed.hooks("delay") else 1):
        X, body, _ = in_chaser(every.seen, at.motion, points, sensed, p)
        uv = image(problem.cameras, k, X, sensed, p)
        # a row is taken at the time of the row in which the point appears
        every = replace(every, seen=replace(every.seen, row=np.clip(uv[:, 1] / s.size[1] - 0.5, -1.0, 1.0)))
    keep = (uv >= 0).all(axis=1) & (uv[:, 0] < s.size[0]) & (uv[:, 1] < s.size[1]) & (X[:, 2] > 0.1)
    if s.hide_back:
        keep &= np.sum(unit(X - at.motion.r[i]) * unit(X), axis=1) < 0.15
    if keep.sum() < 0.02 * len(keep):
        raise NotPossible("the body is hardly ever in view: bring it nearer, or slow its drift")
    seen = Seen(i[keep], k[keep], j[keep], every.seen.row[keep])
    return Measurements(seen, uv[keep], np.ones(int(keep.sum())), none, none, none)


def pixels(problem: Problem, at: Predicted, seen: Measurements) -> np.ndarray:
    """(o, 2) where the points of these observations are seen, without noise."""
    if not len(seen.uv):
        return seen.uv
    sensed, p = at.state.model.sensed, at.state.model.flat(False)
    return image(
        problem.cameras,
        seen.seen.camera,
        in_chaser(seen.seen, at.motion, body_points(at, seen), sensed, p)[0],
        sensed,
        p,
    )
