"""Two placements of one body laid onto each other."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from synthetic_dense import cameras, observe

from massprops.dynamics.quaternion import rotation_matrix
from massprops.mass.integrals import hull_corners
from massprops.surface import registration
from massprops.surface.answers import Answer, PlacementPair
from massprops.surface.cloud import Cloud
from massprops.surface.coherence import Extent, Witnesses
from massprops.surface.laid_again import drawn_again, next_answer, outlines_exclude, settled
from massprops.surface.placed import Placed, placed
from massprops.surface.registration import _chosen, _same_body, register
from massprops.surface.stood_on import resting, same_side
from massprops.surface.tangents import touching_shifts


def seen(mesh: trimesh.Trimesh, painted: bool, seed: int) -> Placed:
    """What cameras above a body see of it; its colour depends on the place on the body."""
    rng = np.random.default_rng(seed)
    a = np.arange(12) * 0.95
    up = np.column_stack([np.cos(a), np.sin(a), rng.uniform(0.3, 1.5, 12)])
    views = cameras(up, 8.0, 300.0, (160, 120))
    cloud, masks = observe(mesh, views, 0.004, seed)
    local = (cloud.xyz - mesh.metadata["t"]) @ mesh.metadata["R"]
    waves = np.array([[7.0, 3, 2], [-4, 6, 5], [2, -5, 8]])
    colour = 128 + 80 * np.sin(local @ waves.T + [0.3, 1.1, 2.0]) if painted else 0 * cloud.xyz
    support = np.array([0.0, 0, 1, -mesh.vertices[:, 2].min()])
    return placed(
        cloud, colour, views, masks, mesh.sample(8000, seed=seed), np.asarray(mesh.center_mass), support, seed
    )


def turned(mesh: trimesh.Trimesh, q: np.ndarray, t: np.ndarray) -> trimesh.Trimesh:
    out = mesh.copy()
    R = rotation_matrix(q / np.linalg.norm(q))
    out.vertices = mesh.vertices @ R.T + t
    out.metadata["R"], out.metadata["t"] = R, t
    return out


def wedge() -> trimesh.Trimesh:
    """A body without symmetry."""
    base = trimesh.creation.box((1.6, 1.0, 0.5))
    knob = trimesh.creation.icosphere(3, 0.35)
    knob.apply_translation([0.5, 0.2, 0.35])
    return trimesh.convex.convex_hull(np.concatenate([base.vertices, knob.vertices]))


def error_deg(R: np.ndarray, first: trimesh.Trimesh, second: trimesh.Trimesh) -> float:
    wanted = first.metadata["R"] @ second.metadata["R"].T
    return float(np.degrees(np.arccos(np.clip((np.trace(R.T @ wanted) - 1) / 2, -1, 1))))


def test_a_body_turned_over_is_found_by_its_shape() -> None:
    first = turned(wedge(), np.array([1.0, 0, 0, 0]), np.zeros(3))
    second = turned(wedge(), np.array([0.1, 0.9, 0.3, 0.2]), np.array([0.05, -0.1, 0.02]))
    sides = seen(first, True, 0), seen(second, True, 1)
    found = register(*sides)
    assert found.clear and error_deg(found.R, first, second) < 1.5
    middle = sides[1].middle
    over = found.R @ np.diag([1.0, -1.0, -1.0])
    assert outlines_exclude(*sides, found, over, found.t + (found.R - over) @ middle)
    assert not outlines_exclude(*sides, replace(found, rival_px=0.0, colour=0.0), over, found.t)
    assert not outlines_exclude(*sides, found, found.R, found.t), "it is the same answer"
    here = np.asarray(second.center_mass) @ found.R.T + found.t
    assert np.linalg.norm(here - first.center_mass) < 0.03


def test_planes_that_touch_the_body_tell_where_a_turn_lies() -> None:
    """First shapes lack a side each, and their middles tell nothing: of a photographed stamp these lie apart by most of its size."""
    first = turned(wedge(), np.array([1.0, 0, 0, 0]), np.zeros(3))
    second = turned(wedge(), np.array([0.1, 0.9, 0.3, 0.2]), np.array([0.05, -0.1, 0.02]))
    one, other = (seen(body, False, k) for k, body in enumerate((first, second)))
    R = first.metadata["R"] @ second.metadata["R"].T
    t = first.metadata["t"] - R @ second.metadata["t"]
    assert np.linalg.norm(touching_shifts(R[None], other.tangents, one.extent.corners())[0] - t) < 0.1
    both = PlacementPair(one, replace(other, middle=other.middle + [0.5, -0.3, 0.4]), np.random.default_rng(0))
    turns = np.stack([R, R @ rotation_matrix(np.array([0.0, 1.0, 0.0, 0.0]))])
    found, own = both.shifts(turns, both.outlines)
    assert np.linalg.norm(found[0] - t) < 0.1
    scores = both.outlines.scores(turns, found)
    assert np.array_equal(own, scores)
    assert scores[0] < 0.4 * scores[1]


@pytest.mark.parametrize("seed", range(3))
def test_planes_tell_the_shift_between_two_hulls(seed: int) -> None:
    """Also where a hull reaches beyond its body on one side."""
    rng = np.random.default_rng(seed)
    body = rng.standard_normal((40, 3)) * [1.0, 0.6, 0.3]
    R, t = Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3)
    normal = rng.standard_normal((60, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    moving = (body - t) @ R
    planes = np.column_stack([normal, -(moving @ normal.T).max(axis=0)])
    turns = np.stack([R, np.eye(3)])
    assert np.allclose(touching_shifts(turns, planes, body[hull_corners(body)])[0], t, atol=1e-6)
    beyond = np.concatenate([body, body[:3] + [0.0, 0.0, -1.0]])
    assert np.linalg.norm(touching_shifts(turns, planes, beyond[hull_corners(beyond)])[0] - t) < 0.1
    assert not touching_shifts(turns, planes[:3], body[hull_corners(body)]).any(), (
        "three planes tell nothing of an error"
    )
    assert len(hull_corners(body[:3])) == 3


def test_outlines_settle_a_body_that_lies_a_little_off() -> None:
    first = turned(wedge(), np.array([1.0, 0, 0, 0]), np.zeros(3))
    second = turned(wedge(), np.array([0.1, 0.9, 0.3, 0.2]), np.array([0.05, -0.1, 0.02]))
    R = first.metadata["R"] @ second.metadata["R"].T
    t = first.metadata["t"] - R @ second.metadata["t"]
    off = Rotation.from_rotvec([0.1, -0.15, 0.1]).as_matrix() @ R
    R, t = settled(seen(first, False, 0), seen(second, False, 1), off, t + 0.1)
    assert error_deg(R, first, second) < 3, "12 degrees before; a pixel is a degree and a half"
    assert np.linalg.norm(second.center_mass @ R.T + t - first.center_mass) < 0.03


def test_silhouettes_drawn_again_judge_an_answer_and_the_next_one() -> None:
    """As of a plain rock whose first silhouettes lacked what lay in shade."""
    first = turned(wedge(), np.array([1.0, 0, 0, 0]), np.zeros(3))
    second = turned(wedge(), np.array([0.1, 0.9, 0.3, 0.2]), np.array([0.05, -0.1, 0.02]))
    sides = seen(first, False, 0), seen(second, False, 1)
    R = first.metadata["R"] @ second.metadata["R"].T
    t = first.metadata["t"] - R @ second.metadata["t"]
    over = R @ np.diag([1.0, -1.0, -1.0])
    shift = t + (R - over) @ sides[1].middle
    before = replace(register(*sides), R=R, t=t, outside_px=2.2, candidates=((R, t), (R, t + 0.1), (over, shift)))
    after = next_answer(before)
    assert after is not None and np.array_equal(after[0], over)
    assert next_answer(replace(before, candidates=((R, t),))) is None
    found = drawn_again(before, [(*sides, R, t), (*sides, *after)])
    assert not before.fits and found.fits and found.rival_px > 2 * found.outside_px
    assert error_deg(found.R, first, second) < 3 and found.turned is None
    assert drawn_again(before, [(*sides, R, t)]).rival_px == np.inf


def test_paint_does_not_say_how_exactly_a_body_lies() -> None:
    """Of answers near to each other the one that outlines bear is taken, though the paint of a few points is more alike elsewhere."""
    about = [Rotation.from_euler("z", angle, degrees=True).as_matrix() for angle in (0, 9, 180, 90)]
    values = ((0.8, 0.26), (3.8, 0.53), (1.1, 0.1), (3.0, 0.02))
    answers = [Answer(R, np.zeros(3), *v) for R, v in zip(about, values, strict=True)]
    assert _chosen(sorted(answers, key=lambda a: a.outside)) is answers[0]


@pytest.mark.parametrize("painted", [True, False])
def test_a_symmetric_body_is_joined_by_colour_or_by_what_all_answers_share(painted: bool) -> None:
    box = trimesh.creation.box((1.6, 1.0, 0.6))
    first = turned(box, np.array([1.0, 0, 0, 0]), np.zeros(3))
    second = turned(box, np.array([0.0, 1.0, 0.02, 0.01]), np.zeros(3))
    sides = seen(first, painted, 2), seen(second, painted, 3)
    found = register(*sides)
    assert found.clear and found.symmetric
    # whichever of the turns that make the same body fits best, one of those given has another side up
    ways = [found.R] if found.turned is None else [found.R, found.turned.R]
    assert [same_side(*sides, R) for R in ways] in ([False], [True, False])
    if painted:
        assert error_deg(found.R, first, second) < 2
    else:
        laid = second.copy()
        laid.vertices = second.vertices @ found.R.T + found.t
        apart = trimesh.proximity.closest_point(first, laid.sample(500, seed=0))[1]
        assert np.quantile(apart, 0.9) < 0.05


def test_answers_that_make_other_bodies_are_rivals() -> None:
    """A knob at one end above and one below: whether at the same end cannot be told, as no image shows both."""
    shift = trimesh.transformations.translation_matrix
    knobs = [trimesh.creation.box((0.3, 0.3, 0.2), shift([x, 0, z])) for x, z in ((0.25, 0.3), (-0.25, -0.3))]
    body = trimesh.boolean.union([trimesh.creation.box((1.6, 1.0, 0.6)), *knobs], engine="manifold")
    first = turned(body, np.array([1.0, 0, 0, 0]), np.zeros(3))
    second = turned(body, np.array([0.0, 1.0, 0.0, 0.0]), np.zeros(3))
    found = register(seen(first, False, 2), seen(second, False, 3))
    assert not found.clear


def test_turns_of_a_body_of_revolution_are_one_answer() -> None:
    """Each is seen to be the body of the next; only what fits as well leads on."""
    about = [Rotation.from_euler("z", angle, degrees=True).as_matrix() for angle in (0, 40, 80, 120, 170)]
    answers = [Answer(R, np.zeros(3), outside) for R, outside in zip(about, (0.30, 0.31, 0.32, 0.9, 0.31), strict=True)]
    both: Any = SimpleNamespace(one_body=lambda a, b: a.away(b) < 60.0)
    found = _same_body(both, answers[0], answers)
    assert [a in found for a in answers] == [False, True, True, True, False], (
        "the fourth fits worse, the last is beyond it"
    )


def placed_nowhere(cloud: Cloud) -> Placed:
    """Points without silhouettes or support."""
    nothing = Witnesses(np.zeros((0, 3)), np.zeros(1, int)), np.zeros(3), np.zeros((0, 3))
    return Placed(
        cloud, np.zeros((0, 3)), Extent(np.zeros((2, 2, 2), np.float32), np.zeros(3), 1.0), *nothing, 0.01, 0.0
    )


@pytest.mark.parametrize("lean", [0.0, 0.02])
def test_each_placement_rests_on_what_the_other_lay_on(lean: float) -> None:
    """A slab whose top was measured, turned over: it is moved along the supports alone, also where these lean a little."""
    rng = np.random.default_rng(0)
    top = np.column_stack([rng.uniform(-1, 1, (3000, 2)), np.ones(3000)])
    cloud = Cloud(top, np.tile([0.0, 0, 1], (3000, 1)), np.ones(3000), np.zeros(3001, int), np.zeros(0, int))
    supports = np.array([0.0, 0, 1, 0]), np.array([np.sin(lean), 0, np.cos(lean), 0])
    first, second = (replace(placed_nowhere(cloud), support=s) for s in supports)
    R, t = np.diag([1.0, -1, -1]), np.array([0.3, -0.2, 0.8])
    rested = resting(first, second, R, t)
    assert np.allclose(rested, [0.3, -0.2, 1.0], atol=0.03)
    assert np.array_equal(resting(placed_nowhere(cloud), placed_nowhere(cloud), R, t), t)


@pytest.mark.parametrize(("outside", "joined"), [(3.6, True), (1.9, False)])
def test_an_answer_that_silhouettes_tell_is_no_rival_of_like_paint(
    monkeypatch: pytest.MonkeyPatch, outside: float, joined: bool
) -> None:
    """As of the two faces of a photographed stamp: the right answer, the one that fits next, and one of as much paint."""
    monkeypatch.setattr(registration, "same_side", lambda *rest: False)
    side = SimpleNamespace(rim_error=0.4)
    both: Any = SimpleNamespace(
        first=side, second=side, covariance=lambda a: np.eye(6), one_body=lambda one, other: False
    )
    turns = [Rotation.from_rotvec([0.0, 0.0, a]).as_matrix() for a in np.linspace(0, 5, 9)]
    measured = [(1.05, 0.298), (1.36, 0.0), (outside, 0.299), *[(5.0, 0.0)] * 6]
    answers = [Answer(R, np.zeros(3), px, paint) for R, (px, paint) in zip(turns, measured, strict=True)]
    found = registration._registration(both, sorted(answers, key=lambda a: a.outside))
    assert found.clear is joined
    assert not joined or np.allclose(found.R, turns[0])
