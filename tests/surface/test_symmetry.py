"""Turns under which a painted body looks the same are found, and no others."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh
from synthetic_dense import cameras

from massprops.geometry.rasterise import rasterise
from massprops.surface.ambiguous import Ambiguity, ambiguity, told
from massprops.surface.cloud import Cloud
from massprops.surface.symmetry import symmetries
from massprops.views import Views

PIXEL = 0.018


def stripes(place: np.ndarray, seed: int) -> np.ndarray:
    """(n,) grey of a picture at places (n, 2) of a side: waves of many directions, none of them periodic on it."""
    rng = np.random.default_rng(seed)
    k = rng.standard_normal((30, 2)) * 9.0
    waves = np.cos(place @ k.T + rng.uniform(0, 2 * np.pi, 30)).sum(1)
    return 120 + 12 * waves


def box(pictures: tuple[int, int, int, int], wing: bool = False, seed: int = 0) -> tuple[Cloud, np.ndarray]:
    """A measured square prism along z, a picture (its seed) on each long side, and perhaps a plate beside it."""
    rng = np.random.default_rng(seed)
    xyz, normal, grey = [], [], []
    for side, picture in enumerate(pictures):
        uv = rng.uniform([-0.5, -1.0], [0.5, 1.0], (4000, 2))
        angle = side * np.pi / 2
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
        xyz.append(np.column_stack([np.full(len(uv), 0.5), uv]) @ turn.T)
        normal.append(np.tile(turn[:, 0], (len(uv), 1)))
        grey.append(stripes(uv, picture))
    for end in (-1.0, 1.0):
        uv = rng.uniform(-0.5, 0.5, (2000, 2))
        xyz.append(np.column_stack([uv, np.full(len(uv), end)]))
        normal.append(np.tile([0, 0, end], (len(uv), 1)))
        grey.append(stripes(uv, 90 + int(end)))
    if wing:
        uv = rng.uniform([0.5, -0.8], [1.8, 0.8], (4000, 2))
        for face in (-1.0, 1.0):
            xyz.append(np.column_stack([uv[:, 0], np.full(len(uv), 0.2 + 0.01 * face), uv[:, 1]]))
            normal.append(np.tile([0, face, 0], (len(uv), 1)))
            grey.append(stripes(uv, 50 + int(face)))
    points = np.concatenate(xyz) + 0.2 * PIXEL * rng.standard_normal((sum(map(len, xyz)), 3))
    seen = np.clip(np.concatenate(grey) + 6 * rng.standard_normal(len(points)), 0, 255)
    n = len(points)
    cloud = Cloud(points, np.concatenate(normal), np.full(n, 0.2 * PIXEL), np.arange(n + 1), np.zeros(n, int))
    return cloud, np.repeat(seen[:, None], 3, axis=1).astype(np.uint8)


def found(body: tuple[Cloud, np.ndarray], tilt: float = 0.0) -> list[tuple[int, int]]:
    """(axis, fold) of a body whose principal axes are known up to a tilt."""
    axes = trimesh.transformations.rotation_matrix(tilt, [1, 1, 0])[:3, :3][:, [2, 0, 1]]
    return [(s.axis, s.fold) for s in symmetries(*body, np.array([0.01, -0.01, 0.0]), axes, PIXEL)]


@pytest.mark.parametrize(
    ("pictures", "wanted"),
    [((1, 1, 1, 1), [(0, 4)]), ((1, 2, 1, 2), [(0, 2)]), ((1, 2, 3, 4), [])],
    ids=["four alike", "opposite alike", "none alike"],
)
def test_sides_with_one_picture_are_counted(pictures, wanted):
    assert found(box(pictures), tilt=0.03) == wanted


def test_a_plate_beside_the_body_does_not_hide_that_its_sides_look_alike():
    cloud, colour = box((1, 1, 1, 1), wing=True)
    (one,) = symmetries(cloud, colour, np.array([0.04, 0.01, 0.0]), np.eye(3)[:, [2, 0, 1]], PIXEL)
    assert (one.axis, one.fold) == (0, 4)
    assert one.shape < 0.8, "the plate does not lie on the body after a turn"
    whole = one.turns()
    assert len(whole) == 3
    R, t = whole[2][0] @ one.R, whole[2][0] @ one.t + whole[2][1]
    np.testing.assert_allclose(R, np.eye(3), atol=0.01)
    np.testing.assert_allclose(t, 0, atol=0.02)


def test_a_body_without_paint_is_not_said_to_repeat():
    cloud, colour = box((1, 1, 1, 1))
    plain = np.clip(120 + 4 * np.random.default_rng(5).standard_normal(colour.shape), 0, 255).astype(np.uint8)
    assert symmetries(cloud, plain, np.zeros(3), np.eye(3)[:, [2, 0, 1]], PIXEL) == []


def round_about(count: int) -> Views:
    """Views from all round the prism, in its middle plane."""
    angle = np.arange(count) * 2 * np.pi / count + 0.1
    return cameras(np.column_stack([np.cos(angle), np.sin(angle), np.full(count, 0.05)]), 8.0, 400.0, (320, 240))


@cache
def with_wing(in_time: bool) -> Ambiguity:
    """A prism of four like sides with a thin plate beside it, seen from all round."""
    cloud, colour = box((1, 1, 1, 1), wing=True)
    plate = trimesh.creation.box(bounds=[[0.49, 0.19, -0.8], [1.8, 0.21, 0.8]])
    mesh = trimesh.boolean.union([trimesh.creation.box((1, 1, 2)), plate], engine="manifold")
    views = round_about(24)
    masks, shown = [], np.zeros((len(cloud), len(views)), bool)
    for i in range(len(views)):
        depth, face = rasterise(mesh.vertices, mesh.faces, views.K[i], views.R[i], views.t[i], (320, 240))
        masks.append(np.where(face >= 0, 255, 0).astype(np.uint8))
        x = cloud.xyz @ views.R[i].T + views.t[i]
        u, v = np.rint(x[:, :2] / x[:, 2:] @ views.K[i][:2, :2].T + views.K[i][:2, 2]).astype(int).T
        facing = np.einsum("mi,mi->m", cloud.normal, views.centres[i] - cloud.xyz) > 0.3
        shown[:, i] = facing & (x[:, 2] < depth[v, u] + 0.05)
    start = np.concatenate([[0], np.cumsum(shown.sum(1))])
    seen = Cloud(cloud.xyz, cloud.normal, cloud.sigma, start, np.nonzero(shown)[1])
    (one,) = symmetries(seen, colour, np.array([0.04, 0.01, 0.0]), np.eye(3)[:, [2, 0, 1]], PIXEL)
    return ambiguity(one, seen, (mesh.vertices, mesh.faces), views, masks, in_time)


def test_an_image_that_shows_the_plate_has_one_place():
    found = with_wing(in_time=True)
    views = round_about(24)
    away = np.degrees(np.arccos(np.clip(views.centres[:, 0] / np.linalg.norm(views.centres, axis=1), -1, 1)))
    hidden = {n for n, a in zip(views.names, away, strict=True) if a > 150}
    assert found.alike and set(found.alike) <= hidden, "the plate, or that there is none, tells all others"
    assert not found.apart, "the images follow each other, and most of them show the plate"
    assert with_wing(in_time=False).apart == found.alike


def test_the_candidates_lie_about_the_body():
    found = with_wing(in_time=True)
    whole = 2.0 + 1.3 * 0.02 * 1.6
    # a body turned about a line is not laid onto itself to the last digit
    assert found.common[0] == pytest.approx(2.0, rel=0.02)
    assert found.together[0] == pytest.approx(2.0 + 4 * (whole - 2.0), rel=0.02)


def test_a_run_without_anything_of_its_own_is_not_told_where_it_belongs():
    views = round_about(24)
    alike = np.ones(24, bool)
    assert told(views, alike, 4).all(), "one run: which side is called the first is free"
    broken = views.take(np.array([*range(10), *range(16, 22)]))
    np.testing.assert_array_equal(told(broken, np.ones(16, bool), 4), np.arange(16) < 10)
    some = np.arange(16) != 12
    assert told(broken, some, 4).all(), "an image of the second run shows something of its own"
