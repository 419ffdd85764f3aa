"""What a placement that could not be joined says of the one that is used."""

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
from surface.synthetic_dense import boxes, cameras, observe

from massprops.run.job import Job, ReconstructOptions
from massprops.run.unjoined import Unjoined, on_support_hollows, underside_may_be_hollow, unjoined
from massprops.surface.cloud import Cloud

WALL, LONG, HIGH = 0.06, 1.0, 0.4
TRAY = boxes(
    ((LONG, LONG, WALL), (0, 0, WALL / 2)),
    *(((LONG, WALL, HIGH), (0, s * (LONG - WALL) / 2, WALL + HIGH / 2)) for s in (-1, 1)),
    *(((WALL, LONG - 2 * WALL, HIGH), (s * (LONG - WALL) / 2, 0, WALL + HIGH / 2)) for s in (-1, 1)),
)
BLOCK = trimesh.creation.box((LONG, LONG, HIGH + WALL), trimesh.transformations.translation_matrix([0, 0, 0.23]))


def run_folder(folder: Path, body: trimesh.Trimesh) -> Job:
    """A run of which only the stages are there that are read: one placement on the plane z = 0, seen from above."""
    turn = np.linspace(0, 2 * np.pi, 9, endpoint=False)
    rings = [np.column_stack([np.cos(turn), np.sin(turn), np.full(9, h)]) for h in (0.6, 1.8)]
    views = cameras(np.concatenate(rings), 3.0, 330.0, (200, 160))
    cloud, masks = observe(body, views, 0.002, 0)
    pick = np.sort(np.random.default_rng(0).permutation(len(cloud))[:15_000])
    own = folder / "work" / "shape" / "placement1"
    for made in (own, folder / "work" / "sfm", folder / "work" / "silhouettes" / "masks" / "cam0"):
        made.mkdir(parents=True)
    views.save(folder / "work" / "sfm" / "views.npz")
    cloud.take(pick).save(own / "object.npz")
    np.save(own / "colour.npy", np.zeros((len(pick), 3), np.uint8))
    Cloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(1, int), np.zeros(0, int)).save(own / "other.npz")
    placement = {"method": "measured", "images": list(views.names), "support_plane": [0.0, 0.0, 1.0, 0.0]}
    shape = {"placements": [{"method": "hides its support"}, placement]}
    (folder / "work" / "shape" / "shape.json").write_text(json.dumps(shape))
    left_out = {"left_out": [views.names[0]]}
    (folder / "work" / "silhouettes" / "silhouettes.json").write_text(json.dumps(left_out))
    for name, mask in zip(views.names, masks, strict=True):
        cv2.imwrite(str(folder / "work" / "silhouettes" / "masks" / f"{name}.png"), mask)
    return Job(run=folder, options=ReconstructOptions(), out=folder)


@pytest.mark.parametrize(("body", "hollow"), [(TRAY, True), (BLOCK, False)])
def test_a_placement_that_is_left_is_measured_and_its_hollow_seen(
    tmp_path: Path, body: trimesh.Trimesh, hollow: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("massprops.run.unjoined.POINTS", 6_000)
    job = run_folder(tmp_path, body)
    place = {"unjoined": [{"images": 5, "placement": 0}, {"images": 18, "placement": 1}]}
    (found,) = unjoined(replace(job, seed=1), place, 0.001)
    assert found.images == 17, "one was left out, and the other placement was not measured"
    assert found.vessel == hollow
    assert found.body[0] == pytest.approx(body.volume, rel=0.12)
    assert found.rows.shape == (1000, 10)
    assert unjoined(job, {"unjoined": []}, 0.001) == []


def test_an_underside_that_an_unmeasured_placement_shows_may_be_hollow() -> None:
    """As of a toy car on its back, of which an outline alone was known: standing, it was filled to the table."""
    block, tray = (Unjoined(np.ones(10), np.ones((1, 10)), vessel, 20) for vessel in (False, True))
    one = {"unjoined": [{"images": 20}]}
    assert underside_may_be_hollow(one, []) and underside_may_be_hollow(one, [tray])
    assert not underside_may_be_hollow(one, [block]) and not underside_may_be_hollow({"unjoined": []}, [])


def test_a_body_that_is_open_below_may_be_a_thin_shell() -> None:
    body = BLOCK.subdivide_to_size(0.1)
    seen = ~((body.face_normals[:, 2] < -0.5) & (body.triangles_center[:, 2] < 1e-6))
    made = {"vertices": body.vertices, "faces": body.faces, "observed": seen, "spacing": 0.02}
    surface: Any = SimpleNamespace(noise=0.005, **made)
    plane = np.array([0.0, 0.0, 1.0, 0.0])
    assert on_support_hollows(surface, plane).likely[0] == 0
    assert on_support_hollows(surface, plane, underside_hollow=True).likely[0] > 0.8 * body.volume
