"""Space behind filled-in sides that may be empty."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

from massprops.mass.integrals import mesh_integrals
from massprops.run.stages.surface import _behind_sides
from massprops.surface.behind_fill import behind_fill
from massprops.surface.hollow import hollowed
from massprops.surface.outline_gaps import Gaps

EDGE, NOISE = 0.15, 0.01
FILLED_CUP = [(0, 0), (1, 0), (1, 1.5), (0.9, 1.5), (0.9, 1.3), (0, 1.3)]
"""Radius and height of a cup's profile with a wall of 0.1, filled up to 0.2 below its rim."""


@pytest.fixture(scope="module")
def cup() -> trimesh.Trimesh:
    mesh = trimesh.creation.revolve(np.array(FILLED_CUP), sections=48).subdivide_to_size(EDGE)
    mesh.fix_normals()
    return mesh


def test_a_cup_filled_to_its_rim_may_be_as_thin_as_its_rim(cup: trimesh.Trimesh) -> None:
    lid = (cup.face_normals[:, 2] > 0.9) & (cup.triangles_center[:, 2] < 1.4)
    space = behind_fill(np.asarray(cup.vertices), cup.faces, ~lid, NOISE, EDGE / 16)
    body = mesh_integrals(cup.vertices, cup.faces)
    assert space[0] == pytest.approx(np.pi * 0.9**2 * 1.2, rel=0.1)
    rows = hollowed(np.tile(body, (400, 1)), body, space, 0)
    low, high = np.quantile(rows[:, 0], [0.05, 0.95])
    assert low < 1.1 * (body[0] - space[0]) and high > 0.95 * body[0]


def test_what_was_measured_all_round_hides_nothing(cup: trimesh.Trimesh) -> None:
    space = behind_fill(np.asarray(cup.vertices), cup.faces, np.ones(len(cup.faces), bool), NOISE, EDGE / 16)
    assert space[0] == 0


@pytest.mark.parametrize(("outlined", "space"), [(False, np.pi * 1.3), (True, 0.0)])
def test_a_standing_cup_filled_to_its_rim_may_be_empty_unless_outlines_show_its_top(
    cup: trimesh.Trimesh, outlined: bool, space: float
) -> None:
    vertices, faces = np.asarray(cup.vertices), cup.faces
    lid = (cup.face_normals[:, 2] > 0.9) & (cup.triangles_center[:, 2] < 1.4)
    foot = cup.face_normals[:, 2] < -0.9
    surface: Any = SimpleNamespace(
        vertices=vertices, faces=faces, observed=~lid & ~foot, inferred=foot, noise=NOISE, spacing=EDGE / 16
    )
    nothing = np.zeros(len(faces))
    gaps = Gaps(nothing, 0.0, nothing, np.where(lid & (not outlined), np.inf, 0.1))
    place = {"joined": [{}], "support_plane": [0.0, 0.0, 1.0, 0.0]}
    assert _behind_sides(surface, gaps, place)[0] == pytest.approx(space, rel=0.1)
