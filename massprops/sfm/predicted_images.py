"""Images of a video that matching did not place: added where the motion predicts them.

Between neighbours a free body, or a hand with a camera, turns on at nearly the rate at which it turned before. The pose
so predicted tells a repeating pattern's cells apart, as it does in placed images (`massprops.sfm.guided`), and carries
over some images in which nothing can be matched.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import replace

import numpy as np
import pycolmap

from massprops.sfm.attempt import Attempt, ModelInputs
from massprops.sfm.convert import take_out_images, to_points, to_views
from massprops.sfm.database import drop_pairs, image_numbers
from massprops.sfm.distinct import unit
from massprops.sfm.guided import Gate, match_onto, place
from massprops.sfm.mapping import continue_mapping, verify
from massprops.sfm.points import SparsePoints
from massprops.views import Views

REACH = 4
"""Images beyond the last placed one that are predicted; the turn between neighbours changes little over so many."""

PARTNERS = 4
"""Placed images with which each predicted one is compared."""

RATE_OVER = 3
"""Images back from the last placed one over which the rate is taken."""

GATE = Gate(0.025, 0.025)

MOST_OFF_DEG = 15.0
"""How far an image may be turned off its prediction. On a CubeSat with like cells on four sides, one film, right images were off by
up to 10 degrees, where a rate was taken from images that had just been placed; the next side's cells turn an image by 90."""
MOST_ROUNDS = 60


def add_predicted_images(model: pycolmap.Reconstruction, given: ModelInputs) -> pycolmap.Reconstruction:
    """Adds the images whose poses the motion predicts, a few in each round; returns the model."""
    attempt, frames = given.found, given.footage.frames
    units = {n: unit(d) for n, (_, d) in attempt.features.items()}
    numbers = image_numbers(attempt.database)
    order = [f.name for f in frames if f.name in attempt.features]
    clock, streams = given.footage.times, sorted({(f.place, f.camera) for f in frames})
    stood = {f.name: streams.index((f.place, f.camera)) for f in frames}
    for turn in range(MOST_ROUNDS):
        before = model.num_reg_images()
        views, ids = to_views(model)
        points = to_points(model, ids)
        wanted = predicted(views, points, order, clock, stood)
        if not wanted.names:
            break
        matches = _matched(views, points, wanted, order, attempt, units)
        drop_pairs(attempt.database, ((numbers[a], numbers[b]) for a, b in matches))
        verify(attempt.database, numbers, matches, attempt.mapping)
        model = continue_mapping(model, attempt.database, given.frames, given.work / f"grown{turn}", attempt.mapping)
        after, ids = to_views(model)
        # by cells of another side, say
        off = off_prediction(views, wanted, after)
        if given.footage.rig:
            # the mapper goes on to images that no motion predicted: of a bus (Blender) all that were left were placed on its other wing
            off |= ~np.isin(after.names, [*views.names, *wanted.names])
        take_out_images(model, np.array(ids, int)[off].tolist())
        given.progress(model.num_reg_images(), len(order), "following the motion")
        if model.num_reg_images() <= before:
            break
    return model


def predicted(
    views: Views, points: SparsePoints, order: list[str], clock: dict[str, float], camera: dict[str, int] | None = None
) -> Views:
    """Poses of images near the placed ones, as the rate of turning beside them predicts.

    Args:
        order: names of all images in time, one camera's after the other's; clock: their times, any unit; camera: a number for the
            still camera that took each and its place, one by default.

    Returns:
        images that are not placed; the middle of the points keeps its place in the camera.
    """
    from scipy.spatial.transform import Rotation

    row = {n: i for i, n in enumerate(views.names)}
    middle = np.median(points.xyz, axis=0) if len(points.xyz) else np.zeros(3)
    there = np.array([n in row for n in order])
    stood = np.array([(camera or {}).get(n, 0) for n in order])
    index, R, t, names = [], [], [], []
    for k in np.flatnonzero(~there).tolist():
        use = there & (stood == stood[k])
        near = [j for j in range(max(0, k - REACH), min(len(order), k + REACH + 1)) if use[j]]
        if not near:
            continue
        first = min(near, key=lambda j: abs(j - k))
        side = 1 if first > k else -1
        second = next(
            (j for j in range(first + side * RATE_OVER, first, -side) if 0 <= j < len(order) and use[j]), None
        )
        if second is None:
            continue
        a, b = row[order[first]], row[order[second]]
        share = (clock[order[k]] - clock[order[first]]) / (clock[order[first]] - clock[order[second]])
        step = Rotation.from_matrix(views.R[a] @ views.R[b].T).as_rotvec()
        turned = Rotation.from_rotvec(share * step).as_matrix() @ views.R[a]
        seen = [views.R[i] @ middle + views.t[i] for i in (a, b)]
        index.append(a)
        R.append(turned)
        t.append(seen[0] + share * (seen[0] - seen[1]) - turned @ middle)
        names.append(order[k])
    chosen = views.take(np.array(index, int))
    return replace(chosen, names=tuple(names), R=np.array(R).reshape(-1, 3, 3), t=np.array(t).reshape(-1, 3))


def off_prediction(before: Views, wanted: Views, after: Views) -> np.ndarray:
    """(n,) bool: views of `after`, of `wanted` and not of `before`, that are turned off their prediction by too much.

    Args:
        before: placed when the poses of `wanted` were predicted; after: in axes of their own.
    """
    from scipy.spatial.transform import Rotation

    then = {n: i for i, n in enumerate(before.names)}
    guess = {n: i for i, n in enumerate(wanted.names)}
    both = [(i, then[n]) for i, n in enumerate(after.names) if n in then]
    out = np.zeros(len(after), bool)
    if not both:
        return out
    now, old = np.array(both).T
    axes = Rotation.from_matrix(after.R[now].transpose(0, 2, 1) @ before.R[old]).mean().as_matrix()
    for i, name in enumerate(after.names):
        if name in then or name not in guess:
            continue
        expected = wanted.R[guess[name]]
        off = Rotation.from_matrix(after.R[i] @ axes @ expected.T).magnitude()
        out[i] = off > np.deg2rad(MOST_OFF_DEG)
    return out


def _matched(
    views: Views, points: SparsePoints, wanted: Views, order: list[str], found: Attempt, units: dict[str, np.ndarray]
) -> dict[tuple[str, str], np.ndarray]:
    """Matches of placed images onto predicted ones."""
    both = Views.joined([views, wanted])
    position = {n: k for k, n in enumerate(order)}
    out = {}
    for i, name in enumerate(wanted.names, start=len(views)):
        target = place(both, points, i, found.features[name][0][:, :2] - 0.5)
        nearest = sorted(range(len(views)), key=lambda j: abs(position[views.names[j]] - position[name]))
        for j in nearest[:PARTNERS]:
            other = views.names[j]
            source = place(both, points, j, found.features[other][0][:, :2] - 0.5)
            out[other, name] = match_onto(both, (j, i), (source, target), (units[other], units[name]), GATE)
    return out
