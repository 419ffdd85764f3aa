"""The shape of a plain object, from where the table that it stands on does not show."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from test_readings import RED, SIZE, VIEWS, K

from massprops.capture.occlusion import (
    Occlusion,
    boundary,
    continued,
    drawn_agreement,
    held_share,
    hidden_shape,
    occlusion_maps,
    on_mesh,
    settled,
    support_agreement,
    support_points,
    visibility,
    with_still,
)
from massprops.dense.region import Region
from massprops.geometry.rasterise import silhouette
from massprops.run.drawn_silhouettes import surroundings
from massprops.run.stages.shape import HELD, WHOLE, WHOLLY
from massprops.surface.cloud import Cloud
from massprops.surface.outline_cloud import surface_of_outlines
from massprops.surface.silhouette import agreement, shown_as_object

REGION = Region(np.array([0, 0, 0.1]), 1.0)
PLANE = np.array([0.0, 0.0, 1.0, 0.0])
BODY = trimesh.creation.box(extents=(0.5, 0.4, 0.4))
BODY.apply_translation([0, 0, 0.2])


def outline(i: int) -> np.ndarray:
    return silhouette(np.asarray(BODY.vertices), np.asarray(BODY.faces), VIEWS.K[i], VIEWS.R[i], VIEWS.t[i], SIZE)


def photograph(i: int, body: bool = True) -> np.ndarray:
    """A table with a soft random pattern, and a plain red box on it."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    ray = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(K).T @ VIEWS.R[i]
    far = -VIEWS.centres[i, 2] / np.minimum(ray[..., 2], -1e-6)
    at = VIEWS.centres[i, :2] + far[..., None] * ray[..., :2]
    wave = rng.normal(0, 6, (12, 2))
    level = 120 + 12 * sum(np.sin(at @ w + p) for w, p in zip(wave, rng.uniform(0, 6, 12), strict=True))
    image = np.repeat(level[..., None], 3, axis=2)
    if body:
        image[outline(i)] = RED[::-1]
    return np.clip(image + np.random.default_rng(i).normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def seen(image: Callable[[int], np.ndarray], half: float = 0.28) -> Occlusion:
    pixel = float(np.median(np.linalg.norm(VIEWS.centres - REGION.centre, axis=1) / VIEWS.K[:, 0, 0]))
    return occlusion_maps(VIEWS, image, *support_points(PLANE, REGION, table(half), pixel))


def table(half: float = 0.28) -> np.ndarray:
    flat = np.arange(-1.4, 1.4, 0.02)
    x, y = (a.ravel() for a in np.meshgrid(flat, flat))
    free = np.maximum(np.abs(x), np.abs(y)) > half
    return np.column_stack([x, y, np.zeros(len(x))])[free]


def test_a_plain_box_hides_the_table_behind_it() -> None:
    found = hidden_shape(VIEWS, seen(photograph), PLANE, REGION)
    assert found is not None and found.agreement > 0.7
    shape = trimesh.Trimesh(found.vertices, found.faces)
    assert shape.volume > 0
    low, high = shape.bounds
    # a hull from 24 views at one height is too large by a pixel, and has a roof
    assert np.all(low < [-0.22, -0.17, 0.02]) and np.all(low > [-0.36, -0.31, -0.02])
    assert np.all(high > [0.22, 0.17, 0.36]) and np.all(high < [0.36, 0.31, 0.62])
    assert BODY.volume * 0.9 < shape.volume < BODY.volume * 2.2


def test_a_part_of_the_body_agrees_less_than_what_hides_the_support() -> None:
    """A plain body of which stereo has measured the lower half."""
    maps = seen(photograph)
    half = trimesh.intersections.slice_mesh_plane(BODY, [0, 0, -1], [0, 0, 0.15], cap=True)
    whole, part = (support_agreement(VIEWS, maps, np.asarray(m.vertices), np.asarray(m.faces)) for m in (BODY, half))
    hidden = hidden_shape(VIEWS, maps, PLANE, REGION)
    assert hidden is not None
    found = support_agreement(VIEWS, maps, hidden.vertices, hidden.faces)
    assert part < WHOLE < whole and found > part + WHOLLY
    assert held_share(VIEWS, hidden.vertices, hidden.faces, np.asarray(half.vertices)) > HELD


def test_what_stands_still_behind_a_turntable_shows_how_high_the_body_is() -> None:
    """Of the support only a disc little wider than the body is known."""
    disc = table()
    maps = occlusion_maps(VIEWS, photograph, disc[np.linalg.norm(disc, axis=1) < 0.55])
    still = [~outline(i) for i in range(len(VIEWS))]
    found = [hidden_shape(VIEWS, m, PLANE, REGION) for m in (maps, with_still(maps, still))]
    fat, slim = (trimesh.Trimesh(f.vertices, f.faces).volume / BODY.volume for f in found if f is not None)
    assert slim < 0.9 * fat and 0.9 < slim < 2.2
    known = [s != 0 for s in maps.state]
    for before, after, k in zip(maps.state, with_still(maps, still).state, known, strict=True):
        assert np.array_equal(before[k], after[k]), "what is known of the support stays"


def test_the_hull_of_a_part_does_not_hold_what_was_measured() -> None:
    """As of a body whose other half has the colour of its table."""
    dark = trimesh.intersections.slice_mesh_plane(BODY, [1, 0, 0], [0, 0, 0], cap=True)
    rng = np.random.default_rng(2)
    measured = trimesh.sample.sample_surface(BODY, 400, seed=rng)[0]
    assert held_share(VIEWS, np.asarray(dark.vertices), np.asarray(dark.faces), measured) < HELD
    assert held_share(VIEWS, np.asarray(BODY.vertices), np.asarray(BODY.faces), measured) == 1.0


def test_an_empty_table_hides_nothing() -> None:
    assert hidden_shape(VIEWS, seen(lambda i: photograph(i, body=False), 0.0), PLANE, REGION) is None


def test_only_the_measured_support_counts_near_the_middle() -> None:
    points, sure = support_points(PLANE, REGION, table(), 0.006)
    points = points[sure]
    off = np.abs(points[:, :2]).max(1)
    assert off.min() > 0.2 and off.max() > 1.5 and np.abs(points[:, 2]).max() < 1e-9


def test_a_plain_support_goes_on_where_stereo_measured_nothing() -> None:
    """But not as a shade, nor where the colour is not known."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(-10.0, 11), np.arange(-10.0, 11)))
    xyz = np.column_stack([x, y, np.zeros(len(x))])
    own = np.tile([90.0, 100, 95], (len(x), 1))
    shade, unknown = (x > 0) & (np.hypot(x, y) < 4), (x < -2) & (np.hypot(x, y) < 4)
    own[shade], own[unknown] = 60, np.nan
    sure = np.hypot(x, y) > 6
    assert np.array_equal(continued(xyz, own, sure), ~shade & ~unknown)
    assert np.array_equal(continued(xyz, own, np.zeros(len(x), bool)), np.zeros(len(x), bool)), "nothing to go on from"


def test_the_known_support_is_given_with_its_colours() -> None:
    maps = seen(photograph)
    assert len(maps.support) == len(maps.colour) > 1000
    np.testing.assert_allclose(maps.support[:, 2], 0, atol=1e-9)
    assert abs(float(np.median(maps.colour)) - 120) < 15


def test_silhouettes_are_drawn_with_all_known_support(tmp_path: Path) -> None:
    other = Cloud(np.eye(3), np.eye(3), np.ones(3), np.array([0, 1, 2, 3]), np.zeros(3, int))
    other.save(tmp_path / "other.npz")
    np.save(tmp_path / "other_colour.npy", np.tile(np.array([10, 20, 30], np.uint8), (3, 1)))
    assert surroundings(tmp_path)[1].tolist() == [[30, 20, 10]] * 3, "stored as RGB, given as BGR"
    np.savez(tmp_path / "support.npz", xyz=np.zeros((2, 3)), colour=np.full((2, 3), 7, np.uint8))
    xyz, colour = surroundings(tmp_path)
    assert len(xyz) == len(colour) == 5 and (colour[3:] == 7).all()


def test_exposure_is_no_occlusion_and_gloss_is_unknown() -> None:
    rng = np.random.default_rng(1)
    own = rng.uniform(60, 120, (200, 3))
    gain = np.linspace(0.7, 1.5, 12)
    colour = np.clip(gain[:, None, None] * own + rng.normal(0, 1, (12, 200, 3)), 0, 255)
    colour[3, :40] += 60  # something stands before these
    colour[:, 190:] = rng.uniform(0, 255, (12, 10, 3))  # these mirror the room
    there = np.ones((12, 200), bool)
    there[:, 180:190] = False
    state, _ = visibility(colour.clip(0, 255).astype(np.uint8), there)
    assert (state[3, :40] == -1).mean() > 0.9
    rest = np.delete(state[:, 40:180], 3, axis=0)
    assert (rest == 1).mean() > 0.9 and (rest == -1).mean() < 0.02
    assert (state[:, 180:] == 0).all()


def test_the_boundary_of_voxels_is_closed_and_outward() -> None:
    from types import SimpleNamespace

    solid = np.random.default_rng(2).random((6, 5, 4)) > 0.6
    centre = np.stack(np.meshgrid(*(np.arange(n) * 0.1 for n in solid.shape), indexing="ij"), axis=-1)
    vertices, faces = boundary(SimpleNamespace(centre=centre), solid)  # type: ignore[arg-type]
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = np.einsum("ni,ni->", a, np.cross(b, c)) / 6
    np.testing.assert_allclose(volume, solid.sum() * 1e-3, rtol=1e-9)
    ball = trimesh.creation.icosphere(2)
    cloud = on_mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    assert np.einsum("ni,ni->n", cloud.xyz, cloud.normal).min() > 0.9


def test_a_surface_of_outlines_is_filled_all_over() -> None:
    masks = [np.where(outline(i), 255, 0).astype(np.uint8) for i in range(len(VIEWS))]
    surface = surface_of_outlines(VIEWS, masks, np.array([0, 0, 0.2]), 0.6, support=PLANE)
    shape = trimesh.Trimesh(surface.vertices, surface.faces)
    assert shape.is_watertight and not surface.observed.any() and surface.inferred.any()
    assert BODY.volume < shape.volume < 1.6 * BODY.volume
    assert shape.bounds[0, 2] > -0.02


def test_a_mesh_is_judged_by_the_silhouettes() -> None:
    masks = [np.where(outline(i), 255, 0).astype(np.uint8) for i in range(4)]
    masks[3][:] = 0
    vertices, faces = np.asarray(BODY.vertices), np.asarray(BODY.faces)
    views = VIEWS.take(np.arange(4))
    same = agreement(vertices, faces, views, masks)
    assert (same[:3] == 1).all() and np.isnan(same[3])
    half = vertices * [1, 1, 0.5]
    assert (agreement(half, faces, views, masks)[:3] < 0.85).all()


def test_what_shows_within_the_silhouettes_is_no_surroundings() -> None:
    masks = [np.where(outline(i), 255, 0).astype(np.uint8) for i in range(len(VIEWS))]
    points = np.array([[0.0, 0.0, 0.39], [0.9, 0.0, 0.0]])  # below the lid as a gloss shows it; on the table
    seen = np.tile(np.arange(len(VIEWS)), 2)
    start = np.array([0, len(VIEWS), 2 * len(VIEWS)])
    cloud = Cloud(points, np.tile([0.0, 0, 1], (2, 1)), np.full(2, 0.01), start, seen)
    assert shown_as_object(cloud, VIEWS, masks).tolist() == [True, False]


def test_each_image_goes_to_the_placement_that_hides_what_it_hides() -> None:
    """The box in the first half of the images, the same box elsewhere in the others."""
    other = BODY.copy()
    other.apply_transform(trimesh.transformations.rotation_matrix(1.2, [0, 0, 1]))
    other.apply_translation([0.08, -0.05, 0])
    meshes = [(np.asarray(m.vertices), np.asarray(m.faces)) for m in (BODY, other)]
    truth = np.arange(len(VIEWS)) % 2

    def image(i: int) -> np.ndarray:
        picture = photograph(i, body=False)
        shape = meshes[truth[i]]
        picture[silhouette(*shape, VIEWS.K[i], VIEWS.R[i], VIEWS.t[i], SIZE)] = RED[::-1]
        return picture

    maps = occlusion_maps(VIEWS, image, *support_points(PLANE, REGION, table(0.4), 0.006))
    agreement = drawn_agreement(VIEWS, maps, meshes)
    label = truth.copy()
    label[:6] = -1
    label[6] = 1 - label[6]
    assert np.array_equal(settled(label, agreement), truth)
    flat = np.full((len(VIEWS), 2), 0.5)
    assert np.array_equal(settled(label, flat), label), "what does not tell changes nothing"
