"""Diagnosis of bodies that textbook formulas move, in folders written by hand."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from diagnose.half_turns import off
from diagnose.independent import World, drawn, expected, sized, true_inertia, write


def diagnosed(world: World, place: Path, **files: bool) -> dict:
    """`diagnosis.json` of the command in a folder that holds the sequence alone."""
    from massprops_cli.main import run

    write(world, place / "seq", **files)
    assert run(["diagnose", str(place / "seq"), "-o", str(place / "out"), "-q"]) == 0
    return json.loads((place / "out" / "diagnosis.json").read_text())


def worst(document: dict, world: World, name: str) -> float:
    """Largest error of the effect's parameters in sigmas."""
    own = [e for e in document["effects"] if e["name"] == name]
    return max(abs(z) for _, z in off(own, {name: expected(world, name)}, true_inertia(world)))


@pytest.mark.parametrize(
    ("seed", "sensors", "name", "pixels"),
    [
        (2, "stereo", "viscous-damping", 6.0),
        (6, "stereo", "energy-dissipation", 5.0),
        (12, "stereo", "stereo-time-offset", 6.0),
    ],
)
def test_a_textbook_effect_is_named_with_its_size(
    tmp_path: Path, seed: int, sensors: str, name: str, pixels: float
) -> None:
    world = sized(drawn(seed, sensors), name, pixels)
    document = diagnosed(world, tmp_path)
    assert document["verdict"] == "named" and [e["name"] for e in document["effects"]] == [name]
    assert document["gap"]["held_out"]["after"] < 1.15
    assert worst(document, world, name) < 3.5


def test_no_knock_stands_for_a_path_that_does_not_fall(tmp_path: Path) -> None:
    world = sized(drawn(108, "range"), "focal-length-error", 5.8)
    assert not world.falls, "environment.yaml says where the planet is all the same"
    document = diagnosed(world, tmp_path)
    assert [e["name"] for e in document["effects"]] == ["focal-length-error"]
    assert any("straight" in w for w in document["warnings"])
    assert worst(document, world, "focal-length-error") < 3.5


def test_a_path_that_does_not_fall_is_no_effect(tmp_path: Path) -> None:
    # without a range sensor a baseline that is off only scales what is seen
    world = sized(drawn(409, "stereo"), "baseline-error", 4.5)
    assert not world.falls
    document = diagnosed(world, tmp_path, noise_stated=False)
    assert document["verdict"] == "none" and any("straight" in w for w in document["warnings"])


def test_nothing_is_found_where_nothing_is_and_the_noise_is_not_stated(tmp_path: Path) -> None:
    document = diagnosed(drawn(1, "stereo"), tmp_path, noise_stated=False, environment=False, body=False)
    assert document["verdict"] == "none" and any("sigma_px" in w for w in document["warnings"])


def test_the_generator_keeps_momentum_and_makes_the_size_asked_for() -> None:
    from diagnose.independent import _moved, motion

    for name in ("internal-rotor", "energy-dissipation", "inertia-change"):
        world = sized(drawn(3, "stereo"), name, 5.0)
        assert _moved(drawn(3, "stereo"), world) == pytest.approx(5.0, rel=0.05)
        m = motion(world)
        assert np.isfinite(m.w).all() and abs(np.linalg.norm(m.w[0] - world.w0)) < 1e-9
