"""Further matches that a model predicts: views of one side from other times, and features at predicted places."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from pathlib import Path

import numpy as np
import pycolmap

from massprops.geometry import vectors
from massprops.sfm import pairs as pairing
from massprops.sfm.attempt import ModelInputs, SfmOptions
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.database import drop_pairs
from massprops.sfm.distinct import unit
from massprops.sfm.footage import FootageRecord
from massprops.sfm.guided import Gate, Placed, joined, match_placed, off_line, place
from massprops.sfm.mapping import retriangulate, verify
from massprops.sfm.points import SparsePoints
from massprops.sfm.refine import Effort, adjust, remove_outliers
from massprops.sfm.sound import require_sound, take_out
from massprops.views import Views

GATES = (Gate(0.022, 0.022), Gate(0.0125, 0.006))
"""First for poses that drifted, then for poses that are right; far less than the period of a pattern both times."""

NEXT = 3
"""Images onwards in time that each is compared with."""


def close_loops(model: pycolmap.Reconstruction, given: ModelInputs) -> pycolmap.Reconstruction:
    """Matches pairs that the first model predicts to show the same side, and rebuilds the tracks with them."""
    attempt, options = given.found, given.options
    views, ids = to_views(model)
    points = to_points(model, ids)
    chosen = _facing(views, points, given.footage, options, options.overlap + 1)
    with pycolmap.Database.open(attempt.database) as db:
        pair_ids, _ = db.read_two_view_geometry_num_inliers()
    number = {model.image(i).name: i for i in ids}
    known = set(pair_ids)
    new = [(a, b) for a, b in chosen if pycolmap.image_pair_to_pair_id(number[a], number[b]) not in known]
    if new:
        attempt.match(new)
    return retriangulate(model, attempt.database, given.frames, given.work / "tracks", attempt.mapping)


def match_predicted(
    model: pycolmap.Reconstruction, given: ModelInputs, work: Path, fresh: set[str] | None = None
) -> pycolmap.Reconstruction:
    """Rebuilds the tracks from matches at the places that the model predicts, twice, with an adjustment between.

    Args:
        work: folder for the raw models of this step.
        fresh: names of images whose pairs are matched so; None for all.

    Raises:
        NotPossible: the images do not hold together by them.
    """
    attempt, footage, options = given.found, given.footage, given.options
    mapping = attempt.mapping
    units = {n: unit(d) for n, (_, d) in attempt.features.items()}
    for turn, gate in enumerate(GATES):
        views, ids = to_views(model)
        points = to_points(model, ids)
        number = dict(zip(views.names, ids, strict=True))
        row = {n: i for i, n in enumerate(views.names)}
        lent = fresh or set()
        placed = {n: place(views, points, i, attempt.features[n][0][:, :2] - 0.5, n in lent) for n, i in row.items()}
        chosen = set(views.names) if fresh is None else fresh
        pairs = pairs_to_compare(views, points, footage, options, NEXT + 1)
        pairs = [pair for pair in pairs if chosen.intersection(pair)]
        matches = _agreeing(attempt.database, views, ids, placed, gate)
        matches = {pair: m for pair, m in matches.items() if chosen.intersection(pair)}
        for done, (a, b) in enumerate(pairs):
            pair, both = (row[a], row[b]), (placed[a], placed[b])
            new = match_placed(views, pair, both, (units[a], units[b]), gate)
            old = matches.pop((b, a))[:, ::-1] if (b, a) in matches else matches.get((a, b), new[:0])
            matches[a, b] = joined(new, old)
            given.progress(done + 1, len(pairs), "guided matching")
        forget(attempt.database, ids, {number[n] for n in chosen if n in number})
        verify(attempt.database, number, matches, mapping)
        model = retriangulate(model, attempt.database, given.frames, work / f"tracks{turn}", mapping)
        settings = options.refine
        loss = remove_outliers(model, settings, 2.0)
        adjust(model, not mapping.fixed_intrinsics, False, loss, mapping.threads, Effort(20), mapping.constant)
        require_sound(take_out(model, settings.given_focal)[2], settings.moving)
    return model


def forget(database: Path, ids: list[int], fresh: set[int]) -> None:
    """Takes the matches of images `fresh` with the placed images `ids` out of a database; all others stay."""
    placed = set(ids)
    pairs = {(min(a, b), max(a, b)) for a in fresh & placed for b in placed - {a}}
    drop_pairs(database, sorted(pairs))


def _agreeing(
    database: Path, views: Views, ids: list[int], placed: dict[str, Placed], gate: Gate
) -> dict[tuple[str, str], np.ndarray]:
    """Matches so far, by pair of names, that lie near the model's epipolar lines."""
    row = {image_id: i for i, image_id in enumerate(ids)}
    out = {}
    with pycolmap.Database.open(database) as db:
        pair_ids, geometries = db.read_two_view_geometries()
    for pair_id, geometry in zip(pair_ids, geometries, strict=True):
        first, second = pycolmap.pair_id_to_image_pair(pair_id)
        matches = np.asarray(geometry.inlier_matches, np.uint32).reshape(-1, 2)
        if first in row and second in row and len(matches):
            i, j = row[first], row[second]
            a, b = views.names[i], views.names[j]
            near = off_line(views, (i, j), placed[a].ray[matches[:, 0]], placed[b].ray[matches[:, 1]])
            out[a, b] = matches[near < gate.line * views.size[j].max()]
    return out


def pairs_to_compare(
    views: Views, points: SparsePoints, footage: FootageRecord, options: SfmOptions, apart: int
) -> list[tuple[str, str]]:
    """Names of neighbours in time, and of views of one side that are at least `apart` images from each other."""
    return sorted({*_next(views, footage), *_facing(views, points, footage, options, apart)})


def _next(views: Views, footage: FootageRecord) -> list[tuple[str, str]]:
    order = [f.name for f in footage.frames if f.name in set(views.names)]
    return [(order[i], order[j]) for i, j in pairing.near(len(order), NEXT)]


def _facing(
    views: Views, points: SparsePoints, footage: FootageRecord, options: SfmOptions, apart: int
) -> list[tuple[str, str]]:
    """Names of views of one side that are at least `apart` images from each other, in the footage's order."""
    order = {f.name: i for i, f in enumerate(footage.frames)}
    index = np.argsort([order[n] for n in views.names], kind="stable")
    names = [views.names[i] for i in index]
    directions = view_directions(views, points)[index]
    chosen = pairing.spread_facing(directions, options.loops, apart, options.loop_angle_deg)
    return [(names[i], names[j]) for i, j in chosen]


def view_directions(views: Views, points: SparsePoints) -> np.ndarray:
    """(n, 3) unit vectors from the middle of the points to each camera, in the world."""
    return vectors.unit(views.centres - np.median(points.xyz, axis=0))


def spread_deg(views: Views, points: SparsePoints) -> float:
    """Largest angle between the directions from which the object was seen [degrees]."""
    d = view_directions(views, points)
    return float(np.rad2deg(np.arccos(np.clip((d @ d.T).min(), -1, 1))))
