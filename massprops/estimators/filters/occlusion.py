"""Occlusions of a sequence, and the pseudo-measurements that learnt processes put in their place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.dynamics.chaser_path import chaser_path
from massprops.dynamics.quaternion import from_rotation_matrix, multiply, nearest_rotation, rotation_matrix
from massprops.estimators.filters.features import Passage
from massprops.estimators.filters.foresight import foresee_features
from massprops.estimators.filters.setup import Setup
from massprops.estimators.filters.state import Measurements
from massprops.estimators.geometry.stereo_path import linear_path, path_transition
from massprops.geometry.vectors import skew
from massprops.model.problem import Problem
from massprops.sensing.pinhole import project

LONGEST_PAUSE = 5.5
"""Usual steps without enough measurements beyond which it is an occlusion."""
FEWEST_SEEN = 3
"""Features that fix the attitude at an epoch."""
FEWEST_LEARNT = 60
"""Samples from which periods can be learnt."""
MOST_LEARNT = 6
"""Features carried through an occlusion by processes of their own."""
STILL, MOVING_SIGMAS = 0.1, 4.0
"""Drift of the centre of mass over the record, in sigmas of the image, and its velocity in its own sigmas, below
which it is at rest."""


@dataclass(frozen=True)
class Gap:
    """Epochs begin <= i < end of a problem without enough measurements."""

    begin: int
    end: int


def with_gap_epochs(problem: Problem, setup: Setup) -> tuple[Problem, list[Gap]]:
    """The problem with epochs at the usual step where there are none, and the gaps in its epochs."""
    enough = informative(problem, setup)
    rows = np.flatnonzero(enough)
    rows = rows[rows >= setup.first]
    if len(rows) < 3:
        return problem, []
    step = float(np.median(np.diff(problem.times[rows])))
    long = np.flatnonzero(np.diff(problem.times[rows]) > LONGEST_PAUSE * step)
    spans = [(problem.times[rows[i]], problem.times[rows[i + 1]]) for i in long]
    if problem.times[-1] - problem.times[rows[-1]] > LONGEST_PAUSE * step:
        spans.append((problem.times[rows[-1]], np.inf))
    if not spans:
        return problem, []
    extra = []
    for a, b in spans:
        between = problem.times[(problem.times > a) & (problem.times < b)]
        edges = np.concatenate([[a], between, [b] if np.isfinite(b) else []])
        for left, right in zip(edges[:-1], edges[1:], strict=True):
            count = int(np.round((right - left) / step))
            extra.append(left + (right - left) * np.arange(1, count) / max(count, 1))
    longer = _with_epochs(problem, np.concatenate(extra))
    inside = [(longer.times > a + 1e-9) & (longer.times < b - 1e-9) for a, b in spans]
    return longer, [Gap(int(np.argmax(g)), int(np.argmax(g) + g.sum())) for g in inside]


def informative(problem: Problem, setup: Setup) -> np.ndarray:
    """(n,) epochs whose measurements fix the attitude, or the rates where those are all there is."""
    if setup.points:
        return np.asarray((problem.seen.any(axis=1)).sum(axis=1) >= FEWEST_SEEN)
    measured = problem.attitude if setup.sensors[0] else problem.rates
    return np.isfinite(measured[:, 0])


def _with_epochs(problem: Problem, times: np.ndarray) -> Problem:
    """The problem with epochs at more times [s], at which nothing is measured."""
    whole, order = np.unique(np.concatenate([problem.stamp_ns, problem.stamps(times)]), return_index=True)
    longer = problem.of_epochs(lambda x: np.concatenate([x, np.full((len(times), *x.shape[1:]), np.nan)])[order])
    return replace(longer, stamp_ns=whole, times=np.concatenate([problem.times, times])[order])


def fill_gap(
    problem: Problem, setup: Setup, gap: Gap, passage: Passage, rows: Measurements, chosen: np.ndarray
) -> tuple[Measurements, int, str]:
    """Pseudo-measurements over one gap, learnt from what came before it: of features where two cameras show how far they are, else of
    the attitudes and rates.

    Args:
        passage: the filter's run over the epochs before the gap, from `setup.first`.
        rows: measurements of all epochs from `setup.first`, features `chosen`.

    Returns:
        measurements with the gap filled, how many processes carry it, and one line when none could be learnt.
    """
    inside = slice(gap.begin - setup.first, gap.end - setup.first)
    if setup.points and problem.stereo:
        return _fill_points(problem, setup, gap, passage, rows, chosen, inside)
    before = slice(0, gap.begin)
    ahead = problem.times[gap.begin : gap.end]
    z, variance, at = rows.z.copy(), rows.variance.copy(), 0
    attitude = None if rows.attitude is None else rows.attitude.copy()
    count = 0
    if setup.sensors[0]:
        at = 3
        R = rotation_matrix(problem.attitude[before])[:, :, :2]
        told = foresee_features(problem.times[before], [R.reshape(len(R), 6)], ahead)[0]
        if told is not None and attitude is not None:
            q, spread = _attitudes(told.value.reshape(-1, 3, 2), told.covariance[:, :6, :6])
            attitude[inside], z[inside, :3], variance[inside, :3] = q, 0.0, told.shares * spread
            count += 1
    if setup.sensors[1]:
        told = foresee_features(problem.times[before], [problem.rates[before]], ahead)[0]
        if told is not None:
            z[inside, at : at + 3], variance[inside, at : at + 3] = told.value, told.variance[:, :3]
            count += 1
    reason = "" if count else f"nothing periodic could be learnt from the {gap.begin} epochs before the occlusion"
    return replace(rows, z=z, variance=variance, attitude=attitude), count, reason


def _attitudes(columns: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest rotations to two predicted columns (n, 3, 2), and variances (n, 3) of a small turn in body axes."""
    third = np.cross(columns[..., 0], columns[..., 1])
    R = nearest_rotation(np.concatenate([columns, third[..., None]], axis=-1))
    variance = np.empty((len(R), 3))
    for i in range(len(R)):
        # R exp(a): column j moves by R (a x e_j); rows of the six values are (axis, column)
        J = np.zeros((3, 2, 3))
        for j in range(2):
            J[:, j] = -R[i] @ skew(np.eye(3)[j])
        back = np.linalg.pinv(J.reshape(6, 3))
        variance[i] = np.diag(back @ covariance[i] @ back.T)
    return from_rotation_matrix(R), variance


def _fill_points(
    problem: Problem, setup: Setup, gap: Gap, passage: Passage, rows: Measurements, chosen: np.ndarray, inside: slice
) -> tuple[Measurements, int, str]:
    from massprops.sensing.stereo import triangulate

    learn = slice(setup.first, gap.begin)
    times, ahead = problem.times[learn], problem.times[gap.begin : gap.end]
    uv = problem.uv[learn][:, :, chosen]
    n, m = len(times), len(chosen)
    across = _baseline_axis(problem)
    X, covariance = triangulate(problem.cameras, np.moveaxis(uv, 1, 2), problem.sigma_px)
    path, moving = _path(problem, passage, times, X, covariance)
    reference = path[-1].copy()
    steps = problem.times[np.r_[gap.begin - 1, np.arange(gap.begin, gap.end)]]
    turn = _turns(problem, times, steps)
    if moving or turn is not None:
        # the translation of the centre of mass first: points as they would be seen with it at `reference`
        relative = X - path[:, None]
        if turn is not None:
            relative = np.einsum("nij,nmj->nmi", turn[0], relative)
        uv = np.stack([project(camera, reference + relative) for camera in problem.cameras], axis=1)
    series = [np.stack([uv[:, 0, i, 0], uv[:, 0, i, 1], uv[:, 1, i, across]], axis=-1) for i in range(m)]
    enough = [i for i in range(m) if np.isfinite(series[i]).all(axis=1).sum() >= FEWEST_LEARNT]
    enough = sorted(enough, key=lambda i: -np.isfinite(series[i]).all(axis=1).sum())[:MOST_LEARNT]
    told = foresee_features(times, [series[i] for i in enough], ahead)
    z, variance = rows.z.copy(), rows.variance.copy()
    extras = sum(rows.extras)
    count = 0
    for i, one in zip(enough, told, strict=True):
        if one is None or not np.isfinite(one.variance).all():
            continue
        value, spread = one.value, one.variance[:, :3]
        if turn is not None:
            value = _turned_back(problem, value, across, reference, turn[1])
        at = extras + rows.per_feature * i
        z[inside, at], z[inside, at + 1], z[inside, at + 2 + across] = value.T
        variance[inside, at], variance[inside, at + 1], variance[inside, at + 2 + across] = spread.T
        z[inside, at + 3 - across] = np.nan
        count += 1
    if not count:
        return rows, 0, f"no feature's periods could be learnt from the {n} epochs before the occlusion"
    others = np.setdiff1d(np.arange(m), [i for i, one in zip(enough, told, strict=True) if one is not None])
    for i in others:
        z[inside, extras + rows.per_feature * i : extras + rows.per_feature * (i + 1)] = np.nan
    pinned = np.zeros(len(z), bool) if rows.pinned is None else rows.pinned.copy()
    pinned[inside] = True
    return replace(rows, z=z, variance=variance, pinned=pinned, reference=reference), count, ""


def _baseline_axis(problem: Problem) -> int:
    """0 or 1: the image axis of the second camera along which depth shows."""
    one, two = problem.cameras
    return int(np.argmax(np.abs(two.R @ (two.t - one.t))[:2]))


def _path(
    problem: Problem, passage: Passage, times: np.ndarray, X: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, bool]:
    """The centre of mass (n, 3) on its free path, fitted to all epochs, and whether it moves enough to be seen.

    The filter's own velocity leans on the last epochs; over the whole record its error would bend the path.

    Args:
        X: (n, m, 3) triangulated features and their covariance (n, m, 3, 3).
    """
    chaser, features = chaser_path(problem.environment, times), passage.run.last.features
    C = rotation_matrix(chaser.q)
    solution, spread = linear_path(
        times,
        multiply(chaser.q, passage.run.q[: len(times)]),
        np.einsum("nij,nmj->nmi", C, X),
        C[:, None] @ covariance @ np.swapaxes(C, 1, 2)[:, None],
        chaser,
        3.0 * float(np.sqrt(np.mean(np.sum(features**2, axis=1)))),
    )
    path = np.einsum("nji,nja,a->ni", C, path_transition(times, chaser), solution[:6])
    shift = np.linalg.norm(path - path[-1], axis=1).max() / np.linalg.norm(path[-1])
    finest = min(s / abs(c.intrinsics[0]) for s, c in zip(problem.sigma_px, problem.cameras, strict=True))
    speed = np.abs(solution[3:6]) > MOVING_SIGMAS * np.sqrt(np.diag(spread)[3:6])
    moving = bool(shift > STILL * finest and speed.any())
    return (path if moving else np.broadcast_to(path.mean(axis=0), path.shape)), moving


def _turns(problem: Problem, times: np.ndarray, ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Chaser's axes at `times` and at `ahead[1:]` in its axes at the first, (n, 3, 3) and (k, 3, 3); None if still."""
    if problem.environment.orbit is None or problem.environment.chaser_attitude != "lvlh":
        return None
    path = chaser_path(problem.environment, np.concatenate([[problem.times[0]], times, ahead[1:]]))
    R = rotation_matrix(path.q)
    return R[1 : 1 + len(times)], R[1 + len(times) :]


def _turned_back(
    problem: Problem, value: np.ndarray, across: int, reference: np.ndarray, turn: np.ndarray
) -> np.ndarray:
    """Foreseen images (k, 3) of a chaser that does not turn, as the turned chaser sees the same vector."""
    one, two = problem.cameras
    fu, fv, cu, cv = one.intrinsics
    ray = np.column_stack([(value[:, 0] - cu) / fu, (value[:, 1] - cv) / fv, np.ones(len(value))]) @ one.R
    slope = (value[:, 2] - two.intrinsics[2 + across]) / two.intrinsics[across]
    plane = two.R[across] - slope[:, None] * two.R[2]
    depth = -(plane @ (one.t - two.t)) / np.einsum("ni,ni->n", plane, ray)
    seen = reference + np.einsum("nji,nj->ni", turn, one.t + depth[:, None] * ray - reference)
    first, second = project(one, seen), project(two, seen)
    return np.column_stack([first, second[:, across]])
