"""Dark places that may be holes: a tube whose bore was closed, and cylinders that are solid; holes that go through."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from massprops.geometry.rasterise import rasterise
from massprops.surface.holes import dark_places, straight_behind
from massprops.surface.through_holes import ALIKE, Tube, _alike, opened, through_holes, with_open_holes
from massprops.views import Views

INNER, OUTER, HEIGHT = 0.35, 1.0, 1.6
SIZE = (240, 200)


def _views() -> Views:
    K = np.array([[220.0, 0, 119.5], [0, 220.0, 99.5], [0, 0, 1]])
    R, t = [], []
    for height in (2.5, -2.5):
        for turn in np.arange(8) * np.pi / 4:
            centre = np.array([3.0 * np.cos(turn), 3.0 * np.sin(turn), height])
            forward = -centre / np.linalg.norm(centre)
            right = np.cross(forward, [0.0, 0.0, 1.0])
            right /= np.linalg.norm(right)
            turned = np.stack([right, np.cross(forward, right), forward])
            R.append(turned)
            t.append(-turned @ centre)
    n = len(R)
    names = tuple(f"cam0/{i}.png" for i in range(n))
    return Views(
        names, np.arange(n), np.tile(SIZE, (n, 1)), np.tile(K, (n, 1, 1)), np.zeros((n, 4)), np.array(R), np.array(t)
    )


def _paint(x: np.ndarray) -> np.ndarray:
    """Grey levels of the outside at points (k, 3)."""
    return np.asarray(150.0 + 25.0 * np.sin(9 * x[:, 0]) * np.sin(8 * x[:, 1] + 1) * np.cos(7 * x[:, 2]))


def _drawn(mesh: trimesh.Trimesh, views: Views, inside: str) -> list[np.ndarray]:
    """Images of a mesh; `inside`: of what is painted within the bore's radius: `bore`, `stain`, or `plain`."""
    mesh = mesh.subdivide_to_size(0.08)
    middle, face_normals = np.asarray(mesh.triangles_center), np.asarray(mesh.face_normals)
    value = _paint(middle)
    radius = np.linalg.norm(middle[:, :2], axis=1)
    if inside == "bore":
        # light comes in from one side, and less the deeper
        own = (radius < INNER + 0.02) & (np.abs(face_normals[:, 2]) < 0.5)
        lit = 0.5 * (1.0 + face_normals[own, 0]) * np.exp(-4.0 * (0.5 * HEIGHT - np.abs(middle[own, 2])))
        value[own] = 20.0 + 130.0 * lit
    else:
        value[radius < INNER] = {"stain": 25.0, "plain": 150.0}[inside]
    images = []
    for i in range(len(views)):
        _, face = rasterise(np.asarray(mesh.vertices), np.asarray(mesh.faces), views.K[i], views.R[i], views.t[i], SIZE)
        noise = np.random.default_rng(i).normal(0.0, 1.5, face.shape)
        # a little gloss: no measured surface is as bright from everywhere
        shown = value * (0.75 + 0.4 * np.abs(face_normals @ views.R[i].T[:, 2]))
        images.append(np.clip(np.where(face >= 0, shown[np.maximum(face, 0)], 90.0) + noise, 0, 255).astype(np.uint8))
    return images


def _closed(inside: str) -> tuple[SimpleNamespace, list[np.ndarray]]:
    """A cylinder whose bore was closed level with its ends, and its dark places."""
    solid = trimesh.creation.cylinder(OUTER, HEIGHT, sections=48).subdivide_to_size(0.12)
    tube = trimesh.creation.annulus(INNER, OUTER, HEIGHT, sections=48)
    vertices, faces = np.asarray(solid.vertices, float), np.asarray(solid.faces)
    middle = vertices[faces].mean(axis=1)
    cap = np.abs(np.abs(middle[:, 2]) - 0.5 * HEIGHT) < 1e-6
    filled = cap & (np.linalg.norm(middle[:, :2], axis=1) < INNER)
    views = _views()
    grey = _drawn(tube if inside == "bore" else solid, views, inside)
    none = np.zeros(len(faces), bool)
    body = SimpleNamespace(vertices=vertices, faces=faces, observed=~filled, inferred=none, noise=0.01, spacing=0.05)
    return body, dark_places(body, views, grey)


def test_a_bore_that_was_closed_may_be_empty() -> None:
    body, places = _closed("bore")
    assert len(places) == 2  # both its ends
    space = straight_behind(body, places)
    assert space[0] == pytest.approx(np.pi * INNER**2 * HEIGHT, rel=0.1)
    assert np.abs(space[1:4]).max() < 0.02 * space[0]


@pytest.mark.parametrize("inside", ["stain", "plain"])
def test_a_dark_stain_and_a_plain_side_are_no_holes(inside: str) -> None:
    body, places = _closed(inside)
    assert not places
    assert not straight_behind(body, places).any()


@pytest.mark.parametrize(("reach", "found"), [(-0.6, 1), (0.6, 0)])
def test_a_dark_side_larger_than_what_was_measured_is_no_hole(reach: float, found: int) -> None:
    """Stereo measured a rib of a glossy banana, and its other sides were darker, each image in its own way."""
    solid = trimesh.creation.cylinder(OUTER, HEIGHT, sections=48).subdivide_to_size(0.12)
    vertices, faces = np.asarray(solid.vertices, float), np.asarray(solid.faces)
    middle, views, grey = vertices[faces].mean(axis=1), _views(), []
    dark = middle[:, 0] < reach
    for i, (K, R, t) in enumerate(zip(views.K, views.R, views.t, strict=True)):
        face = rasterise(vertices, faces, K, R, t, SIZE)[1]
        shown = np.where(dark, 10.0 + 60.0 * np.random.default_rng(i).random(), _paint(middle))
        grey.append(np.where(face >= 0, shown[np.maximum(face, 0)], 90.0).astype(np.uint8))
    body = SimpleNamespace(
        vertices=vertices, faces=faces, observed=~dark, inferred=np.zeros(len(faces), bool), noise=0.01, spacing=0.05
    )
    assert len(dark_places(body, views, grey)) == found


def _dented(
    depths: tuple[float, float], floor: bool = False, turn: float = 0.0
) -> tuple[SimpleNamespace, list[np.ndarray]]:
    """A cylinder with a bore from both ends, as deep as stereo measured its walls, each floor filled; and its floors.

    Args:
        depths: from above and below, 0 for none; floor: the lower floor was measured.
        turn: [rad] of the body about x.
    """
    solid = trimesh.creation.cylinder(OUTER, HEIGHT, sections=48)
    for depth, end in zip(depths, (1, -1), strict=True):
        if depth:
            bore = trimesh.creation.cylinder(INNER, 2 * depth, sections=48)
            bore.apply_translation([0, 0, end * 0.5 * HEIGHT])
            solid = trimesh.boolean.difference([solid, bore], engine="manifold")
    solid = solid.subdivide_to_size(0.15)
    solid.merge_vertices()
    vertices, faces = np.asarray(solid.vertices, float), np.asarray(solid.faces)
    middle = vertices[faces].mean(axis=1)
    inner = np.linalg.norm(middle[:, :2], axis=1) < INNER - 1e-3
    flat = np.abs(np.asarray(solid.face_normals)[:, 2]) > 0.9
    upper, lower = inner & flat & (middle[:, 2] > 0), inner & flat & (middle[:, 2] < 0)
    filled = (upper & bool(depths[0])) | (lower & bool(depths[1]) & (not floor))
    c, s = np.cos(turn), np.sin(turn)
    vertices = vertices @ np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]]).T
    none = np.zeros(len(faces), bool)
    body = SimpleNamespace(vertices=vertices, faces=faces, observed=~filled, inferred=none, noise=0.01, spacing=0.05)
    return body, [np.flatnonzero(side & filled) for side in (upper, lower) if (side & filled).any()]


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_bore_that_narrows_where_it_was_closed_may_go_on_as_wide_as_its_mouth(turn: float) -> None:
    body, (floor,) = _dented((0.5, 0.0), turn=turn)
    middle = body.vertices[body.faces[floor]].mean(axis=1)
    inner = floor[np.linalg.norm(middle - middle.mean(axis=0), axis=1) < 0.6 * INNER]
    space = straight_behind(body, [inner])
    # the body's lower end was measured: a wall as thin as its noise is proven
    assert space[0] == pytest.approx(np.pi * INNER**2 * (HEIGHT - 0.5), rel=0.08)


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_bore_measured_from_both_ends_is_opened(turn: float) -> None:
    body, places = _dented((0.4, 0.5), turn=turn)
    tubes, left = through_holes(body, places)
    assert len(tubes) == 1 and not left
    made_of = opened(body, tubes)
    assert made_of is not None
    vertices, faces, observed, inferred = made_of
    made = trimesh.Trimesh(vertices, faces, process=False)
    assert made.is_volume and made.body_count == 1
    assert made.euler_number == 0  # one hole goes through it
    assert made.volume == pytest.approx(np.pi * (OUTER**2 - INNER**2) * HEIGHT, rel=0.03)
    assert not observed[_between(vertices[faces].mean(axis=1), turn)].any()
    assert observed.sum() > 0.9 * body.observed.sum() and not inferred.any()
    rows = with_open_holes(np.tile(np.ones(10), (500, 1)), tubes[0].unsure, 0)
    assert np.ptp(rows[:, 0]) <= tubes[0].unsure[0] and rows[:, 0].mean() == pytest.approx(1.0, abs=0.01)


def _between(points: np.ndarray, turn: float) -> np.ndarray:
    """Whether points (k, 3) lie in the bore where nothing was measured."""
    along = -np.sin(turn) * points[:, 1] + np.cos(turn) * points[:, 2]
    away = np.cos(turn) * points[:, 1] + np.sin(turn) * points[:, 2]
    return (np.hypot(points[:, 0], away) < INNER + 0.05) & (along > -0.25) & (along < 0.35)


def test_what_would_part_the_body_is_not_opened() -> None:
    body, _ = _dented((0.4, 0.5))
    slab = trimesh.creation.box((3.0, 3.0, 0.2))
    assert opened(body, [Tube(np.asarray(slab.vertices), np.asarray(slab.faces), np.zeros(10))]) is None


def test_holes_that_cannot_be_opened_may_still_be_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    from massprops.run.stages import surface as stage

    body, places = _closed("bore")
    tube = Tube(body.vertices, body.faces, np.ones(10))
    monkeypatch.setattr("massprops.surface.holes.dark_places", lambda *_: places)
    monkeypatch.setattr("massprops.surface.through_holes.through_holes", lambda *_: ([tube], []))
    monkeypatch.setattr("massprops.surface.through_holes.opened", lambda *_: None)
    same, found = stage._opened(body, _views(), [])
    assert same is body and (found.count, found.opened) == (2, 0)
    assert found.behind[0] == pytest.approx(np.pi * INNER**2 * HEIGHT, rel=0.1) and not found.unsure.any()


def test_a_bore_whose_other_end_was_measured_solid_stays_closed() -> None:
    body, places = _dented((0.4, 0.5), floor=True)
    tubes, left = through_holes(body, places)
    assert not tubes and len(left) == 1
    body, places = _dented((0.4, 0.0))
    tubes, left = through_holes(body, places)
    assert not tubes and len(left) == 1


@pytest.mark.parametrize(("wider", "one_hole"), [(1.35, True), (1.8, False)])
def test_dents_of_other_sections_are_no_hole(wider: float, one_hole: bool) -> None:
    """What is filled in narrows a section by a cell or two; one twice as wide is another's."""
    body, places = _dented((0.4, 0.4))
    inner = np.linalg.norm(body.vertices[:, :2], axis=1) < INNER + 0.02
    body.vertices[inner & (body.vertices[:, 2] < 0), :2] *= wider
    tubes, left = through_holes(body, places)
    assert len(tubes) == one_hole and len(left) == (0 if one_hole else 2)


def test_a_short_bore_of_which_no_wall_was_measured_is_opened_where_both_ends_are_dark() -> None:
    body, places = _closed("bore")
    tubes, left = through_holes(body, places)
    assert len(tubes) == 1 and not left
    made_of = opened(body, tubes)
    assert made_of is not None
    made = trimesh.Trimesh(*made_of[:2], process=False)
    assert made.is_volume and made.euler_number == 0
    assert made.volume == pytest.approx(np.pi * (OUTER**2 - INNER**2) * HEIGHT, rel=0.04)
    aside = [place[body.vertices[body.faces[place]].mean(axis=1)[:, 0] > 0.4 * INNER] for place in places]
    assert not through_holes(body, [places[0], aside[1]])[0], "they hardly cover each other"


@pytest.mark.parametrize(("radius", "aside", "one_hole"), [(3.5, 1.5, True), (3.5, 6.0, False), (9.0, 0.0, False)])
def test_ends_of_a_small_hole_are_known_to_a_cell(radius: float, aside: float, one_hole: bool) -> None:
    """Dark places of a screw hole 7 cells across, a little apart and unlike in size; others beside it or far larger."""
    x, y = np.meshgrid(np.arange(40.0), np.arange(40.0), indexing="ij")
    one, other = (np.hypot(x - 20, y - at) < r for at, r in ((20.0, 2.8), (20.0 + aside, radius)))
    assert (_alike(one, other) > ALIKE) == one_hole
    assert np.count_nonzero(one & other) / np.count_nonzero(one | other) < ALIKE
