"""Parts that stereo did not measure, found by what all images show of the support."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.ndimage import binary_dilation
from test_occlusion import PLANE
from test_readings import RED, SIZE, VIEWS, K

from massprops.capture.completed import Part, PlacementEvidence, evidence_of, missing_parts
from massprops.capture.from_shape import overlap, refine, trimap
from massprops.capture.support_evidence import (
    Looked,
    SupportEvidence,
    foot_picture,
    learned,
    off_of,
    reduced,
    wide_picture,
)
from massprops.capture.support_picture import grid_about, picture_of_support
from massprops.capture.votes import EDGES, Evidence, lattice_on, vote
from massprops.geometry.projection import project
from massprops.geometry.rasterise import silhouette
from massprops.run.placement_scenes import SUPPORT
from massprops.surface.cloud import Cloud
from massprops.surface.silhouette import mean_shown

PIXEL = float(np.median(np.linalg.norm(VIEWS.centres, axis=1) / VIEWS.K[:, 0, 0]))
NOTHING = np.zeros((0, 3))


def box(extents: tuple[float, float, float], at: tuple[float, float, float]) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents=extents)
    mesh.apply_translation(at)
    return mesh


BODY = box((0.5, 0.4, 0.4), (0, 0, 0.2))
BAR = box((0.22, 0.06, 0.06), (0.36, 0.0, 0.25))
BESIDE = box((0.2, 0.2, 0.2), (0.4, 0.0, 0.1))


def drawn(mesh: trimesh.Trimesh, i: int) -> np.ndarray:
    return silhouette(np.asarray(mesh.vertices), np.asarray(mesh.faces), VIEWS.K[i], VIEWS.R[i], VIEWS.t[i], SIZE)


def on_table(i: int) -> np.ndarray:
    """(h, w, 2) places of the table that the pixels of a view look at."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    ray = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(K).T @ VIEWS.R[i]
    far = -VIEWS.centres[i, 2] / np.minimum(ray[..., 2], -1e-6)
    out: np.ndarray = VIEWS.centres[i, :2] + far[..., None] * ray[..., :2]
    return out


def pattern(at: np.ndarray) -> np.ndarray:
    """Grey level of the table at places (..., 2)."""
    rng = np.random.default_rng(0)
    wave = rng.normal(0, 4, (8, 2))
    out: np.ndarray = 120 + 10 * sum(np.sin(at @ w + p) for w, p in zip(wave, rng.uniform(0, 6, 8), strict=True))
    return out


@cache
def photograph(i: int, *dark: trimesh.Trimesh) -> np.ndarray:
    """The table with a red box, dark things on it, and another exposure in every image."""
    image = np.repeat(pattern(on_table(i))[..., None], 3, axis=2)
    image[drawn(BODY, i)] = RED[::-1]
    for mesh in dark:
        image[drawn(mesh, i)] = 35
    image *= 0.85 + 0.3 * np.random.default_rng(100 + i).random()
    return np.clip(image + np.random.default_rng(i).normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def found_with(*dark: trimesh.Trimesh, standing: np.ndarray = NOTHING) -> tuple[PlacementEvidence, list[Part]]:
    vertices, faces = np.asarray(BODY.vertices), np.asarray(BODY.faces)
    what = evidence_of(Looked.at(VIEWS, lambda i: photograph(i, *dark), PLANE, (vertices, faces), standing, PIXEL))
    return what, missing_parts(what, PLANE, vertices, standing, PIXEL)


def test_the_picture_is_the_table_where_the_object_hides_it_in_some_images() -> None:
    grid = grid_about(PLANE, np.zeros(3), 0.8, PIXEL, 200)
    picture = picture_of_support(VIEWS, photograph, grid, lambda i: np.zeros(SIZE[::-1], bool))
    steps = np.arange(grid.count)
    place = grid.origin + steps[:, None, None] * grid.first + steps[None, :, None] * grid.second
    # just beside the box some images look at its sides
    beside = (np.abs(place[..., :2]).max(-1) > 0.3) & np.isfinite(picture.colour[..., 0])
    true = pattern(place[..., :2])
    ratio = picture.colour[..., 1] / true
    assert beside.mean() > 0.5
    assert np.percentile(np.abs(ratio / np.median(ratio[beside]) - 1)[beside], 95) < 0.05


FOOT = box((0.5 + 12 * PIXEL, 0.4 + 12 * PIXEL, 6 * PIXEL), (0, 0, 3 * PIXEL))
"""About the body's foot, as stereo measures it where windows reach over the body and the table."""


def foot_seen(*real: trimesh.Trimesh, colour: tuple[int, int, int]) -> tuple[SupportEvidence, list[np.ndarray]]:
    """What images say that show a body and real things of a colour about its foot, where the first shape has `FOOT`; the images."""
    images = [photograph(i).copy() for i in range(len(VIEWS))]
    for mesh in real:
        for i, image in enumerate(images):
            image[drawn(mesh, i) & ~drawn(BODY, i)] = colour
    # a first shape is as fine as its pixels
    shape = trimesh.util.concatenate([BODY, FOOT]).subdivide_to_size(4 * PIXEL)
    seen = Looked.at(
        VIEWS, lambda i: images[i], PLANE, (np.asarray(shape.vertices), np.asarray(shape.faces)), NOTHING, PIXEL
    )
    own = trimesh.sample.sample_surface(BODY, 4000, seed=0)[0]
    foot = foot_picture(seen, (own, np.full((len(own), 3), RED[::-1], np.uint8)))
    return learned(seen, (foot, wide_picture(seen))), images


def test_the_table_shows_that_a_foot_made_of_windows_is_none() -> None:
    said, images = foot_seen(colour=(0, 0, 0))
    for i in (0, len(VIEWS) // 2):
        # images are smooth, so that the body's colours reach a little beyond it
        foot = drawn(FOOT, i) & ~binary_dilation(drawn(BODY, i), iterations=2)
        odds = said.log_odds(VIEWS, i, images[i])
        assert odds is not None
        assert np.mean(odds[foot] < 0) > 0.9
        assert odds[foot].mean() < -1.0


def test_a_foot_of_the_objects_colours_is_left_to_the_image() -> None:
    said, images = foot_seen(FOOT, colour=tuple(RED[::-1]))
    for i in (0, len(VIEWS) // 2):
        foot = drawn(FOOT, i) & ~drawn(BODY, i)
        odds = said.log_odds(VIEWS, i, images[i])
        assert odds is not None
        assert odds[foot].mean() > -0.5


def test_evidence_goes_with_the_object() -> None:
    said, images = foot_seen(colour=(0, 0, 0))
    R, t = trimesh.transformations.rotation_matrix(1.0, [1, 2, 3])[:3, :3], np.array([1.0, 2.0, 3.0])
    one, other = (s.log_odds(v, 3, images[3]) for s, v in ((said, VIEWS), (said.moved(R, t), VIEWS.moved(R, t))))
    assert one is not None and other is not None
    assert np.mean(np.abs(one - other) > 0.5) < 0.01
    assert said.log_odds(replace(VIEWS, names=tuple("x" * len(VIEWS))), 3, images[3]) is None


def test_points_of_the_table_that_stereo_took_for_a_foot_are_told() -> None:
    said, images = foot_seen(colour=(0, 0, 0))
    at = trimesh.sample.sample_surface(FOOT, 3000, seed=0)[0]
    # beside the body, and not so near that its colours are smeared over them
    off = at[(np.abs(at[:, :2]) - [0.25, 0.2]).max(1) > 4 * PIXEL]
    body = trimesh.sample.sample_surface(BODY, 3000, seed=0)[0]
    xyz = np.concatenate([off, body])
    sees = np.zeros((len(xyz), len(VIEWS)), bool)
    for i in range(len(VIEWS)):
        uv = np.rint(project(xyz, VIEWS.K[i], VIEWS.R[i], VIEWS.t[i])[0]).astype(int)
        on_body = drawn(BODY, i)[uv[:, 1], uv[:, 0]]
        sees[:, i] = on_body == (np.arange(len(xyz)) >= len(off))
    start = np.concatenate([[0], np.cumsum(sees.sum(1))])
    cloud = Cloud(xyz, np.zeros_like(xyz), np.ones(len(xyz)), start, np.nonzero(sees)[1])
    shown = mean_shown(cloud, VIEWS, [said.log_odds(VIEWS, i, image) for i, image in enumerate(images)])
    assert said.at_foot(off).all() and not said.at_foot(body[body[:, 2] > 11 * PIXEL]).any()
    assert np.mean(shown[: len(off)] < SUPPORT) > 0.6
    assert np.mean(shown[len(off) :] < SUPPORT) < 0.01


def test_the_picture_that_knows_a_place_first_is_believed() -> None:
    grids = grid_about(PLANE, np.zeros(3), 0.3, PIXEL, 200), grid_about(PLANE, np.zeros(3), 0.8, 2 * PIXEL, 200)
    fine, wide = (picture_of_support(VIEWS, photograph, g, lambda i: drawn(BODY, i)) for g in grids)
    both, own, behind = (
        off_of((fine, wide), VIEWS, 0, photograph(0))[0],
        *(p.off(VIEWS, 0, photograph(0))[0] for p in (fine, wide)),
    )
    assert np.array_equal(both, np.where(np.isnan(own), behind, own), equal_nan=True)


def test_exposures_are_no_difference() -> None:
    grid = grid_about(PLANE, np.zeros(3), 0.8, PIXEL, 200)
    picture = picture_of_support(VIEWS, photograph, grid, lambda i: drawn(BODY, i))
    off, _ = picture.off(VIEWS, 0, photograph(0))
    body = drawn(BODY, 0)
    assert np.nanmedian(off[~body]) < 2 < np.nanmedian(off[body])


def test_a_picture_is_read_as_it_was_saved(tmp_path) -> None:  # type: ignore[no-untyped-def]
    grid = grid_about(PLANE, np.zeros(3), 0.5, 4 * PIXEL, 60)
    picture = picture_of_support(VIEWS, photograph, grid, lambda i: drawn(BODY, i))
    SupportEvidence(VIEWS.names, (picture,), Evidence(np.zeros((5, 33))), NOTHING, PIXEL).save(
        tmp_path / "evidence.npz"
    )
    read = SupportEvidence.load(tmp_path / "evidence.npz")
    again, image = read.pictures[0], photograph(3)
    assert read.names == tuple(VIEWS.names)
    assert np.array_equal(picture.off(VIEWS, 3, image)[0], again.off(VIEWS, 3, image)[0], equal_nan=True)
    one = again.of_image(3).off(VIEWS.take(np.array([3])), 0, image)[0]
    assert np.array_equal(picture.off(VIEWS, 3, image)[0], one, equal_nan=True)


def test_a_dark_bar_that_was_not_measured_is_found_and_agreed_upon() -> None:
    _, parts = found_with(BAR)
    sure = [part for part in parts if part.sure]
    assert sure
    whole = trimesh.util.concatenate([BODY, *(trimesh.Trimesh(p.vertices, p.faces, process=False) for p in sure)])
    both = trimesh.util.concatenate([BODY, BAR])
    before = [overlap(drawn(BODY, i), drawn(both, i)) for i in range(len(VIEWS))]
    after = [overlap(drawn(whole, i), drawn(both, i)) for i in range(len(VIEWS))]
    assert np.mean(after) > np.mean(before)
    tip = [drawn(both, i) & ~drawn(BODY, i) for i in range(len(VIEWS))]
    held = [drawn(whole, i)[t].mean() for i, t in enumerate(tip) if t.sum() > 50]
    assert np.min(held) > 0.9


def test_nothing_is_put_to_a_shape_that_is_whole() -> None:
    assert not any(part.sure for part in found_with()[1])


def test_what_else_stands_there_is_no_part() -> None:
    points = trimesh.sample.sample_surface(BESIDE, 4000, seed=0)[0]
    alone = [part for part in found_with(BESIDE)[1] if part.sure]
    told = [part for part in found_with(BESIDE, standing=points)[1] if part.sure]
    size = [sum(len(p.faces) for p in parts) for parts in (alone, told)]
    assert size[1] < 0.3 * size[0]


def test_images_that_did_not_find_a_part_must_agree_with_it() -> None:
    none = np.zeros((0, 3))
    assert Part(none, none, np.array([3.0, 4.0, 5.0, 4.0, 3.0, 5.0])).sure
    assert not Part(none, none, np.array([30.0, -4.0, 0.0, 0.0, -3.0, 0.0])).sure
    assert not Part(none, none, np.zeros(6)).sure


def test_images_of_two_sizes_are_looked_at_together() -> None:
    size = VIEWS.size.copy()
    size[::2, 0] -= 20
    views = replace(VIEWS, size=size)
    vertices, faces = np.asarray(BODY.vertices), np.asarray(BODY.faces)
    images = [photograph(i)[:, : size[i, 0]] for i in range(len(views))]
    what = evidence_of(Looked.at(views, lambda i: images[i], PLANE, (vertices, faces), NOTHING, PIXEL))
    assert what.log_odds.shape == (len(views), SIZE[1], SIZE[0])
    assert not what.log_odds[0, :, size[0, 0] :].any()


def test_evidence_is_learned_from_the_scene() -> None:
    rng = np.random.default_rng(0)
    free, hidden = np.abs(rng.normal(0, 1, 20_000)), rng.uniform(0, 50, 20_000)
    calm = np.full(20_000, 2.5)
    evidence = Evidence.learn((hidden, calm), (free, calm))
    assert (np.diff(evidence.log_odds, axis=1) >= 0).all()
    odds = evidence.of(np.array([[0.5, 10.0, np.nan]]), np.array([[2.5, 2.5, np.nan]]))[0]
    assert odds[0] < -1.5 and odds[1] > 3 and odds[2] == 0
    # where the picture itself is unsteady nothing was learned, and nothing is said
    assert np.abs(evidence.of(np.array([[10.0]]), np.array([[50.0]]))).max() < 0.5


def test_a_pixel_that_shows_the_support_says_more_than_one_that_does_not() -> None:
    assert vote(np.array(0.0)) == pytest.approx(0.0)
    assert vote(np.array(20.0)) == pytest.approx(np.log(2))
    assert vote(np.array(-4.0)) < -3


def test_the_bins_are_those_of_the_edges() -> None:
    free = np.repeat(EDGES[:-1] + 0.5 * np.diff(EDGES), 10)
    flat = Evidence.learn((free, np.full(len(free), 2.5)), (free, np.full(len(free), 2.5)))
    assert np.abs(flat.log_odds).max() < 1e-6


def test_a_lattice_stands_on_the_support_about_the_shape() -> None:
    vertices = np.asarray(BODY.vertices)
    lattice = lattice_on(PLANE, vertices, 2.0, 0.02, 10**6)
    at, there = lattice.nearest(vertices)
    assert there.all() and lattice.size == pytest.approx(0.02)
    centre = lattice.origin + at @ lattice.steps
    assert np.abs(centre - vertices).max() <= 0.0101
    assert lattice.origin[2] == pytest.approx(0.01)
    coarse = lattice_on(PLANE, vertices, 2.0, 0.02, 10**4)
    assert np.prod(coarse.shape) < 1.3e4
    box_ = tuple(slice(int(k), int(k) + 2) for k in at[0])
    assert np.allclose(lattice.part(box_).origin, centre[0])


def test_evidence_takes_a_thin_part_into_the_silhouette() -> None:
    """A bar in the background's own grey is cut off by edges and colours alone."""
    image = np.full((120, 160, 3), 110, np.uint8)
    image += np.random.default_rng(0).integers(0, 5, image.shape, dtype=np.uint8)
    body, bar = np.zeros((120, 160), bool), np.zeros((120, 160), bool)
    body[40:80, 40:90] = True
    bar[56:61, 90:120] = True
    image[body] = (40, 40, 200)
    image[bar] -= 12
    v, u = np.mgrid[2:120:3, 2:160:3]
    uv = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    shows = ~(body | bar)[uv[:, 1].astype(int), uv[:, 0].astype(int)]
    known = trimap(np.where(body | bar, 1.0, np.inf), uv, np.full(len(uv), 0.9), shows)
    known = replace(known, surely=known.surely & body)
    evidence = np.where(body | bar, 2.0, -2.0).astype(np.float32)
    told = refine(image, replace(known, evidence=evidence))
    assert overlap(told, body | bar) > 0.97
    assert overlap(refine(image, known), body | bar) < overlap(told, body | bar)


def test_a_reduced_view_sees_points_where_the_reduced_image_has_them() -> None:
    views = replace(VIEWS, size=VIEWS.size * 8, K=np.einsum("ij,njk->nik", np.diag([8.0, 8.0, 1.0]), VIEWS.K))
    small = reduced(views)
    assert small.size.max() <= 800 and small.K[0, 0, 0] / views.K[0, 0, 0] == pytest.approx(800 / views.size.max())
    x = np.array([0.1, 0.05, 0.2])
    camera = views.R[0] @ x + views.t[0]
    large, little = ((v.K[0] @ camera / camera[2])[:2] for v in (views, small))
    assert np.allclose((large + 0.5) * small.size[0] / views.size[0] - 0.5, little)
