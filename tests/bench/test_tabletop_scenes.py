"""The table-top scenes as they are described and prepared; nothing is rendered here."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from tabletop import cameras, rooms
from tabletop.develop import distort
from tabletop.objects import KINDS, own, resting_poses
from tabletop.prepare import BY_HAND, MARGIN, _turned_by_hand, prepare
from tabletop.scenes import SCENES, by_name
from tabletop.silhouettes import project
from tabletop.truth import read_scene_truth
from trimesh.transformations import translation_matrix


def test_the_scenes_are_those_asked_for() -> None:
    assert len(SCENES) == 24 and len({s.name for s in SCENES}) == 24
    assert sum(s.held_out for s in SCENES) == 12
    scanned = [s.item for s in SCENES if s.item[0].isdigit()]
    assert len(scanned) >= 12 and len(set(scanned)) == len(scanned), "a scan is in one half only"
    for half in (False, True):
        mine = [s for s in SCENES if s.held_out is half]
        assert sum(s.turned for s in mine) == 4 and all(s.images == "photos" for s in mine if s.turned)
        assert {s.images for s in mine} == {"video", "photos", "turntable"}
        assert {s.finish for s in mine} >= {"textured", "glossy"} and any(s.cluttered for s in mine)
        assert {s.table for s in mine} == set(rooms.TABLES)


def test_a_scene_can_be_drawn_anew() -> None:
    first, again = by_name("09_held_part"), by_name("09_held_part-2")
    assert again.held_out and (again.item, again.turned, again.number) == (first.item, first.turned, first.number)
    assert own(again).mesh.volume != own(first).mesh.volume
    assert (
        own(again).mesh.volume
        == own(by_name("09_held_part-2")).mesh.volume
        != own(by_name("09_held_part-3")).mesh.volume
    )
    for name in ("09_held_part-1", "09_held_part-", "nothing-2"):
        with pytest.raises(KeyError):
            by_name(name)


def test_a_hand_turns_the_object_and_what_is_seen_of_it_stays() -> None:
    """Cameras all round the object come to stand on one side of it, and each sees it as it did."""
    target, body = np.array([0.1, 0.2, 0.05]), translation_matrix([0.1, 0.2, 0.0])
    shots = [[p] * 3 for p in cameras.photographs(np.random.default_rng(0), 24, 0.5, target)]
    push = np.full((8, 2), 0.01)
    for i, shot in enumerate(shots):
        found = _turned_by_hand(shots, i, body, target, push[i // BY_HAND])
        np.testing.assert_allclose(
            np.linalg.inv(found["camera"][1]) @ found["body"][1], np.linalg.inv(shot[1]) @ body, atol=1e-12
        )
        if i % BY_HAND == 0:
            away = found["camera"][1][:2, 3] - found["body"][1][:2, 3]
            assert abs(np.arctan2(away[1], away[0])) < np.radians(5)


def test_photographs_of_an_arc_are_taken_from_one_half_of_the_room() -> None:
    poses = np.array(cameras.photographs(np.random.default_rng(1), 40, 0.5, np.zeros(3), np.pi))
    assert np.mean(poses[:, 1, 3] > 0) > 0.9 and np.ptp(poses[:, 0, 3]) > 0.5
    assert by_name("34_dev_shoe").arc and not by_name("08_dev_shoe").arc


@pytest.mark.parametrize("kind", KINDS)
def test_our_objects_are_closed_and_rest_on_the_table(kind: str) -> None:
    for scene in (s for s in SCENES if s.item == kind):
        mesh = own(scene).mesh
        assert mesh.is_volume and mesh.body_count == 1
        assert 0.05 < mesh.extents.max() < 0.32
        poses = resting_poses(mesh, scene.up, scene.turned)
        for pose in poses:
            points = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
            assert points[:, 2].min() == pytest.approx(0, abs=1e-9)
            # the centre of mass stands over what touches the table, or it would fall
            low = points[points[:, 2] < 2e-4 * mesh.scale][:, :2]
            assert np.all(low.min(0) <= 1e-6) and np.all(low.max(0) >= -1e-6)
        if scene.turned:
            assert poses[0][2, :3] @ poses[1][2, :3] < 0


def test_clutter_hides_nothing_and_touches_nothing() -> None:
    rng = np.random.default_rng(3)
    things = rooms.clutter(rng, rooms.Pictures(rng), 0.1, 0.4)
    assert len(things) > 5
    for thing in things:
        pose = np.array(thing["pose"])
        half = (
            np.array(thing["size"]) / 2
            if thing["shape"] == "box"
            else np.array([thing["size"][0]] * 2 + [thing["size"][1] / 2])
        )
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
        points = corners @ pose[:3, :3].T + pose[:3, 3]
        away = np.linalg.norm(points[:, :2], axis=1).min()
        assert points[:, 2].min() > -0.02 and away > 0.09
        assert points[:, 2].max() <= 0.3 * max(away, 0.1)


def test_a_hand_held_camera_keeps_the_object_in_view_and_moves_a_little_while_it_exposes() -> None:
    rng = np.random.default_rng(5)
    lens = cameras.draw_lens(rng, upright=True)
    ball = 0.08 * np.random.default_rng(0).standard_normal((200, 3))
    ball *= np.minimum(1, 0.1 / np.linalg.norm(ball, axis=1))[:, None]
    away = cameras.fitting_distance(ball, np.zeros(3), lens)
    path = cameras.hand_held(rng, 16.0, away, np.zeros(3))
    moved = []
    for t in np.arange(0, 16, 0.4):
        pose = np.linalg.inv(path(t))
        pixels = project(ball, pose[:3], lens.K, np.zeros(2))
        assert np.mean(((pixels > 0) & (pixels < [lens.width, lens.height])).all(1)) > 0.9
        later = project(ball, np.linalg.inv(path(t + 1 / 60))[:3], lens.K, np.zeros(2))
        moved.append(np.linalg.norm(later - pixels, axis=1).mean())
    assert 0.1 < np.median(moved) < 6.0


def test_the_lens_moves_a_point_as_the_truth_says() -> None:
    K, k1, size = np.array([[700.0, 0, 160], [0, 700, 120], [0, 0, 1]]), -0.3, (320, 240)
    wide = np.zeros((size[1] + 2 * MARGIN, size[0] + 2 * MARGIN, 3), np.float32)
    point = np.array([0.18, 0.12, 1.0])
    u, v = project(point[None], np.eye(3, 4), K, np.zeros(2))[0] + MARGIN
    y, x = np.mgrid[: wide.shape[0], : wide.shape[1]] + 0.5
    wide[:] = np.exp(-((x - u) ** 2 + (y - v) ** 2) / 8)[..., None]
    seen = distort(wide, K, k1, size)[..., 0].clip(0)
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    found = np.array([(seen * x).sum(), (seen * y).sum()]) / seen.sum()
    true = project(point[None], np.eye(3, 4), K, np.array([k1, 0]))[0]
    assert np.linalg.norm(true - (u - MARGIN, v - MARGIN)) > 1.5
    assert np.allclose(found, true, atol=0.01)


def test_a_prepared_scene_has_its_truth_and_nothing_of_it_among_the_images(tmp_path: Path) -> None:
    scene = by_name("10_dev_part")
    prepare(scene, tmp_path / "no-scans", tmp_path / "scene")
    document = json.loads((tmp_path / "scene" / "work" / "scene.json").read_text())
    assert len(document["frames"]) == scene.count
    (tmp_path / "scene" / "work" / "truth.npz").rename(tmp_path / "scene" / "truth.npz")
    truth = read_scene_truth(tmp_path / "scene")
    assert list(np.bincount(truth.placement)) == [28, 28]
    # the truth's poses are those that are rendered
    for i in (0, 40):
        frame = document["frames"][i]
        body = np.array(frame["body"][1]) @ [*np.load(tmp_path / "scene" / "truth.npz")["com_cad"], 1]
        assert np.allclose((np.linalg.inv(np.array(frame["camera"][1])) @ body)[:3], truth.poses[i, :, 3])
    for thing in [document["body"], *(t["surface"] for t in document["things"])]:
        picture = cv2.imread(str(tmp_path / "scene" / "work" / "pictures" / f"{thing['picture']}.png"))
        assert picture is not None and picture.std() > 0
