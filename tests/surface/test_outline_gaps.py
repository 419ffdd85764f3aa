"""What outlines say of cameras that are wrong, and how it widens the intervals."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from surface.synthetic_dense import cameras, observe, sphere_directions

from massprops.geometry.rasterise import silhouette
from massprops.surface.length import model_length
from massprops.surface.outline_gaps import Gaps, outline_gaps
from massprops.surface.reconstruct import Surface, reconstruct_surface
from massprops.surface.silhouette import agreement, make_hull
from massprops.surface.spread import ErrorSources, replicates
from massprops.views import Views

pytestmark = pytest.mark.usefixtures("scatter_once")

SIZE = (320, 240)
REACH = 0.3


def body() -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.icosphere(4, 1.0)
    mesh.apply_scale([1.0, 0.8, 0.7])
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces)


def filmed(vertices: np.ndarray, faces: np.ndarray, n: int = 24) -> tuple[Views, list[np.ndarray]]:
    views = cameras(sphere_directions(n), 5.0, 400.0, SIZE)
    drawn = [silhouette(vertices, faces, views.K[i], views.R[i], views.t[i], SIZE) for i in range(n)]
    return views, [np.where(d, 255, 0).astype(np.uint8) for d in drawn]


def turned(views: Views, degrees: float, seed: int = 0) -> Views:
    rng = np.random.default_rng(seed)
    turns = [
        trimesh.transformations.rotation_matrix(np.radians(degrees) * rng.standard_normal(), rng.standard_normal(3))
        for _ in range(len(views))
    ]
    return replace(views, R=np.stack([r @ t[:3, :3] for r, t in zip(views.R, turns, strict=True)]))


def test_right_cameras_and_a_right_mesh_leave_nothing() -> None:
    vertices, faces = body()
    views, masks = filmed(vertices, faces)
    found = outline_gaps(vertices, faces, views, masks, REACH)
    assert np.array_equal(found.overlap, agreement(vertices, faces, views, masks)) and found.overlap.min() == 1.0
    assert not found.offset.any() and found.drift == 0.0


def test_a_mesh_that_is_too_small_is_so_where_it_is() -> None:
    vertices, faces = body()
    views, masks = filmed(vertices, faces)
    pixel = 5.0 / 400.0
    small = vertices * [1.0, 1.0 - 6 * pixel / 0.8, 1.0 - 6 * pixel / 0.7]
    found = outline_gaps(small, faces, views, masks, REACH)
    along = np.abs(small[faces].mean(axis=1)[:, 0])
    assert 3.5 < np.median(found.offset[along < 0.3]) < 6.5
    assert np.median(found.offset[along > 0.9]) < 2.0


def test_cameras_that_are_off_show_as_drift() -> None:
    vertices, faces = body()
    vertices = vertices * [1.0, 0.6, 0.5]
    views, masks = filmed(vertices, faces)
    drifts = [outline_gaps(vertices, faces, turned(views, d), masks, REACH).drift for d in (0.0, 8.0, 16.0)]
    assert drifts[0] == 0.0 and 0.5 < drifts[1] < drifts[2]


def test_a_boom_that_the_mesh_lacks_and_an_unlit_side_say_nothing() -> None:
    vertices, faces = body()
    boom = trimesh.creation.box((1.6, 0.03, 0.03), trimesh.transformations.translation_matrix([1.2, 0, 0]))
    whole = trimesh.util.concatenate([trimesh.Trimesh(vertices, faces), boom])
    views, masks = filmed(np.asarray(whole.vertices), np.asarray(whole.faces))
    for mask in masks:
        lit = mask[:, : SIZE[0] // 2]
        lit[lit == 255] = 0
        mask[:, SIZE[0] // 2 - 1 : SIZE[0] // 2][mask[:, SIZE[0] // 2 : SIZE[0] // 2 + 1] == 255] = 128
    found = outline_gaps(vertices, faces, views, masks, REACH)
    assert np.mean(found.offset != 0) < 0.1 and found.drift < 0.5


def test_nothing_is_said_without_silhouettes() -> None:
    vertices, faces = body()
    views, masks = filmed(vertices, faces, 6)
    found = outline_gaps(vertices, faces, views, [np.full_like(m, 128) for m in masks], REACH)
    assert not found.offset.any() and found.drift == 0.0


@pytest.fixture(scope="module")
def measured() -> tuple[Surface, int]:
    vertices, faces = body()
    views = cameras(sphere_directions(36), 5.0, 400.0, SIZE)
    cloud, masks = observe(trimesh.Trimesh(vertices, faces), views, 0.002, 1, most=75_000)
    return reconstruct_surface(views, masks, cloud, points=5_000), len(views)


def _interval(measured: tuple[Surface, int], gaps: Gaps | None, free: bool) -> np.ndarray:
    surface, views = measured
    volume = replicates(surface, views, ErrorSources(gaps=gaps, never_lit=free))[0][:, 0]
    return np.quantile(volume, [0.05, 0.5, 0.95])


@pytest.fixture(scope="module")
def own(measured: tuple[Surface, int]) -> np.ndarray:
    """The interval of a free body without gaps."""
    return _interval(measured, None, True)


def test_drift_widens_all(measured: tuple[Surface, int], own: np.ndarray) -> None:
    none = np.zeros(len(measured[0].faces))
    drifting = _interval(measured, Gaps(none, 3.0, none, none), True)
    assert drifting[2] - drifting[0] > 3 * (own[2] - own[0])


def test_an_offset_widens_to_its_own_side_for_a_free_body_and_both_ways_for_a_still_one(
    measured: tuple[Surface, int], own: np.ndarray
) -> None:
    surface, of_free = measured[0], own
    none = np.zeros(len(surface.faces))
    room = surface.hull.pixel * trimesh.Trimesh(surface.vertices, surface.faces, process=False).area
    for free, below in ((True, 0.0), (False, 4.0 * 1.645 * room)):
        own = of_free if free else _interval(measured, None, free)
        outlines_outside = _interval(measured, Gaps(none + 4.0, 0.0, none, none), free)
        assert outlines_outside[2] - own[2] > 4.0 * room
        assert abs(own[0] - outlines_outside[0] - below) < max(0.3 * (own[2] - own[0]), 0.2 * below)


def test_the_ends_of_a_still_object_are_less_known(measured: tuple[Surface, int]) -> None:
    surface, views = measured
    free, still = (np.std(replicates(surface, views, ErrorSources(never_lit=lit))[1]) for lit in (True, False))
    assert np.sqrt(max(still**2 - free**2, 0.0)) > 2.0 * surface.hull.pixel


def test_a_body_may_be_as_long_as_it_is_shown_at_times(measured: tuple[Surface, int]) -> None:
    surface, views = measured
    _, first, last = model_length(surface.vertices, surface.faces, surface.observed)
    way = surface.vertices[last] - surface.vertices[first]
    shown = surface.vertices[last] + 20.0 * surface.hull.pixel * way / np.linalg.norm(way)
    alone, (rows, lengths) = (
        replicates(surface, views, ErrorSources(never_lit=True, shown=places))
        for places in (np.zeros((0, 3)), shown[None])
    )
    np.testing.assert_array_equal(rows, alone[0])
    longer = np.quantile(lengths, 0.95) - np.quantile(alone[1], 0.95)
    assert 15.0 < longer / surface.hull.pixel < 20.0


def test_what_was_never_lit_is_expected_further_in() -> None:
    vertices, faces = body()
    directions = sphere_directions(48)
    views = cameras(directions[directions[:, 2] > 0.1], 5.0, 400.0, SIZE)
    cloud, masks = observe(trimesh.Trimesh(vertices, faces), views, 0.002, 1, most=75_000)
    surface = reconstruct_surface(views, masks, cloud, points=5_000)
    usual, dark = (
        np.median(replicates(surface, len(views), ErrorSources(never_lit=lit))[0][:, 0]) for lit in (False, True)
    )
    assert dark < 0.97 * usual


def test_a_hull_tells_how_far_a_body_may_go_on() -> None:
    vertices, faces = body()
    views, masks = filmed(vertices, faces, 36)
    hull = make_hull(views, masks, vertices)
    start, outward = np.array([[0.9, 0, 0], [0, 0, -0.7]]), np.array([[1.0, 0, 0], [0, 0, -1.0]])
    room = hull.room(start, outward, 1.0)
    assert room[0] == pytest.approx(0.1, abs=2.5 * hull.pixel) and room[1] < 2.5 * hull.pixel
    # where silhouettes say nothing they leave no known room
    blind = make_hull(views, [np.full_like(m, 128) for m in masks], vertices)
    assert not blind.room(start, outward, 1.0).any()


def test_a_tip_that_was_not_measured_makes_the_length_uncertain(measured: tuple[Surface, int]) -> None:
    surface, views = measured
    wide = replace(surface, hull=replace(surface.hull, need=9))
    zero = np.zeros(len(surface.faces))
    none = ErrorSources(gaps=Gaps(zero, 0.0, zero, zero), never_lit=True)
    certain, sure = (replicates(s, views, none)[1] for s in (surface, wide))
    away = np.linalg.norm(surface.vertices[surface.faces].mean(axis=1) - surface.vertices.mean(axis=0), axis=1)
    surface, wide = (replace(s, observed=s.observed & (away < 0.9 * away.max())) for s in (surface, wide))
    own, longer = (replicates(s, views, none)[1] for s in (surface, wide))
    assert longer.mean() > own.mean() and longer.std() > own.std()
    # where all about an end was measured nothing goes on, whatever room the silhouettes leave
    assert sure.mean() - certain.mean() < 0.2 * (longer.mean() - own.mean())
    assert sure.std() < 0.5 * longer.std()


def test_where_no_outline_speaks_the_mesh_is_as_far_off_as_elsewhere() -> None:
    """All cameras look down: outlines show the flanks alone."""
    vertices, faces = body()
    down = np.array([[0.1 * np.cos(a), 0.1 * np.sin(a), 1.0] for a in np.arange(12)])
    views = cameras(down / np.linalg.norm(down, axis=1, keepdims=True), 5.0, 400.0, SIZE)
    drawn = [silhouette(vertices, faces, views.K[i], views.R[i], views.t[i], SIZE) for i in range(len(views))]
    small = vertices * (1 - 4 * 5.0 / 400.0 / 0.9)
    found = outline_gaps(small, faces, views, [np.where(d, 255, 0).astype(np.uint8) for d in drawn], REACH)
    height = np.abs(small[faces].mean(axis=1)[:, 2])
    assert found.middle[height > 0.5] == pytest.approx(4.0, abs=1.0)
    assert found.middle[height < 0.1].mean() == pytest.approx(4.0, abs=1.0)


def test_what_an_outline_says_in_the_middle_has_no_margin() -> None:
    """Between the colours of a thing on a table and its surroundings an outline is where it is."""
    vertices, faces = body()
    pixel = 5.0 / 400.0
    views, masks = filmed(vertices * (1 + pixel / 0.8), faces)
    found = outline_gaps(vertices, faces, views, masks, REACH)
    assert not found.offset.any() and np.median(found.middle) == pytest.approx(1.0, abs=0.5)


def test_a_hole_that_no_silhouette_shows_is_no_gap() -> None:
    """Silhouettes that take in the space between slats are not 10 px farther out than the slats."""
    ring = trimesh.creation.torus(0.8, 0.07, major_sections=64, minor_sections=24)
    vertices, faces = np.asarray(ring.vertices, float), np.asarray(ring.faces)
    views, masks = filmed(vertices, faces)
    filled = []
    for mask in masks:
        outer, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        filled.append(cv2.drawContours(mask.copy(), outer, -1, 255, cv2.FILLED))
    found = outline_gaps(vertices, faces, views, filled, REACH)
    assert found.drift < 0.5 and np.abs(found.middle).max() <= 2.0


def test_a_place_is_near_an_outline_only_where_the_object_and_the_mesh_agree() -> None:
    vertices, faces = body()
    views, masks = filmed(vertices, faces, 36)
    right = outline_gaps(vertices, faces, views, masks, REACH).distance
    wrong = outline_gaps(0.9 * vertices, faces, views, masks, REACH).distance
    assert np.median(right) < 0.1 and np.isinf(wrong).mean() > 0.9


def test_a_fill_that_outlines_show_is_less_uncertain(measured: tuple[Surface, int]) -> None:
    surface, views = measured
    zero = np.zeros(len(surface.faces))
    half = replace(surface, observed=surface.vertices[surface.faces].mean(axis=1)[:, 2] > 0)
    shown, hidden = (
        replicates(half, views, ErrorSources(gaps=Gaps(zero, 0.0, zero, zero + d)))[0][:, 0].std()
        for d in (0.02, np.inf)
    )
    assert shown < 0.5 * hidden


def test_an_unlit_side_that_was_measured_is_no_sky() -> None:
    """A third of each silhouette is in shade: it counts against a mesh there only where nothing measured it."""
    vertices, faces = body()
    views, masks = filmed(vertices, faces)
    dark = [m.copy() for m in masks]
    for m in dark:
        rows, columns = np.nonzero(m)
        m[rows, columns] = np.where(columns < np.quantile(columns, 1 / 3), 0, 255)
    measured = np.ones(len(faces), bool)
    assert outline_gaps(vertices, faces, views, dark, REACH).overlap.max() < 0.75
    assert outline_gaps(vertices, faces, views, dark, REACH, measured).overlap.min() > 0.99
    assert outline_gaps(vertices, faces, views, dark, REACH, ~measured).overlap.max() < 0.75
    # what the silhouettes show besides the mesh counts as before
    assert outline_gaps(0.8 * vertices, faces, views, masks, REACH, measured).overlap.max() < 0.75
