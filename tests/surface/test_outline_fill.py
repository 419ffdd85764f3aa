"""Unmeasured sides brought out to where the silhouettes end."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from surface.test_outline_gaps import body, filmed

from massprops.run.stages.surface import Evidence, _surface
from massprops.surface.outline_fill import filling_outlines
from massprops.surface.reconstruct import Fill
from massprops.surface.refine import vertex_normals

PIXEL = 5.0 / 400.0


def test_a_side_that_bulges_fills_its_silhouettes() -> None:
    vertices, faces = body()
    views, masks = filmed(vertices, faces, 36)
    free = vertices[:, 0] > 0.2
    sunk = vertices - 4 * PIXEL * free[:, None] * vertex_normals(vertices, faces)
    found = filling_outlines(sunk, faces, free, views, masks, PIXEL)
    off = np.einsum("vi,vi->v", found - vertices, vertex_normals(vertices, faces))[free] / PIXEL
    # a pixel is the margin of a silhouette
    assert abs(np.median(off)) < 1.5 and np.mean(off > 0.5) < 0.05
    assert np.array_equal(found[~free], sunk[~free])


def test_a_recess_that_no_outline_shows_stays() -> None:
    vertices, faces = body()
    free = np.linalg.norm(vertices - [1.0, 0, 0], axis=1) < 0.3
    hollow = vertices.copy()
    hollow[free, 0] -= 0.3 * (1 - (np.linalg.norm(vertices[free] - [1.0, 0, 0], axis=1) / 0.3) ** 2)
    views, masks = filmed(hollow, faces, 36)
    found = filling_outlines(hollow, faces, free, views, masks, PIXEL)
    before, after = (trimesh.Trimesh(v, faces).volume for v in (hollow, found))
    assert after == pytest.approx(before, rel=0.002)


def test_without_silhouettes_nothing_moves() -> None:
    vertices, faces = body()
    views, masks = filmed(vertices, faces, 6)
    free = np.ones(len(vertices), bool)
    found = filling_outlines(0.9 * vertices, faces, free, views, [np.full_like(m, 128) for m in masks], PIXEL)
    assert np.array_equal(found, 0.9 * vertices)


@pytest.mark.parametrize(
    ("support", "moving", "share"), [(None, False, 1.0), ([0, 0, 1.0, 0], False, 1 / 3), (None, True, 1 / 3)]
)
def test_only_what_neither_a_plane_nor_the_light_bounds_is_a_film(
    monkeypatch: pytest.MonkeyPatch, support: list[float] | None, moving: bool, share: float
) -> None:
    asked: list[Fill] = []
    monkeypatch.setattr("massprops.surface.reconstruct.reconstruct_surface", lambda *_, fill, **__: asked.append(fill))
    job: Any = SimpleNamespace(work=lambda _: Path("nowhere"), seed=0, progress=None)
    nothing: Any = None
    nowhere = {"views": nothing, "cloud": nothing, "table": nothing, "place": {"support_plane": support}}
    _surface(job, Evidence(**nowhere, masks=[], grey=[], sun=None, moving=moving, balance=None))
    assert asked[0].membrane == pytest.approx(share)
