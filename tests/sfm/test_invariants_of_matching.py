"""What holds of matches, stretches of a film and lenses whatever the numbers are."""

from __future__ import annotations

import numpy as np
from drawn import arrays, numbers, quickly, rotations
from hypothesis import given
from hypothesis import strategies as st

from massprops.sfm.distinct import describe, match_distinct, repeating
from massprops.sfm.fisheye import fisheye_factor, widest_angle
from massprops.sfm.gated_search import likest, within
from massprops.sfm.guided import joined
from massprops.sfm.points import project, project_camera
from massprops.sfm.steady import largest_jump, stretches

ZERO = np.zeros((1, 4))


@quickly
@given(arrays((6, 2), 50.0), arrays((9, 2), 50.0), st.floats(1.0, 40.0))
def test_pairs_within_reach_are_those_of_every_pair(middle: np.ndarray, uv: np.ndarray, reach: float) -> None:
    which, other = within(uv, middle, np.full(len(middle), reach))
    away = np.linalg.norm(middle[:, None] - uv[None], axis=2)
    edge = np.abs(away - reach) < 1e-9
    found = np.zeros(away.shape, bool)
    found[which, other] = True
    np.testing.assert_array_equal(found[~edge], (away < reach)[~edge])


@quickly
@given(
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=8),
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=8),
)
def test_joined_matches_keep_the_first_and_use_no_feature_of_it_again(one: list, two: list) -> None:
    first, second = (np.array(m, int).reshape(-1, 2) for m in (one, two))
    both = joined(first, second)
    np.testing.assert_array_equal(both[: len(first)], first)
    for side in (0, 1):
        assert not set(both[len(first) :, side]) & set(first[:, side])


@quickly
@given(
    st.lists(st.tuples(st.integers(0, 4), st.integers(0, 6), st.floats(0.01, 1.5)), max_size=12), arrays((7, 2), 90.0)
)
def test_the_likest_is_one_for_each_and_alike_enough(pairs: list, uv: np.ndarray) -> None:
    pairs = sorted(pairs, key=lambda p: p[0])
    which, other, angle = (np.array([p[i] for p in pairs]) for i in range(3))
    rows, features = likest(which.astype(int), other.astype(int), angle.astype(float), uv)
    assert len(set(rows)) == len(rows)
    for row, feature in zip(rows, features, strict=True):
        own = which == row
        assert angle[own].min() in angle[own & (other == feature)]


@quickly
@given(st.integers(0, 2**31), st.integers(2, 12))
def test_an_image_matches_itself_feature_by_feature(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    keypoints = np.column_stack([np.arange(count) * 50.0, np.zeros((count, 3))])
    seen = describe(keypoints, rng.integers(0, 255, (count, 128), dtype=np.uint8))
    found = match_distinct(seen, seen)
    np.testing.assert_array_equal(found[:, 0], found[:, 1])
    assert 0.0 <= repeating([seen]) <= 1.0


@quickly
@given(st.lists(st.floats(0.01, 0.4), min_size=8, max_size=16), rotations(), st.data())
def test_stretches_part_a_film_the_same_way_from_any_side(
    turns: list[float], Q: np.ndarray, data: st.DataObject
) -> None:
    from scipy.spatial.transform import Rotation

    R = Rotation.from_rotvec(np.cumsum(turns)[:, None] * np.array([0.0, 0.6, 0.8])).as_matrix()
    times = np.arange(len(R), dtype=float)
    parts = stretches(R, times)
    every = np.concatenate(parts)
    assert len(set(every)) == len(every) <= len(R) and all(np.all(np.diff(p) == 1) for p in parts)
    assert [len(p) for p in parts] == sorted(map(len, parts), reverse=True)
    assert np.isclose(largest_jump(R @ Q, times), largest_jump(R, times), rtol=1e-6, atol=1e-9)
    assert np.isclose(largest_jump(R, 7.0 * times), largest_jump(R, times), rtol=1e-6)


@quickly
@given(arrays((5, 3)), rotations(), arrays(4, 0.05))
def test_a_bent_lens_leaves_the_axis_and_a_straight_one_is_a_pinhole(
    X: np.ndarray, R: np.ndarray, bend: np.ndarray
) -> None:
    K, t = np.array([[500.0, 0, 320], [0, 510.0, 240], [0, 0, 1]]), np.array([0.0, 0, 40])
    every = (np.tile(K, (5, 1, 1)), np.tile(ZERO, (5, 1)), np.tile(R, (5, 1, 1)), np.tile(t, (5, 1)))
    camera = X @ R.T + t
    np.testing.assert_allclose(project(*every, X), (camera @ K.T)[:, :2] / camera[:, 2:], atol=1e-9)
    on_axis = project_camera(K[None], bend[None], np.array([[0.0, 0.0, 3.0]]))
    np.testing.assert_allclose(on_axis, [[320.0, 240.0]])


@quickly
@given(numbers(-0.02, 0.02), numbers(-0.005, 0.005), st.floats(0.1, 1.2))
def test_the_angle_to_a_radius_of_a_fisheye_leads_back_to_it(k1: float, k2: float, radius: float) -> None:
    k = np.array([k1, k2, 0.0, 0.0])
    angle = widest_angle(k, radius)
    if angle < 1.4:
        assert np.isclose(angle * float(fisheye_factor(k, np.array(angle))), radius, atol=1e-3)
