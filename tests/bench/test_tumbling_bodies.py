"""Tumbling bodies as they are drawn and prepared; nothing is rendered here."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tabletop.silhouettes import project
from tabletop.truth import read_scene_truth
from tumbling_footage.bodies import KINDS, make_body
from tumbling_footage.footage import Footage, prepare


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
