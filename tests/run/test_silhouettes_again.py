"""Silhouettes drawn from the closed surface, and which stage's silhouettes count."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from massprops.capture.from_shape import overlap
from massprops.geometry.rasterise import silhouette
from massprops.run import silhouettes_again
from massprops.run.drawn_silhouettes import Visible
from massprops.sfm.footage import silhouette_file
from massprops.views import Views

SIZE = (320, 240)


def views(n: int) -> Views:
    a = np.arange(n)
    R = np.stack([np.array([[np.cos(k), np.sin(k), 0], [0, 0, -1], [-np.sin(k), np.cos(k), 0]]) for k in a])
    K = np.tile(np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]]), (n, 1, 1))
    names = tuple(f"cam0/{i}.png" for i in range(n))
    return Views(names, a, np.tile(SIZE, (n, 1)), K, np.zeros((n, 4)), R, np.tile([0, 0, 6.0], (n, 1)))


def test_the_last_stage_that_drew_a_silhouette_counts(tmp_path: Path) -> None:
    for stage in ("silhouettes", "surface"):
        (tmp_path / stage / "masks" / "cam0").mkdir(parents=True)
        (tmp_path / stage / "masks" / "cam0" / "0.png.png").touch()
    found = [silhouette_file(tmp_path, "cam0/0.png", last) for last in ("silhouettes", "join", "surface")]
    assert [f.parents[2].name for f in found] == ["silhouettes", "silhouettes", "surface"]
    assert silhouette_file(tmp_path, "cam0/1.png").parents[2].name == "silhouettes", "none is there"


@pytest.mark.parametrize("lost", [False, True])
def test_a_shadow_is_left_out_and_a_part_that_was_measured_is_not(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, lost: bool
) -> None:
    """Silhouettes took in a shadow at the foot; a surface that has lost a half of the object takes no silhouette's place."""
    here, cube = views(3), trimesh.creation.box((2, 2, 2)).subdivide_to_size(0.2)
    points, faces = np.asarray(cube.vertices), np.asarray(cube.faces)
    seen = [silhouette(points, faces, here.K[i], here.R[i], here.t[i], SIZE) for i in range(3)]
    before = []
    for solid in seen:
        wider = np.roll(solid, 12, axis=0) | solid
        before.append(np.where(wider, 255, 0).astype(np.uint8))
    image = [np.where(s[..., None], np.uint8([40, 40, 200]), np.uint8([120, 120, 120])) for s in seen]
    none = np.zeros((0, 3))
    shown = Visible(points, faces, None, points, np.tile([40, 40, 200], (len(points), 1)), none, none)
    monkeypatch.setattr(silhouettes_again, "scene_by_view", lambda job, views: ((i, shown) for i in range(3)))
    monkeypatch.setattr(silhouettes_again, "undistorted_frame", lambda job, views, i: image[i])
    job: Any = SimpleNamespace(out=tmp_path, progress=lambda *_: None)
    mesh = trimesh.creation.box(bounds=[[-1, -1, -1], [1, 1, -0.2 if lost else 1]])
    silhouettes_again.silhouettes_again(job, here, (mesh.vertices, mesh.faces), before, points)
    drawn = {p.name: cv2.imread(str(p), 0) for p in (tmp_path / "masks").rglob("*.png")}
    assert len(drawn) == (0 if lost else 3)
    for name, mask in drawn.items():
        i = int(name[0])
        assert overlap(mask == 255, seen[i]) > 0.96 > overlap(before[i] == 255, seen[i])
