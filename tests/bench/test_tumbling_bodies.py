"""Tumbling bodies as they are drawn and prepared; nothing is rendered here."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from tabletop.silhouettes import project
from tabletop.truth import read_scene_truth
from tumbling_footage.bodies import KINDS, make_body
from tumbling_footage.footage import Footage, images_of, prepare
from tumbling_footage.poor import POOR


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_one_closed_body_and_another_for_another_number(kind: str) -> None:
    first, again, other = (make_body(kind, Footage(kind=kind, number=n).generator()) for n in (0, 0, 1))
    assert first.mesh.is_volume and first.mesh.body_count == 1
    assert first.mesh.volume == again.mesh.volume
    assert abs(first.mesh.volume / other.mesh.volume - 1) > 1e-3
    parts = sum(m.volume for m, _ in first.solids)
    assert 0.6 * parts < first.mesh.volume <= parts * (1 + 1e-9)


def test_a_cubesat_shows_the_same_cells_on_four_sides() -> None:
    body = make_body("cubesat", Footage(kind="cubesat", number=0).generator())
    bus, look = body.solids[0]
    assert look["picture"] == "cells"
    # whole cells from edge to edge, with a border on the middle, so that every side is alike
    counts = bus.extents[:2] / look["span"]
    assert np.allclose(counts, np.round(counts)) and np.all(np.round(counts) % 2 == 0)


def test_the_truth_is_the_motion_that_is_rendered(tmp_path: Path) -> None:
    footage = Footage(kind="bus", number=2)
    prepare(footage, tmp_path)
    document = json.loads((tmp_path / "work" / "scene.json").read_text())
    (tmp_path / "work" / "truth.npz").rename(tmp_path / "truth.npz")
    truth = read_scene_truth(tmp_path)
    z = np.load(tmp_path / "truth.npz")
    assert len(document["frames"]) == len(truth.poses) == 88
    for i in (0, 50):
        pose = np.array(document["frames"][i]["body"][1])
        assert np.allclose((pose @ [*z["com_cad"], 1])[:3], truth.poses[i, :, 3])
        assert np.allclose(pose[:3, :3], truth.poses[i, :, :3])
    # free motion: the angular momentum stands still in space
    momentum = np.einsum("nij,jk,nk->ni", truth.poses[:, :, :3], z["I"], z["w"])
    assert np.allclose(momentum, momentum[0], rtol=0, atol=1e-5 * np.linalg.norm(momentum[0]))
    for pose in truth.poses[::10]:
        pixels = project(truth.mesh.vertices, pose, truth.K, truth.distortion)
        assert np.all((pixels > 0) & (pixels < truth.size[0]))


@pytest.mark.parametrize("poor", POOR)
def test_one_thing_is_wrong_with_footage_at_a_time(poor: str, tmp_path: Path) -> None:
    footage = Footage(kind="bus", number=2, poor=poor, frames=8)
    prepare(footage, tmp_path)
    document = json.loads((tmp_path / "work" / "scene.json").read_text())
    assert (document["rolling"], document["coverage"]) == (poor == "rolling", poor == "sky")
    away = np.array([np.array(f["body"])[1] @ [*_centre(tmp_path), 1] for f in document["frames"]])[:, 2]
    assert np.allclose(away / away[0], np.linspace(1, 3 if poor == "receding" else 1, footage.count))
    through = np.array(document["frames"][3]["body"])[[0, 2], :3, :3]
    turned = np.degrees(np.arccos((np.trace(through[0].T @ through[1]) - 1) / 2))
    # blurred and rolling footage turn while a frame is taken, by what is stated for a frame's mean turn
    assert turned == pytest.approx({"blurred": 2.0, "rolling": 3.0}.get(poor, 0.05), rel=0.3)


def _centre(folder: Path) -> np.ndarray:
    with np.load(folder / "work" / "truth.npz") as z:
        return z["com_cad"]


def test_stars_and_limb_are_behind_the_body(tmp_path: Path) -> None:
    frames = tmp_path / "work" / "frames"
    frames.mkdir(parents=True)
    footage = Footage(kind="bus", number=2, poor="sky", frames=1)
    width, height = footage.how.size
    picture = np.zeros((height, width, 4), np.uint16)
    picture[200:300, 300:400] = 20000
    picture[480:, 300:400] = 20000
    picture[200:300, 300:400, 3] = picture[480:, 300:400, 3] = 65535
    cv2.imwrite(str(frames / "000000.png"), picture)
    (seen,) = images_of(footage, tmp_path / "work", 1)
    body, limb, sky = seen[480:, 310:390], seen[530:, :290], seen[:150]
    assert body.std() < 5 and np.median(sky) < 10
    assert np.median(limb) > 60 and (sky.max(2) > 60).sum() > 20
