"""What is said of a body whose sides look alike."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from massprops.mass.integrals import mesh_integrals
from massprops.mass.properties import mass_properties
from massprops.mass.symmetric import described, sentences, undecided


def found(apart: int, wing: float) -> dict:
    """`symmetric` of `surface.json` for a prism with a plate of some width on one side, in units half as long."""
    rows = {}
    for name, plates in (("common", 0), ("together", 4)):
        parts = [trimesh.creation.box((1, 1, 2))]
        for k in range(plates):
            plate = trimesh.creation.box(bounds=[[0.4, -0.05, -0.8], [0.5 + wing, 0.05, 0.8]])
            plate.apply_transform(trimesh.transformations.rotation_matrix(k * np.pi / 2, [0, 0, 1]))
            parts.append(plate)
        whole = trimesh.boolean.union(parts, engine="manifold")
        whole.apply_scale(2.0)
        rows[name] = mesh_integrals(whole.vertices, whole.faces).tolist()
    shares = {"shape_share": 0.8, "paint_share": 0.9, "paint_by_chance": 0.1}
    names = [f"cam0/{i:06d}.png" for i in range(12)]
    return {"fold": 4, "axis": 0, "images_alike": names, "images_apart": names[:apart], **shares, **rows}


def body(wing: float):
    plate = trimesh.creation.box(bounds=[[0.4, -0.05, -0.8], [0.5 + wing, 0.05, 0.8]])
    return mass_properties(trimesh.boolean.union([trimesh.creation.box((1, 1, 2)), plate], engine="manifold"), 1000.0)


def test_the_candidates_are_in_the_units_of_the_body():
    whole = body(0.5)
    (one,) = described([found(3, 0.5)], whole, 0.5)
    assert one["about"] == "I1" and one["fold"] == 4
    assert one["candidates"]["common"]["volume"] == pytest.approx(2.0)
    assert one["candidates"]["together"]["volume"] == pytest.approx(2.0 + 4 * 0.5 * 0.1 * 1.6)
    (said,) = sentences([one], whole, 60)
    assert said.startswith(
        "symmetric: the body looks alike every 90 degrees about the axis of I1, so that 12 of 60 images would"
    )
    assert "for 3 of them nothing but their own matches" in said
    assert "between -4 and +12 %" in said


def test_confidence_falls_only_where_images_are_open_and_their_place_matters():
    whole = body(0.5)
    narrow = {"volume": [0.99 * whole.volume, 1.01 * whole.volume], "k1": [-9, 0], "k2": [-9, 0]}
    wide = {"volume": [0.5 * whole.volume, 1.5 * whole.volume], "k1": [-9, 0], "k2": [-9, 0]}
    open_one, placed = (described([found(apart, 0.5)], whole, 0.5) for apart in (3, 0))
    assert undecided(open_one, narrow) == [0]
    assert undecided(open_one, wide) == []
    assert undecided(placed, narrow) == []


def test_a_body_that_is_the_same_all_round_is_said_to_differ_in_motion_only():
    whole = body(0.0)
    (said,) = sentences(described([found(0, 0.0)], whole, 0.5), whole, 60)
    assert said.endswith("another placement would change no mass property, only the motion")
