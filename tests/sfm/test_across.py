"""Two placements of a painted body laid onto each other by features, with truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from massprops.geometry.rasterise import rasterise
from massprops.sfm import across
from massprops.sfm.across import Side, contradicted, lay, same_surface, side_of
from massprops.views import Views

FOCAL, AWAY, SHOTS = 600.0, 5.0, 8
SIZE = (400, 320)
TURNED = Rotation.from_rotvec([2.9, 0.2, 0.4]).as_matrix()


def above(seed: int, coarser: int) -> Views:
    """Eight cameras round the origin, 20 to 50 degrees above it, with pixels so many times as large."""
    rng = np.random.default_rng(seed)
    turn, up = np.arange(SHOTS) * 2 * np.pi / SHOTS + seed, np.deg2rad(rng.uniform(20, 50, SHOTS))
    centres = AWAY * np.column_stack([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)])
    R = []
    for c in centres:
        z = -c / np.linalg.norm(c)
        x = np.cross(z, [0.0, 0, 1])
        x /= np.linalg.norm(x)
        R.append(np.stack([x, np.cross(z, x), z]))
    K = np.array([[FOCAL / coarser, 0, 199.5 / coarser], [0, FOCAL / coarser, 159.5 / coarser], [0, 0, 1]])
    names = tuple(f"{i:03d}.png" for i in range(SHOTS))
    shift = -np.einsum("nij,nj->ni", np.array(R), centres)
    return Views(
        names,
        np.full(SHOTS, -1),
        np.tile(np.array(SIZE) // coarser, (SHOTS, 1)),
        np.tile(K, (SHOTS, 1, 1)),
        np.zeros((SHOTS, 4)),
        np.array(R),
        shift,
    )


def photographed(paint: np.ndarray, R: np.ndarray, seed: int, coarser: int = 1) -> Side:
    """What cameras see of a painted block that is turned by R, and a first shape that is some pixels wrong.

    Args:
        paint: (n, n, n) grey of the places in the cube of side 2.
    """
    rng = np.random.default_rng(seed)
    block = trimesh.creation.box((1.2, 0.8, 1.0)).subdivide().subdivide().subdivide().subdivide()
    vertices, views = np.asarray(block.vertices) @ R.T, above(seed, coarser)
    images, masks = [], []
    for i in range(len(views)):
        K, turn, shift = views.K[i], views.R[i], views.t[i]
        depth, face = rasterise(vertices, block.faces, K, turn, shift, (SIZE[0] // coarser, SIZE[1] // coarser))
        v, u = np.nonzero(face >= 0)
        ray = np.column_stack([u, v, np.ones(len(u))]) @ np.linalg.inv(K).T
        body = ((ray * depth[v, u, None] - shift) @ turn) @ R
        grey = map_coordinates(paint, (body.T + 1) / 2 * (len(paint) - 1), order=1)
        image = np.full(face.shape, 60.0)
        # one side is lit, the other not
        image[v, u] = grey * rng.uniform(0.4, 1.0) + rng.normal(0, 2, len(u))
        images.append(np.clip(image, 0, 255).astype(np.uint8))
        masks.append(np.where(face >= 0, 255, 0).astype(np.uint8))
    rough = vertices + 0.01 * rng.normal(size=(12, 3))[rng.integers(0, 12, len(vertices))]
    return side_of(views, images, masks, rough, np.asarray(block.faces))


def blotches(seed: int) -> np.ndarray:
    """Grey that varies over a twentieth of the block."""
    rng = np.random.default_rng(seed)
    coarse = [np.kron(rng.normal(size=(n, n, n)), np.ones((64 // n,) * 3)) for n in (16, 32, 64)]
    return np.clip(130 + 45 * sum(coarse), 0, 255)


@pytest.fixture(scope="module", autouse=True)
def drawn_once() -> Iterator[None]:
    """What is drawn of a placement from one direction serves all tests."""
    draw, kept = across._drawn, {}

    def once(side: Side, camera: across._Camera, *where: np.ndarray) -> list[across._Drawn]:
        key = (id(side), repr(camera), *(x.tobytes() for x in where))
        if key not in kept:
            kept[key] = side, draw(side, camera, *where)  # a side that is kept keeps its id
        return kept[key][1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(across, "_drawn", once)
        yield


@pytest.fixture(scope="module")
def upright() -> Side:
    return photographed(blotches(1), np.eye(3), 1)


@pytest.fixture(scope="module")
def turned_over() -> Side:
    return photographed(blotches(1), TURNED, 2)


def rough_start(seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """The second placement's turn and shift, three degrees and five pixels off."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.deg2rad(3) * axis / np.linalg.norm(axis)).as_matrix()
    return turn @ TURNED.T, rng.normal(0, 0.02, 3)


def test_features_lay_a_body_turned_over_exactly(upright: Side, turned_over: Side) -> None:
    found = lay(upright, turned_over, [rough_start()])
    assert found is not None and found.matches > 5 * found.chance
    off = Rotation.from_matrix(TURNED @ found.R)
    assert np.degrees(off.magnitude()) < 0.1 and np.linalg.norm(found.t) < 0.003
    sigma = np.sqrt(np.diag(found.covariance))
    assert (np.abs((found.R @ TURNED @ np.eye(3) - np.eye(3))[[2, 0, 1], [1, 2, 0]]) < 3 * sigma[:3]).all()
    assert (sigma[:3] < np.deg2rad(0.2)).all()


def test_from_a_wrong_turn_it_is_looked_for_everywhere(upright: Side, turned_over: Side) -> None:
    over = np.diag([-1.0, -1.0, 1.0])
    found = lay(upright, turned_over, [(over @ TURNED.T, np.zeros(3))])
    assert found is not None and np.degrees(Rotation.from_matrix(TURNED @ found.R).magnitude()) < 0.1


def test_another_paint_is_not_laid(upright: Side) -> None:
    assert lay(upright, photographed(blotches(7), TURNED, 2), [rough_start()]) is None


def test_features_speak_against_the_wrong_way_round_and_not_where_nothing_is_shared(
    upright: Side, turned_over: Side
) -> None:
    """The block has the same outline when it is turned by half a turn."""
    second, over = turned_over, np.diag([-1.0, -1.0, 1.0])
    assert contradicted(upright, second, over @ TURNED.T, np.zeros(3), overlap=0.6)
    assert not contradicted(upright, second, over @ TURNED.T, np.zeros(3), overlap=0.02)
    assert not contradicted(upright, second, TURNED.T, np.zeros(3), overlap=0.6)


@pytest.mark.parametrize(("alike", "same"), [(1.0, True), (0.3, False)])
def test_a_side_that_looks_alike_in_part_is_not_taken_for_the_same(alike: float, same: bool) -> None:
    """Both sides of a tool's handle have the same plate, and not the same letters on it."""
    about = Rotation.from_rotvec([0.0, 0.0, 1.0]).as_matrix()
    paint, other = blotches(1), blotches(2)
    n = round(alike * len(paint))
    other[:n] = paint[:n]
    first, second = (photographed(p, R, k, coarser=2) for k, (p, R) in enumerate([(paint, np.eye(3)), (other, about)]))
    assert same_surface(first, second, about.T, np.zeros(3)) is same


def test_a_placement_that_shows_no_feature_is_not_laid() -> None:
    """Of a cardboard parcel some drawn images had none, and the command failed."""
    upright = photographed(blotches(1), np.eye(3), 1, coarser=2)
    dark = replace(upright, images=[np.zeros_like(image) for image in upright.images])
    assert lay(upright, dark, [rough_start()]) is None
    assert lay(dark, upright, [rough_start()], anywhere=False) is None
