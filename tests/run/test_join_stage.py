"""Views, sparse points and dense points carried into one frame."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from massprops.capture.from_shape import overlap
from massprops.dynamics.quaternion import rotation_matrix
from massprops.geometry.rasterise import rasterise
from massprops.run import silhouettes_again
from massprops.run.drawn_silhouettes import Visible
from massprops.run.stages import join
from massprops.run.stages.join import _best_first, _entry_of, _laid, _laid_again, _reason, _support
from massprops.sfm.across import Laid
from massprops.sfm.points import SparsePoints, project
from massprops.surface.cloud import Cloud
from massprops.surface.registration import Registration
from massprops.views import Views

RNG = np.random.default_rng(0)
R = rotation_matrix(np.array([0.5, 0.5, -0.5, 0.5]))
T = np.array([0.3, -0.2, 0.1])


def views(n: int) -> Views:
    turned = np.stack([rotation_matrix(q / np.linalg.norm(q)) for q in RNG.standard_normal((n, 4))])
    K = np.tile(np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), (n, 1, 1))
    shift = np.tile([0, 0, 9.0], (n, 1))
    names = tuple(f"cam0/{i}.png" for i in range(n))
    return Views(names, np.arange(n), np.tile([640, 480], (n, 1)), K, np.zeros((n, 4)), turned, shift)


def sparse() -> SparsePoints:
    m, k = 6, 12
    view, point = np.repeat([0, 1, 2], 4), np.tile([0, 1, 2, 3, 4, 5], 2)
    return SparsePoints(
        np.arange(m),
        RNG.standard_normal((m, 3)),
        np.zeros((m, 3), np.uint8),
        np.zeros(m),
        view,
        point,
        np.zeros((k, 2)),
    )


def registered(**kwargs: Any) -> Registration:
    usual = {"outside_px": 0.7, "rival_px": 1.4, "colour": 0.0, "rival_colour": 0.0, "colour_noise": 0.03}
    return Registration(R, T, **({"covariance": 1e-4 * np.eye(6)} | usual | kwargs))


def test_silhouettes_that_are_wrong_by_more_than_the_answers_differ_decide_nothing() -> None:
    """As of a padlock, whose silhouettes missed its shackle: the best answer was wrong, 0.7 px to 1.4 px."""
    assert registered().clear and not registered(own_px=0.8).clear
    assert registered(own_px=0.2, rival_px=3.7).clear
    said = _entry_of(registered(symmetric=True))
    assert said["symmetric"] is True and json.loads(json.dumps(said)) == said
    assert "equally well" in _reason(registered(own_px=0.8))
    assert "another object" in _reason(registered(outside_px=5.0))


def test_a_placement_known_by_what_it_hides_is_joined_by_clear_outlines_alone() -> None:
    """As of a padlock: 1.0 px to 4.0 px, and paint that would decide by itself does not."""
    assert registered(outside_px=1.0, own_px=0.2, rival_px=4.0).by_outlines
    assert not registered(outside_px=1.0, own_px=0.2, rival_px=3.0, colour=0.9).by_outlines
    assert not registered(outside_px=2.0, rival_px=20.0, colour=0.9).by_outlines, "and no other way fits"
    assert _entry_of(registered(own_px=0.2, rival_px=3.7))["by_outlines"] is True


def test_shape_that_is_far_clearer_than_all_else_joins_a_body_without_paint() -> None:
    """As of a plain rock: 0.7 px to 4.8 px, and colours that correlate nowhere."""
    assert registered(own_px=0.3, rival_px=4.8).unpainted
    assert registered(own_px=0.3, rival_px=4.8, colour=-0.27).unpainted, (
        "relief that was light is dark once it is turned"
    )
    assert not registered(own_px=0.3, rival_px=2.0).unpainted, "another turn is as good as silhouettes can tell"
    assert not registered(own_px=0.3, rival_px=4.8, colour=0.45).unpainted, "its paint says something"
    assert not registered(own_px=0.3, rival_px=4.8, rival_colour=0.2).unpainted, "or says something of another turn"


def test_others_are_laid_onto_the_placement_whose_silhouettes_agree() -> None:
    """Half of a cup was taken for its stand in one of two placements of as many images."""
    both = [{"method": "measured"}, {"method": "measured"}, {"method": "hides its support"}]
    assert _best_first(both, [28, 28, 40], {0: 3.0, 1: 0.3}) == [1, 0, 2]
    assert _best_first(both, [35, 21, 40], {0: 0.6, 1: 0.3}) == [0, 1, 2]
    assert _best_first(both[1:], [28, 40], {0: 3.0}) == [0, 1]


def test_features_join_what_shape_and_paint_leave_open(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there are none, shape decides and is trusted less."""
    over = np.diag([1.0, -1, -1])
    unclear = registered(rival_px=0.8, candidates=((R, T), (over, T)))

    def lay(first: Any, second: Any, starts: Any, anywhere: bool) -> Laid:
        return Laid(*starts[1], 1e-8 * np.eye(6), np.zeros(3), 90, 0.3, 200, 5.0)

    monkeypatch.setattr("massprops.sfm.across.lay", lay)
    monkeypatch.setattr("massprops.sfm.across.contradicted", lambda *_: False)
    monkeypatch.setattr("massprops.surface.paint.overlap", lambda *_: 0.5)
    side = SimpleNamespace(beside=lambda *_: side)
    placed = SimpleNamespace(shape=np.array([[-1.0, 0, 0], [1.0, 0, 0]]), pixel=0.01, middle=np.zeros(3), support=None)
    job: Any = SimpleNamespace(seed=0)
    pair: Any = (placed, side)
    said, turn, _ = _laid(job, pair, pair, unclear)
    assert "reason" not in said and said["features"] == 90 and np.array_equal(turn, over)
    assert json.loads(json.dumps(said)) == said
    monkeypatch.setattr("massprops.sfm.across.lay", lambda *_, **__: None)
    assert "reason" in _laid(job, pair, pair, unclear)[0]
    said, turn, _ = _laid(job, pair, pair, registered())
    assert "reason" not in said and np.array_equal(turn, R)
    assert np.allclose(np.sqrt(np.diag(said["joint"]["covariance"])), 0.01)
    monkeypatch.setattr("massprops.sfm.across.contradicted", lambda *_: True)
    assert "look alike" in _laid(job, pair, pair, registered())[0]["reason"]
    shaped = registered(rival_px=4.8)
    assert "reason" not in _laid(job, pair, pair, shaped)[0], "features of light and shade have no say"
    monkeypatch.setattr("massprops.sfm.across.lay", lay)
    said, turn, _ = _laid(job, pair, pair, shaped)
    assert said["features"] == 0 and np.array_equal(turn, R), (
        "neither against the outlines nor for a turn beside theirs"
    )


@pytest.mark.parametrize(("outside", "joins"), [(0.5, True), (2.4, False)])
def test_an_answer_that_misses_first_silhouettes_is_asked_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, outside: float, joins: bool
) -> None:
    over = R @ np.diag([1.0, -1, -1])
    missing = registered(outside_px=2.2, rival_px=3.6, candidates=((R, T), (over, T)))
    drawn: list[np.ndarray] = []

    def redrawn(job: Any, _: Any, parts: Any) -> list[str]:
        (job.out / "masks").mkdir(parents=True)
        drawn.append(parts[1][1])
        return []

    def again(found: Registration, fits: Any) -> Registration:
        assert found is missing and len(fits) == 2
        return replace(found, outside_px=outside, rival_px=5.0)

    monkeypatch.setattr(join, "_redrawn", redrawn)
    monkeypatch.setattr(join, "_latest", lambda *_: [])
    monkeypatch.setattr(join, "replace", lambda job, out: SimpleNamespace(**{**vars(job), "out": out}))
    monkeypatch.setattr("massprops.surface.placed.with_silhouettes", lambda side, *_: side)
    monkeypatch.setattr("massprops.surface.laid_again.drawn_again", again)
    monkeypatch.setattr("massprops.sfm.across.lay", lambda *_, **__: None)
    side = SimpleNamespace(middle=np.zeros(3), support=None)
    shown: Any = {k: (side, None) for k in (0, 1)}
    job: Any = SimpleNamespace(seed=0, out=tmp_path)
    index = {0: np.arange(3), 1: np.arange(3, 6)}
    said, turn, _ = _laid_again(job, views(6), [], index, shown, missing)
    assert ("reason" in said) != joins and np.array_equal(turn, R)
    assert len(drawn) == 2 and np.array_equal(drawn[1], over) and not list(tmp_path.iterdir())


def test_features_of_one_pattern_on_two_sides_do_not_overrule_outlines(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a part whose plate has one pattern above and below: most features agree the wrong way up."""
    over = R @ np.diag([1.0, -1, -1])
    found = registered(colour=0.5, candidates=((R, T), (over, T)))

    def lay(first: Any, second: Any, starts: Any, anywhere: bool) -> Laid:
        return Laid(*starts[-1], 1e-8 * np.eye(6), np.zeros(3), 90, 0.3, 200, 5.0)

    monkeypatch.setattr("massprops.sfm.across.lay", lay)
    monkeypatch.setattr("massprops.sfm.across.contradicted", lambda *_: False)
    monkeypatch.setattr("massprops.surface.paint.overlap", lambda *_: 0.5)
    placed, job = SimpleNamespace(support=None), SimpleNamespace(seed=0)
    side = SimpleNamespace(beside=lambda *_: side)
    monkeypatch.setattr(join, "_on_both_shapes", lambda *_: None)
    for excluded, wanted in ((False, over), (True, R)):
        monkeypatch.setattr("massprops.surface.laid_again.outlines_exclude", lambda *_, e=excluded: e)
        said, turn, _ = _laid(job, (placed, side), (placed, side), found)  # type: ignore[arg-type]
        assert np.array_equal(turn, wanted) and said["features"] == 90


@pytest.mark.parametrize(
    ("right", "wrong", "taken"),
    [((184, 24.0), (132, 32.0), True), ((132, 32.0), (184, 24.0), False), (None, None, False)],
)
def test_ends_that_look_alike_are_told_by_features_on_both_shapes(
    monkeypatch: pytest.MonkeyPatch, right: tuple[int, float] | None, wrong: tuple[int, float] | None, taken: bool
) -> None:
    """As of a toy whose outlines and paint are clear, and of whose features 42 agree with its other end in front."""
    over = R @ np.diag([1.0, -1, -1])
    found = registered(colour=0.5, candidates=((R, T), (over, T)))

    def lay(first: Any, second: Any, starts: Any, anywhere: bool) -> Laid | None:
        if len(starts) > 1:
            return Laid(*starts[-1], 1e-8 * np.eye(6), np.zeros(3), 42, 0.3, 154, 40.5)
        counts = right if starts[0][0] is R else wrong
        return None if counts is None else Laid(*starts[0], 1e-8 * np.eye(6), np.zeros(3), 60, 0.3, *counts)

    monkeypatch.setattr("massprops.sfm.across.lay", lay)
    monkeypatch.setattr("massprops.sfm.across.contradicted", lambda *_: False)
    monkeypatch.setattr("massprops.surface.paint.overlap", lambda *_: 0.5)
    monkeypatch.setattr("massprops.surface.laid_again.outlines_exclude", lambda *_: False)
    side = SimpleNamespace(beside=lambda *_: side)
    placed, job = SimpleNamespace(support=None), SimpleNamespace(seed=0)
    said, turn, _ = _laid(job, (placed, side), (placed, side), found)  # type: ignore[arg-type]
    assert np.array_equal(turn, R if taken else over) and said["features"] == (60 if taken else 42)


@pytest.mark.parametrize("same", [True, False])
def test_two_ways_up_that_look_alike_are_joined_turned_over(monkeypatch: pytest.MonkeyPatch, same: bool) -> None:
    """As of a screwdriver with one plate on both sides: features lay its two ways up so that both show the same side."""
    over = R @ np.diag([1.0, -1, -1])
    turned = registered(rival_px=np.inf, symmetric=True)
    found = registered(colour=0.5, turned=replace(turned, R=over))
    laid = Laid(R, T, 1e-8 * np.eye(6), np.zeros(3), 144, 0.3, 441, 50.0)
    monkeypatch.setattr("massprops.sfm.across.lay", lambda *_, **__: laid)
    monkeypatch.setattr("massprops.sfm.across.same_surface", lambda *_: same)
    monkeypatch.setattr("massprops.sfm.across.contradicted", lambda *_: False)
    monkeypatch.setattr("massprops.surface.paint.overlap", lambda *_: 0.5)
    up = np.array([0.0, 0, 1, 0])
    first, second = SimpleNamespace(support=up, middle=np.zeros(3)), SimpleNamespace(support=up, middle=np.zeros(3))
    second.support = np.append(R.T @ up[:3], 0.0)
    warned: list[str] = []
    job: Any = SimpleNamespace(seed=0, warn=warned.append)
    said, turn, _ = _laid(job, (first, None), (second, None), found)  # type: ignore[arg-type]
    assert np.array_equal(turn, R if same else over)
    assert said["features"] == (144 if same else 0) and ("alike" in said) is not same
    assert (len(warned) == 0) is same


@pytest.mark.parametrize(
    ("same", "rival_px", "turned_px", "joins"),
    [
        (True, 0.25, 0.3, True),
        (False, 0.25, 0.3, False),
        (False, 5.0, 0.3, False),
        (None, 0.25, 0.3, True),
        (False, 5.0, 5.0, True),
        (False, 0.25, 5.0, True),
    ],
)
def test_one_side_seen_twice_is_joined_where_its_features_say_so(
    monkeypatch: pytest.MonkeyPatch, same: bool | None, rival_px: float, turned_px: float, joins: bool
) -> None:
    """As of a thing that was moved on its support, or turned over onto a side that looks like the other one."""
    found = registered(colour=0.5, outside_px=0.1, rival_px=rival_px, turned_px=turned_px)
    monkeypatch.setattr(
        "massprops.sfm.across.lay", lambda *_, **__: Laid(R, T, np.eye(6), np.zeros(3), 144, 0.3, 441, 50.0)
    )
    monkeypatch.setattr("massprops.sfm.across.same_surface", lambda *_: same)
    monkeypatch.setattr("massprops.sfm.across.contradicted", lambda *_: False)
    monkeypatch.setattr("massprops.surface.paint.overlap", lambda *_: 0.5)
    up = np.array([0.0, 0, 1])
    first, second = (SimpleNamespace(support=np.append(n, 0.0), middle=np.zeros(3)) for n in (up, R.T @ up))
    job: Any = SimpleNamespace(seed=0)
    said = _laid(job, (first, None), (second, None), found)[0]  # type: ignore[arg-type]
    assert ("reason" not in said) is joins
    planes = [{"support_plane": [0.0, 0, 1, 0], "support_rise": 0.1}, {}]
    shown: Any = {0: (first, None), 1: (second, None)}
    part: Any = np.arange(3)
    moved = _support(planes, shown, [(part, np.eye(3), T, 0), (part, R, T, 1)])
    over = _support(planes, shown, [(part, np.eye(3), T, 0), (part, np.diag([1.0, -1, -1]) @ R, T, 1)])
    assert moved == planes[0] and over["support_plane"] is None
    assert _support(planes, shown, [(part, np.eye(3), T, 0)]) == planes[0]


def test_moving_views_with_their_world_changes_no_image() -> None:
    before, xyz = views(3), RNG.standard_normal((3, 3))
    after = before.moved(R, T)
    pixels = [project(v.K, v.distortion, v.R, v.t, x) for v, x in ((before, xyz), (after, xyz @ R.T + T))]
    assert np.allclose(*pixels, atol=1e-9)
    assert len(Views.joined([before, after])) == 6


def test_points_keep_what_saw_them() -> None:
    points = sparse()
    part = points.of_views(np.array([2, 0]))
    assert set(part.obs_view) == {0, 1}
    whole = {(int(v), int(points.id[p])) for v, p in zip(points.obs_view, points.obs_point, strict=True) if v != 1}
    assert {([2, 0][v], int(part.id[p])) for v, p in zip(part.obs_view, part.obs_point, strict=True)} == whole
    both = SparsePoints.joined([points, part.moved(R, T, 3)])
    assert len(both.xyz) == 6 + len(part.xyz) and both.obs_view.max() == 4
    assert np.allclose(both.xyz[both.obs_point[12:]], (part.xyz @ R.T + T)[part.obs_point])


def test_a_cloud_loses_the_lines_of_sight_of_views_that_go() -> None:
    cloud = Cloud(np.eye(3), np.eye(3), np.ones(3), np.array([0, 2, 3, 5]), np.array([0, 1, 1, 2, 0]))
    kept = cloud.of_views(np.array([1, -1, 0]))
    assert np.array_equal(kept.xyz, np.eye(3)[[0, 2]]), "the second was seen by the view that went alone"
    assert [kept.view_index[a:b].tolist() for a, b in zip(kept.view_start, kept.view_start[1:], strict=False)] == [
        [1],
        [0, 1],
    ]
    both = Cloud.joined([kept, kept.moved(R, T, 5)])
    assert len(both) == 4 and both.view_index.tolist() == [1, 0, 1, 6, 5, 6]


def half_box(low: float, high: float) -> Visible:
    """What stereo measured of a red cube of side 2 about the origin, between two heights, before nothing."""
    mesh = trimesh.creation.box(bounds=[[-1, -1, low], [1, 1, high]]).subdivide_to_size(0.1)
    points = np.asarray(mesh.vertices)
    none = np.zeros((0, 3))
    return Visible(points, np.asarray(mesh.faces), None, points, np.tile([40, 40, 200], (len(points), 1)), none, none)


@pytest.mark.parametrize("lacks", [True, False])
def test_a_silhouette_that_lacks_what_another_placement_measured_is_drawn_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, lacks: bool
) -> None:
    here = views(3)
    cube, seen = half_box(-1, 1), []
    for i in range(3):
        whole = rasterise(cube.vertices, cube.faces, here.K[i], here.R[i], here.t[i], (640, 480))[0] < np.inf
        seen.append(whole)
    image = [np.where(w[..., None], np.uint8([40, 40, 200]), np.uint8([120, 120, 120])) for w in seen]
    upper = half_box(0, 1) if lacks else cube
    known = [
        np.where(
            np.isfinite(rasterise(upper.vertices, upper.faces, here.K[i], here.R[i], here.t[i], (640, 480))[0]), 255, 0
        )
        for i in range(3)
    ]
    shown = {0: half_box(0, 1), 1: half_box(-1, 0)}
    monkeypatch.setattr(join, "scene_in", lambda folder, painted: shown[int(folder.name[-1])])
    monkeypatch.setattr(join, "learned_paint", lambda folders: None)
    monkeypatch.setattr(silhouettes_again, "undistorted_frame", lambda job, views, i: image[int(views.names[i][5])])
    monkeypatch.setattr(join, "_masks", lambda job, views: [known[int(n[5])].astype(np.uint8) for n in views.names])
    job: Any = SimpleNamespace(work=lambda stage: tmp_path, out=tmp_path, progress=lambda *_: None)
    one, two = here.take(np.array([0, 1])), here.take(np.array([2]))
    placements = [{"method": "measured"}] * 2
    found = join._redrawn(job, placements, [(one, np.eye(3), np.zeros(3), 0), (two, np.eye(3), np.zeros(3), 1)])
    assert found == (list(here.names) if lacks else [])
    for i, name in enumerate(found):
        mask = cv2.imread(str(tmp_path / "masks" / f"{name}.png"), 0)
        assert overlap(mask == 255, seen[i]) > 0.97


def test_outlines_drawn_again_settle_what_no_feature_laid(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of three parts the second was laid by features and the third by outlines; one silhouette was drawn again."""
    here = views(3)
    again = np.zeros((480, 640), np.uint8)
    again[100:200, 100:200] = 255
    (tmp_path / "masks" / here.names[2]).parent.mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "masks" / f"{here.names[2]}.png"), again)
    monkeypatch.setattr(join, "_masks", lambda job, views: [np.zeros((480, 640), np.uint8) for _ in views.names])
    shows = {}

    def with_silhouettes(side: Any, views: Any, masks: Any, seed: int) -> Any:
        shows[side] = [int(np.count_nonzero(m)) for m in masks]
        return SimpleNamespace(middle=np.zeros(3))

    monkeypatch.setattr("massprops.surface.placed.with_silhouettes", with_silhouettes)
    monkeypatch.setattr("massprops.surface.laid_again.settled", lambda a, b, R, t: (R, t + 1.0))
    job: Any = SimpleNamespace(out=tmp_path, seed=0)
    parts = [(np.array([i]), np.eye(3), np.zeros(3), i) for i in range(3)]
    said: list[dict[str, Any]] = [{}, {"features": 90, "joint": {}}, {"features": 0, "joint": {}}]
    shown: Any = {0: "first", 1: "second", 2: "third"}
    found = join._settled(job, here, parts, shown, said)
    assert [t.tolist() for _, _, t, _ in found] == [[0.0] * 3, [0.0] * 3, [1.0] * 3]
    assert said[2]["joint"]["about"] == [1.0] * 3 and "about" not in said[1]["joint"]
    assert shows == {"first": [0], "second": [0], "third": [10_000]}
