"""The table of mass properties on the terminal."""

from __future__ import annotations

import copy

import trimesh

import massprops
from massprops_cli.table import mass_table


def test_without_a_length_neither_mass_nor_moments_are_printed() -> None:
    solid = massprops.mass_properties(trimesh.creation.box((1, 2, 3)), density=2.0)
    metric = copy.deepcopy(solid.document)
    ratios = copy.deepcopy(metric)
    ratios["units"]["length"] = "model"
    names = [line.strip().split("  ")[0] for line in mass_table(metric).splitlines()]
    assert {"volume", "mass", "principal moment I1", "k1 = ln(I1/I2)", "density"} <= set(names)
    bare = [line.strip().split("  ")[0] for line in mass_table(ratios).splitlines()]
    assert {"volume", "k1 = ln(I1/I2)"} <= set(bare)
    assert not {"mass", "principal moment I1", "density"} & set(bare)
    assert "only ratios are meaningful" in mass_table(ratios)


def test_without_a_length_a_result_shows_its_ratios_alone() -> None:
    solid = massprops.mass_properties(trimesh.creation.box((1, 2, 3)), density=2.0)
    ratios = copy.deepcopy(solid.document)
    ratios["units"]["length"] = "model"
    shown = repr(type(solid)(solid.mesh, ratios))
    assert "kg" not in shown and "unit^3" in shown and "k1" in shown


def test_where_metres_come_from_is_said_in_words() -> None:
    box = trimesh.creation.box((1, 2, 3))
    assert "metres from the length that was given: taken as exact" in mass_table(
        massprops.mass_properties(box).document
    )
    wide = massprops.mass_properties(box, scale_sigma=0.02).document
    assert "1-sigma error 2 %" in mass_table(wide)
