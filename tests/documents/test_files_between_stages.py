"""What one stage writes the next one reads: arrays come back, and views and points mean the same after they are moved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from drawn import arrays, quickly, rotations
from hypothesis import given
from hypothesis import strategies as st

from massprops.geometry.projection import project
from massprops.sfm.points import SparsePoints
from massprops.sfm.verified_matches import VerifiedMatches
from massprops.surface.cloud import Cloud
from massprops.views import Views

NAMES = st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1, max_size=8).map(
    lambda s: s.strip("\0") or "a"
)
K = np.array([[500.0, 0, 160], [0, 500.0, 120], [0, 0, 1]])


@st.composite
def views(draw: st.DrawFn) -> Views:
    names = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    n = len(names)
    R, t = np.stack([draw(rotations()) for _ in names]), draw(arrays((n, 3)))
    return Views(
        tuple(names), np.arange(n) * 10**9, np.tile([320, 240], (n, 1)), np.tile(K, (n, 1, 1)), np.zeros((n, 4)), R, t
    )


@st.composite
def clouds(draw: st.DrawFn) -> Cloud:
    seen = draw(st.lists(st.lists(st.integers(0, 4), min_size=1, max_size=4, unique=True), min_size=1, max_size=5))
    n, start = len(seen), np.cumsum([0, *map(len, seen)])
    index = np.concatenate([np.array(s) for s in seen])
    return Cloud(draw(arrays((n, 3))), np.tile([0.0, 0, 1], (n, 1)), np.full(n, 0.1), start, index)


@quickly
@given(views())
def test_views_come_back(tmp_path: Path, one: Views) -> None:
    one.save(tmp_path / "views.npz")
    back = Views.load(tmp_path / "views.npz")
    assert back.names == one.names
    for name in ("timestamp_ns", "size", "K", "distortion", "R", "t"):
        np.testing.assert_array_equal(getattr(back, name), getattr(one, name))


@quickly
@given(views(), arrays((4, 3)), rotations(), arrays(3))
def test_images_of_a_moved_world_are_the_same(one: Views, X: np.ndarray, R: np.ndarray, t: np.ndarray) -> None:
    moved = one.moved(R, t)
    np.testing.assert_allclose(moved.centres, one.centres @ R.T + t, atol=1e-9)
    for i in range(len(one)):
        before, after = X @ one.R[i].T + one.t[i], (X @ R.T + t) @ moved.R[i].T + moved.t[i]
        np.testing.assert_allclose(after, before, atol=1e-9)
        if before[:, 2].min() > 1.0:
            np.testing.assert_allclose(
                project(X @ R.T + t, moved.K[i], moved.R[i], moved.t[i])[0],
                project(X, K, one.R[i], one.t[i])[0],
                atol=1e-6,
            )
    turn, shift = one.move_from(0, one.R[0], one.t[0])
    np.testing.assert_allclose(turn, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(shift, 0.0, atol=1e-9)


@quickly
@given(st.integers(1, 5), st.lists(st.tuples(st.integers(0, 3), st.integers(0, 4)), min_size=1, max_size=9), st.data())
def test_points_come_back_and_keep_their_observations(
    tmp_path: Path, count: int, seen: list[tuple[int, int]], data: st.DataObject
) -> None:
    view, point = np.array(seen).T
    count = max(count, int(point.max()) + 1)
    one = SparsePoints(
        np.arange(count) + 100, data.draw(arrays((count, 3))), np.zeros((count, 3), np.uint8), np.ones(count), view,
        point, data.draw(arrays((len(view), 2), 300.0)),
    )  # fmt: skip
    one.save(tmp_path / "points.npz")
    back = SparsePoints.load(tmp_path / "points.npz")
    for name in one.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(back, name), getattr(one, name))
    keep = np.array(data.draw(st.lists(st.booleans(), min_size=len(view), max_size=len(view))))
    some = one.observed(keep)
    np.testing.assert_array_equal(some.id[some.obs_point], one.id[one.obs_point[keep]])
    np.testing.assert_array_equal(some.obs_uv, one.obs_uv[keep])
    assert set(some.obs_point) == set(range(len(some.id))), "no point without an observation"


@quickly
@given(clouds(), st.permutations(range(5)))
def test_a_cloud_comes_back_and_its_views_can_be_numbered_anew(tmp_path: Path, one: Cloud, order: list[int]) -> None:
    one.save(tmp_path / "points.npz")
    back = Cloud.load(tmp_path / "points.npz")
    for name in one.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(back, name), getattr(one, name))
    number = np.array(order)
    again = one.of_views(number)
    np.testing.assert_array_equal(again.xyz, one.xyz)
    np.testing.assert_array_equal(again.view_index, number[one.view_index])
    np.testing.assert_array_equal(again.of_views(np.argsort(number)).view_index, one.view_index)
    gone = one.of_views(np.where(number == 0, -1, number))
    assert not (gone.view_index < 0).any() and len(gone) <= len(one)


@quickly
@given(st.lists(st.tuples(NAMES, NAMES), min_size=1, max_size=3), st.data())
def test_matches_come_back_and_go_with_their_pairs(
    tmp_path: Path, pairs: list[tuple[str, str]], data: st.DataObject
) -> None:
    pair = np.array(data.draw(st.lists(st.integers(0, len(pairs) - 1), min_size=1, max_size=6)))
    one = VerifiedMatches(tuple(pairs), pair, data.draw(arrays((len(pair), 4), 300.0)), np.ones(len(pair), bool))
    one.save(tmp_path / "matches.npz")
    back = VerifiedMatches.load(tmp_path / "matches.npz")
    assert back.pairs == one.pairs
    np.testing.assert_array_equal(back.places, one.places)
    kept = data.draw(st.lists(st.booleans(), min_size=len(pairs), max_size=len(pairs)))
    some = one.of(kept)
    assert some.pairs == tuple(p for p, k in zip(pairs, kept, strict=True) if k)
    assert [some.pairs[k] for k in some.pair] == [pairs[k] for k in pair if kept[k]]
