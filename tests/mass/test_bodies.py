"""A surface of several parts: cavities, bodies inside out, overlaps; and meshes that are no body for other reasons."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from massprops.errors import InputError
from massprops.mass.properties import mass_properties
from massprops.mass.repair import repair


def box(size: float = 1.0, at: tuple[float, float, float] = (0, 0, 0), inward: bool = False) -> trimesh.Trimesh:
    made = trimesh.creation.box((size,) * 3)
    made.apply_translation(at)
    if inward:
        made.invert()
    return made


CASES = {
    "two apart": ([box(), box(at=(3, 0, 0))], 2.0, ""),
    "hollow": ([box(2.0), box(inward=True)], 7.0, ""),
    "hollow, all inside out": ([box(2.0, inward=True), box()], 7.0, "was inside out"),
    "two apart, one inside out": ([box(), box(at=(3, 0, 0), inward=True)], 2.0, "1 of 2 parts were inside out"),
    "two apart, the larger inside out": ([box(2.0, at=(5, 0, 0), inward=True), box()], 9.0, "inside out"),
    "overlapping": ([box(), box(at=(0.5, 0.1, 0.2))], 2 - 0.5 * 0.9 * 0.8, "overlap: joined"),
    "one in another, both outward": ([box(2.0), box()], 8.0, "a cavity must be wound inward"),
    "body in a cavity": ([box(3.0), box(2.0, inward=True), box(1.0)], 27 - 8 + 1, ""),
}


@pytest.mark.parametrize("case", CASES)
def test_parts_count_once_with_their_sign(case: str) -> None:
    parts, volume, says = CASES[case]
    mesh = trimesh.util.concatenate(parts)
    fixed, notes = repair(mesh)
    assert mass_properties(fixed, 1.0).volume == pytest.approx(volume, rel=1e-9)
    assert (says in " ".join(notes)) if says else notes == ()


def test_a_hollow_body_inside_out_has_the_inertia_of_the_one_outside_in() -> None:
    good = trimesh.util.concatenate([box(2.0), box(1.0, at=(0.3, 0.1, 0), inward=True)])
    bad = good.copy()
    bad.invert()
    a, b = mass_properties(repair(good)[0], 2.0), mass_properties(repair(bad)[0], 2.0)
    assert np.allclose(a.inertia, b.inertia, rtol=1e-12) and np.allclose(a.center_of_mass, b.center_of_mass, atol=1e-12)


def moved(scale: float = 1.0, shift: float = 0.0) -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(2)
    corners = np.asarray(ball.triangles, float).reshape(-1, 3) * scale + shift
    return trimesh.Trimesh(corners.astype(np.float32), np.arange(len(corners)).reshape(-1, 3), process=True)


@pytest.mark.parametrize(
    ("mesh", "says"),
    [
        (trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False), "is flat"),
        (moved(1e-9), "less than 1e-06 long: corners closer than 1e-8"),
        (moved(1.0, 1e8), "from its origin"),
        (trimesh.Trimesh(1e15 * box().vertices, box().faces, process=False), "coordinates up to 5e+14"),
        (trimesh.util.concatenate([box(), box(inward=True)]), "encloses no volume|inside out"),
    ],
)
def test_what_is_no_body_gets_the_right_word(mesh: trimesh.Trimesh, says: str) -> None:
    with pytest.raises(InputError, match=says.replace("+", r"\+")) as caught:
        repair(mesh)
    assert "watertight" not in str(caught.value)
