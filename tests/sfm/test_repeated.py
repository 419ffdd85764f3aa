"""Repeating patterns: only what is unique is matched, and the model predicts where the twins belong."""

from dataclasses import replace

import numpy as np
import pytest
import scene

from massprops.sfm.distinct import describe, largest, match_distinct, repeating, unit
from massprops.sfm.guided import Gate, match_onto, match_placed, place, seen_alike
from massprops.sfm.points import project


def words(count, rng, spread=12):
    """Descriptors (count, 128) that are nearly orthogonal to each other."""
    out = np.zeros((count, 128))
    for row in out:
        row[rng.permutation(128)[:spread]] = 148.0
    return out


def noisy(rows, rng, sigma=6.0):
    return np.clip(rows + rng.normal(0, sigma, rows.shape), 0, 255).astype(np.uint8)


def test_only_what_has_no_twin_is_matched():
    rng = np.random.default_rng(0)
    unique, cell = words(30, rng), words(4, rng)
    look = np.concatenate([unique, np.tile(cell, (20, 1))])
    xy = rng.uniform(0, 640, (len(look), 2))
    a, b = (describe(xy, noisy(look, rng)) for _ in range(2))
    assert repeating([a, b]) == pytest.approx(80 / 110, abs=0.03)
    found = match_distinct(a, b)
    np.testing.assert_array_equal(found[:, 0], found[:, 1])
    assert 25 <= len(found) <= 30 and found.max() < 30


def test_two_directions_of_one_place_are_no_twins():
    rng = np.random.default_rng(1)
    look = words(10, rng)
    xy = rng.uniform(0, 640, (10, 2))
    both = describe(np.concatenate([xy, xy + 0.1]), noisy(np.concatenate([look, look]), rng))
    assert repeating([both]) == 0.0


def test_large_photographs_keep_as_many_of_the_largest_features_as_are_enough():
    rng = np.random.default_rng(4)
    look = np.concatenate([words(200, rng), np.tile(words(4, rng), (50, 1))])[rng.permutation(400)]
    keypoints = np.column_stack([rng.uniform(0, 4000, (400, 2)), rng.uniform(1, 9, 400), np.zeros(400)])
    seen = noisy(look, rng)
    row, described = largest(keypoints, seen, 50)
    kept = keypoints[row]
    assert len(described.index) >= 50
    # products of another batch differ by some 1e-7, which an arc cosine at .1 makes ten times as much
    np.testing.assert_allclose(described.own, describe(kept, seen[row]).own, atol=2e-5)
    assert len(kept) < 200 and kept[:, 2].min() > np.sort(keypoints[:, 2])[200]
    assert row.tolist() == sorted(row.tolist())
    for enough in (2, 1000):
        few, _ = largest(keypoints, np.tile(seen[:1], (400, 1)), enough)
        assert len(few) == 400


def test_images_without_features_match_nothing():
    rng = np.random.default_rng(2)
    none = describe(np.zeros((0, 4)), np.zeros((0, 128), np.uint8))
    some = describe(rng.uniform(0, 640, (5, 4)), noisy(words(5, rng), rng))
    assert match_distinct(none, some).shape == match_distinct(some, none).shape == (0, 2)
    assert repeating([some]) == 0.0


def test_twins_are_told_apart_by_their_predicted_place():
    rng = np.random.default_rng(3)
    views, points = scene.make(3, 300, noise=0.3, seed=3)
    look = words(5, rng)[np.arange(300) % 5]  # sixty twins of each
    tracks = points.observed(np.isin(points.obs_point, np.arange(0, 300, 3)))
    at = [points.obs_uv[points.obs_view == i] for i in (0, 1)]
    units = [unit(noisy(look, rng)) for _ in (0, 1)]
    # poses a little off, as of a model that drifted
    views.t[1] += [0.02, -0.01, 0.05]
    placed = [place(views, tracks, i, at[i]) for i in (0, 1)]
    found = match_placed(views, (0, 1), tuple(placed), tuple(units), Gate(0.022, 0.022))
    right = found[:, 0] == found[:, 1]
    assert len(found) > 60 and right.mean() > 0.9
    # by look alone one in sixty would be right
    blind = (units[0] @ units[1].T).argmax(1) == np.arange(300)
    assert blind.mean() < 0.2


def test_without_tracks_nothing_is_predicted():
    views, points = scene.make(3, 20)
    uv = points.obs_uv[points.obs_view == 0]
    nothing = points.observed(np.zeros(len(points.obs_view), bool))
    both = place(views, nothing, 0, uv), place(views, nothing, 1, uv)
    assert np.isnan(both[0].depth).all()
    rows = unit(noisy(words(len(uv), np.random.default_rng(0)), np.random.default_rng(1)))
    assert len(match_placed(views, (0, 1), both, (rows, rows), Gate(0.02, 0.02))) == 0


def test_a_feature_lies_on_its_ray():
    views, points = scene.make(3, 50, k1=0.05)
    own = points.obs_view == 1
    placed = place(views, points, 1, points.obs_uv[own])
    depth = points.xyz[points.obs_point[own]] @ views.R[1][2] + views.t[1][2]
    world = (placed.ray * depth[:, None] - views.t[1]) @ views.R[1]
    again = project(*(np.repeat(a[1:2], 50, 0) for a in (views.K, views.distortion, views.R, views.t)), world)
    np.testing.assert_allclose(again, points.obs_uv[own], atol=1e-3)
    assert (placed.depth[:, 0] <= placed.depth[:, 1]).all()


def test_a_predicted_image_is_matched_without_tracks_of_its_own():
    rng = np.random.default_rng(4)
    views, points = scene.make(3, 300, noise=0.3, seed=4)
    look = words(5, rng)[np.arange(300) % 5]
    at = [points.obs_uv[points.obs_view == i] for i in (0, 1)]
    units = [unit(noisy(look, rng)) for _ in (0, 1)]
    tracks = points.observed((points.obs_point % 3 == 0) & (points.obs_view == 0))
    placed = [place(views, tracks, i, at[i]) for i in (0, 1)]
    found = match_onto(views, (0, 1), tuple(placed), tuple(units), Gate(0.025, 0.025))
    assert len(found) > 60 and np.mean(found[:, 0] == found[:, 1]) > 0.8
    assert len(np.unique(found[:, 1])) == len(found)


def test_motion_predicts_the_images_beside_the_placed_ones():
    from massprops.sfm.predicted_images import REACH, predicted

    views, points = scene.make(20, 51, step_deg=5.0)
    # about the middle of the points, as a free body turns
    points = replace(points, xyz=points.xyz - np.median(points.xyz, axis=0))
    order = list(views.names)
    clock = {n: float(t) for n, t in zip(order, views.timestamp_ns, strict=True)}
    kept = np.r_[4:9, 15:18]
    found = predicted(views.take(kept), points, order, clock)
    # both ways from each end, and no farther; across the gap from the nearer side
    expected = {*range(4 - REACH, 4), *range(9, 9 + REACH), *range(15 - REACH, 15), *range(18, 20)}
    assert {order.index(n) for n in found.names} == expected
    for i, name in enumerate(found.names):
        k = order.index(name)
        np.testing.assert_allclose(found.R[i], views.R[k], atol=1e-9)
        np.testing.assert_allclose(found.t[i], views.t[k], atol=1e-9)


def test_an_image_placed_by_another_sides_cells_is_astray():
    from scipy.spatial.transform import Rotation

    from massprops.sfm.predicted_images import off_prediction, predicted

    views, points = scene.make(12, 60)
    order, clock = list(views.names), {n: float(i) for i, n in enumerate(views.names)}
    before = views.take(np.arange(3, 9))
    wanted = predicted(before, points, order, clock)
    # the adjustment has turned all axes, and one new image shows the next of four like sides
    axes = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    R = views.R @ axes
    R[10] = views.R[10] @ Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix() @ axes
    assert set(wanted.names) >= {views.names[9], views.names[10]}
    found = off_prediction(before, wanted, replace(views, R=R))
    assert np.flatnonzero(found).tolist() == [10]


def test_one_placed_image_predicts_nothing():
    from massprops.sfm.predicted_images import predicted

    views, points = scene.make(6, 20)
    clock = {n: float(i) for i, n in enumerate(views.names)}
    assert len(predicted(views.take(np.array([2])), points, list(views.names), clock)) == 0


def test_a_view_of_few_tracks_borrows_depth_from_views_of_its_side():
    views, points = scene.make(6, 300, seed=4, step_deg=16)
    # view 2 has three tracks; what only view 5 saw, 48 degrees on, is no neighbour's
    only_last = points.obs_point >= 200
    keep = np.where(points.obs_view == 2, points.obs_point < 3, ~only_last | (points.obs_view == 5))
    tracks = points.observed(keep)
    index, at = seen_alike(views, tracks, 2)
    assert set(index) == set(range(200))
    truth = points.obs_uv[points.obs_view == 2]
    np.testing.assert_allclose(at, truth[index], atol=1e-6)
    assert np.isnan(place(views, tracks, 2, truth).depth).all()
    assert np.isfinite(place(views, tracks, 2, truth, lent=True).depth).all()
