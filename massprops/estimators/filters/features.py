"""Features that come and go: which the filter carries when, and how a new one enters its state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.dynamics.quaternion import rotation_matrix
from massprops.estimators.filters.setup import MOST_FEATURES, Setup, measurements
from massprops.estimators.filters.state import Measurements, Run, Settings, State, filter_epochs
from massprops.geometry.vectors import skew
from massprops.model.problem import Problem
from massprops.sensing.pinhole import at_depth
from massprops.sensing.stereo import triangulate

SHORTEST = 5
"""A feature that is seen on fewer further epochs is not worth carrying."""


def with_features(state: State, X: np.ndarray, covariance: np.ndarray) -> State:
    """The state with new features at points X (j, 3) of the chaser's frame, covariance (j, 3, 3) [m^2]."""
    R = rotation_matrix(state.q)
    p = (X - state.position) @ R
    places = state.places()
    N = len(state.P)
    G = np.zeros((3 * len(X), N))
    for i in range(len(X)):
        G[3 * i : 3 * i + 3, places["attitude"]] = skew(p[i])
        if state.moving:
            G[3 * i : 3 * i + 3, places["position"]] = -R.T
    GP = G @ state.P
    P = np.block([[state.P, GP.T], [GP, GP @ G.T]])
    for i in range(len(X)):
        of_feature = slice(N + 3 * i, N + 3 * i + 3)
        P[of_feature, of_feature] += R.T @ covariance[i] @ R
    return replace(state, features=np.concatenate([state.features, p]), P=P)


def without_features(state: State, keep: np.ndarray) -> State:
    """The state with the features where keep (m,) is True."""
    at = state.places()["features"].start
    rows = np.concatenate([np.arange(at), at + np.flatnonzero(np.repeat(keep, 3))])
    return replace(state, features=state.features[keep], P=state.P[np.ix_(rows, rows)])


@dataclass(frozen=True)
class Passage:
    """A whole run over changing features; n epochs, m features of the problem.

    Attributes:
        run: means and tallies joined over all parts; its `sigma` holds the leading errors that every part has.
        points: (m, 3) principal axes [m], NaN where never carried.
    """

    run: Run
    points: np.ndarray
    chosen: np.ndarray


def run_through(
    problem: Problem, setup: Setup, settings: Settings, rows: Measurements | None = None, most: int = MOST_FEATURES
) -> Passage:
    """The filter over all epochs of the problem from `setup.first` on; new features enter as old ones leave.

    Args:
        rows: measurements to use in place of the problem's, for one unchanging set of features.
    """
    state, chosen = setup.state, setup.chosen
    n = len(problem.times)
    points = np.full((len(problem.features), 3), np.nan)
    if rows is not None or not setup.points:
        seen = rows if rows is not None else measurements(problem, setup, setup.first, n, chosen, fresh=True)
        run = filter_epochs(state, seen, setup.noise, settings)
        points[chosen] = run.last.features
        return Passage(run, points, chosen)
    last, both = _sights(problem)
    parts: list[Run] = []
    begin = setup.first
    while begin < n:
        end = _next_change(begin, n, chosen, last, both, most)
        seen = measurements(problem, setup, begin, end, chosen, fresh=not parts)
        run = filter_epochs(state, seen, setup.noise, settings)
        parts.append(run)
        state = run.last
        points[chosen] = state.features
        if end < n:
            keep = last[chosen] >= end
            state, chosen = without_features(state, keep), chosen[keep]
            new = _newcomers(end - 1, chosen, last, both, most)
            if len(new):
                state = with_features(state, *_placed(problem, setup, state, end - 1, new))
                chosen = np.concatenate([chosen, new])
        begin = end
    return Passage(joined(parts), points, chosen)


def _sights(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Last epoch of each feature (m,), -1 if never seen, and whether it can be placed at each epoch (n, m)."""
    seen = np.asarray(problem.seen.any(axis=1))
    last = np.where(seen.any(axis=0), len(seen) - 1 - np.argmax(seen[::-1], axis=0), -1)
    if not problem.stereo:
        return last, problem.seen[:, 0]
    X, covariance = triangulate(problem.cameras, np.moveaxis(problem.uv, 1, 2), problem.sigma_px)
    return last, np.isfinite(X[..., 0]) & np.isfinite(covariance[..., 0, 0])


def _placed(problem: Problem, setup: Setup, state: State, epoch: int, new: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where features `new` (j,) are at an epoch, (j, 3) in the chaser's frame and covariance (j, 3, 3).

    Two cameras triangulate them; one camera puts them at the body's distance, as uncertain as the body is deep.
    """
    uv = np.moveaxis(problem.uv[epoch][:, new], 0, 1)
    if problem.stereo:
        return triangulate(problem.cameras, uv, problem.sigma_px)
    camera = problem.cameras[0]
    depth = np.full(len(new), (state.position - camera.t) @ camera.R[2])
    return at_depth(camera, uv[:, 0], depth, problem.alike * problem.sigma_px[0], setup.size)


def _newcomers(epoch: int, chosen: np.ndarray, last: np.ndarray, both: np.ndarray, most: int) -> np.ndarray:
    free = most - len(chosen)
    fit = both[epoch] & (last >= epoch + SHORTEST)
    fit[chosen] = False
    candidates = np.flatnonzero(fit)
    order = np.argsort(-both[epoch:, candidates].sum(axis=0), kind="stable")
    return np.sort(candidates[order][: max(free, 0)])


def _next_change(begin: int, n: int, chosen: np.ndarray, last: np.ndarray, both: np.ndarray, most: int) -> int:
    """First epoch after which another feature can come in."""
    for epoch in range(begin, n - 1):
        alive = chosen[last[chosen] > epoch]
        if len(alive) < most and len(_newcomers(epoch, alive, last, both, most)):
            return epoch + 1
    return n


def joined(parts: list[Run]) -> Run:
    """Runs that follow each other as one."""
    leading = min(p.sigma.shape[1] for p in parts)
    names = ("w", "q", "k", "axes", "position", "velocity", "block", "nis", "used", "gated")
    whole = {name: np.concatenate([getattr(p, name) for p in parts]) for name in names}
    sigma = np.concatenate([p.sigma[:, :leading] for p in parts])
    return Run(**whole, sigma=sigma, last=parts[-1].last, cpu_s=sum(p.cpu_s for p in parts))
