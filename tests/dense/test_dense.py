"""PatchMatch and fusion on a textured sphere that numpy renders exactly."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from massprops.core.parts import Parts
from massprops.dense import reconstruct
from massprops.dense.curvature import fit_curvature
from massprops.dense.depthmap import Matching, depth_map
from massprops.dense.noise import denoised, grey_noise
from massprops.dense.patchmatch import paired
from massprops.dense.reconstruct import DenseOptions, DensePoints, _unexplained, crop, dense_points
from massprops.dense.select import select_views
from massprops.errors import NotPossible
from massprops.sfm.points import SparsePoints
from massprops.views import Views

SIZE, FOCAL, DISTANCE = 128, 300.0, 5.0


class Seen(NamedTuple):
    xyz: np.ndarray
    obs_view: np.ndarray
    obs_point: np.ndarray


def texture(p: np.ndarray) -> np.ndarray:
    """Smooth pseudo-random grey of a surface point (n, 3)."""
    rng = np.random.default_rng(7)
    out = np.full(len(p), 120.0)
    for scale in (4.0, 9.0, 18.0, 30.0):
        for _ in range(5):
            d = rng.standard_normal(3)
            out += 60 / scale**0.5 * np.sin(scale * p @ d / np.linalg.norm(d) + rng.uniform(0, 6))
    return out


def sphere_views(n: int = 9, step: float = 7.0, noise: float = 1.0, flat: bool = False):  # type: ignore[no-untyped-def]
    """Views of a unit sphere from a ring, with images, masks and sparse points on the surface."""
    rng = np.random.default_rng(0)
    K = np.array([[FOCAL, 0, SIZE / 2 - 0.5], [0, FOCAL, SIZE / 2 - 0.5], [0, 0, 1.0]])
    Rs, ts, images = [], [], []
    for a in np.radians(step * (np.arange(n) - n // 2)):
        centre = DISTANCE * np.array([np.sin(a), 0.15 * np.sin(3 * a), -np.cos(a)])
        z = -centre / np.linalg.norm(centre)
        x = np.cross([0, 1.0, 0], z)
        x /= np.linalg.norm(x)
        R = np.stack([x, np.cross(z, x), z])
        v, u = np.mgrid[0:SIZE, 0:SIZE]
        ray = np.stack([(u - K[0, 2]) / FOCAL, (v - K[1, 2]) / FOCAL, np.ones_like(u, float)], -1) @ R
        b, c = ray @ centre, centre @ centre - 1
        q = np.einsum("hwi,hwi->hw", ray, ray)
        disc = b * b - q * c
        hit = disc > 0
        depth = (-b - np.sqrt(np.maximum(disc, 0))) / q
        point = centre + ray * depth[..., None]
        grey = np.zeros((SIZE, SIZE))
        grey[hit] = 120.0 if flat else texture(point[hit])
        grey = np.clip(grey + noise * rng.standard_normal(grey.shape), 0, 255).astype(np.uint8)
        images.append((np.repeat(grey[..., None], 3, axis=2), np.where(hit, 255, 0).astype(np.uint8)))
        Rs.append(R)
        ts.append(-R @ centre)
    views = Views(
        tuple(f"cam0/{i}.png" for i in range(n)), np.full(n, -1), np.full((n, 2), SIZE), np.tile(K, (n, 1, 1)),
        np.zeros((n, 4)), np.stack(Rs), np.stack(ts),
    )  # fmt: skip
    xyz = rng.standard_normal((400, 3))
    xyz /= np.linalg.norm(xyz, axis=1, keepdims=True)
    view, point = np.nonzero(np.einsum("nj,mj->nm", views.centres, xyz) > 1.5)
    return views, images, Seen(xyz, view, point)


@pytest.fixture(scope="module")
def solved():  # type: ignore[no-untyped-def]
    views, images, seen = sphere_views()
    points, facts = dense_points(views, lambda i: images[i], seen, DenseOptions(seed=3, threads=2))
    return views, points, facts


def test_points_lie_on_the_sphere_without_bias(solved) -> None:  # type: ignore[no-untyped-def]
    _, points, _ = solved
    radius = np.linalg.norm(points.xyz, axis=1)
    assert len(points.xyz) > 2000
    assert np.median(np.abs(radius - 1)) < 0.004
    # windows matched as planes lie inside by their mean sagitta, 0.0018 here
    assert abs(np.median(radius - 1)) < 0.0007
    assert np.mean(np.abs(radius - 1) < 0.02) > 0.97


def test_how_a_depth_map_bends_is_found_beside_an_edge_and_in_noise() -> None:
    v, u = np.mgrid[0:40, 0:60].astype(float)
    inverse = 0.2 * (1 + 0.003 * u - 0.002 * v + 0.5 * (0.0004 * u * u - 0.0002 * u * v + 0.0006 * v * v))
    depth = (1 / inverse).astype(np.float32)
    depth[:, 45:] *= 1.3
    depth[np.random.default_rng(1).random(depth.shape) < 0.2] = 0.0
    depth *= 1 + 1e-4 * np.random.default_rng(2).standard_normal(depth.shape).astype(np.float32)
    bent = np.ones((*depth.shape, 3), np.float32)
    fit_curvature(depth, depth > 0, bent, 0, 40)
    known = np.zeros_like(depth, bool)
    known[8:32, 10:41] = True
    known &= depth > 0
    found = bent[known] * (inverse / 0.2)[known][:, None]
    assert np.allclose(np.median(found, axis=0), [0.0004, -0.0001, 0.0006], atol=1e-5)
    assert np.quantile(np.abs(found - [0.0004, -0.0001, 0.0006]), 0.9) < 5e-5
    assert not bent[depth == 0].any()
    some, wanted = np.ones_like(bent), np.random.default_rng(3).random(depth.shape) < 0.1
    fit_curvature(depth, wanted, some, 0, 40)
    assert np.array_equal(some[wanted], bent[wanted])
    few = np.zeros((30, 30), np.float32)
    few[10:12, 10:12] = 1.0
    out = np.ones((30, 30, 3), np.float32)
    fit_curvature(few, few > 0, out, 0, 30)
    assert not out.any()


def test_normals_point_out_and_noise_is_stated_fairly(solved) -> None:  # type: ignore[no-untyped-def]
    _, points, _ = solved
    direction = points.xyz / np.linalg.norm(points.xyz, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip(np.einsum("ni,ni->n", direction, points.normal), -1, 1)))
    assert np.median(angle) < 12
    z = (np.linalg.norm(points.xyz, axis=1) - 1) / points.sigma
    assert 0.3 < np.median(np.abs(z)) / 0.6745 < 2.0


def test_visibility_lists_are_whole(solved) -> None:  # type: ignore[no-untyped-def]
    views, points, _ = solved
    count = np.diff(points.view_start)
    assert points.view_start[0] == 0 and points.view_start[-1] == len(points.view_index)
    assert count.min() >= 3 and points.view_index.max() < len(views)
    i = int(np.argmax(count))
    seen = points.view_index[points.view_start[i] : points.view_start[i + 1]]
    assert len(set(seen.tolist())) == len(seen)
    assert np.all((views.centres[seen] - points.xyz[i]) @ points.normal[i] > 0)


def of_five(calls: list[int], threads: int = 2, parts: Parts | None = None, most: int = 99) -> DensePoints:
    """Points of five views; a number in `calls` for each depth map that is made, and death after `most`."""
    views, images, seen = sphere_views(5)
    make = reconstruct._map

    def counted(*given: object) -> object:
        if len(calls) == most:
            raise Killed
        calls.append(1)
        return make(*given)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reconstruct, "_map", counted)
        options = DenseOptions(seed=3, threads=threads)
        return dense_points(views, lambda i: images[i], seen, options, parts=parts)[0]


class Killed(BaseException):
    pass


@pytest.fixture(scope="module")
def five() -> tuple[DensePoints, int]:
    """Points of five views, and of how many depth maps."""
    calls: list[int] = []
    return of_five(calls), len(calls)


def test_one_thread_and_two_give_the_same(five: tuple[DensePoints, int]) -> None:
    one, two = of_five([], threads=1), five[0]
    assert np.array_equal(one.xyz, two.xyz) and np.array_equal(one.sigma, two.sigma)


def test_depth_maps_that_were_done_survive_a_death(tmp_path: Path, five: tuple[DensePoints, int]) -> None:
    """One is damaged besides; the points are the same to the last bit."""
    whole, count = five
    with pytest.raises(Killed):
        of_five([], parts=Parts(tmp_path), most=3)
    kept = sorted(tmp_path.iterdir())
    assert len(kept) == 3 < count
    kept[0].write_bytes(kept[0].read_bytes()[:-1])
    calls: list[int] = []
    parts = Parts(tmp_path)
    again = of_five(calls, parts=parts)
    assert len(calls) == count - 2 and len(parts.damaged) == 1
    assert np.array_equal(again.xyz, whole.xyz) and np.array_equal(again.sigma, whole.sigma)


def test_a_surface_without_texture_is_not_invented() -> None:
    views, images, seen = sphere_views(5, flat=True)
    with pytest.raises(NotPossible, match="surface points agree"):
        dense_points(views, lambda i: images[i], seen)


def test_a_depth_is_kept_only_where_others_fit_worse() -> None:
    """A plane before a camera that moves along it: stripes along its path fit at any depth, spots at one."""
    size, focal, far, base = 96, 200.0, 5.0, 0.25
    K = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]])
    side = np.arange(-base, 2 * base, base)
    side = side[side != 0]
    v, u = np.mgrid[0:size, 0:size].astype(float)
    noise = np.random.default_rng(4)

    def grey(spots: bool, x: float) -> np.ndarray:
        across = (u + focal * x / far) / 1.7 if spots else 0.0
        seen = 120 + 25 * np.sin(v / 1.5) + 25 * np.sin(across + np.sin(across / 5)) + noise.normal(0, 0.5, v.shape)
        return seen.astype(np.float32)

    def kept(spots: bool) -> float:
        mask = np.full((size, size), 2, np.uint8)
        sources = np.stack([grey(spots, x) for x in side])
        shift = np.column_stack([-side, 0 * side, 0 * side])
        seen = Matching(
            grey(spots, 0), mask, K, sources, np.tile(K, (2, 1, 1)), np.tile(np.eye(3), (2, 1, 1)), shift, 0.5
        )
        sparse = np.array([[40.0, 40.0, 5.0], [60.0, 60.0, 5.0], [50.0, 30.0, 5.0]])
        with ThreadPoolExecutor(1) as pool:
            found = depth_map(seen, sparse, (4.0, 6.0), 1, pool)
        return float((found.depth[16:-16, 16:-16] > 0).mean())

    assert kept(spots=True) > 0.8
    assert kept(spots=False) < 0.35


def test_edges_of_shadows_that_move_are_not_matched(solved) -> None:  # type: ignore[no-untyped-def]
    views, images, seen = sphere_views()
    bright = len(solved[1].xyz)
    shaded = []
    for i, (image, mask) in enumerate(images):
        v, u = np.nonzero(mask)
        ray = (
            np.column_stack([(u - SIZE / 2 + 0.5) / FOCAL, (v - SIZE / 2 + 0.5) / FOCAL, np.ones(len(u))]) @ views.R[i]
        )
        centre = views.centres[i]
        b, q = ray @ centre, np.einsum("ij,ij->i", ray, ray)
        depth = (-b - np.sqrt(np.maximum(b * b - q * (centre @ centre - 1), 0))) / q
        dark = np.sin(10 * (centre[0] + ray[:, 0] * depth) + 0.8 * i) > 0.2
        image = image.copy()
        image[v[dark], u[dark]] //= 5
        shaded.append((image, mask))
    points = dense_points(views, lambda i: shaded[i], seen, DenseOptions(seed=3))[0]
    off = np.abs(np.linalg.norm(points.xyz, axis=1) - 1)
    assert len(points.xyz) > 0.85 * bright
    assert np.mean(off > 0.02) < 0.08


def test_poses_without_points_are_enough() -> None:
    views, images, _ = sphere_views()
    ball = SparsePoints.filling(np.array([0.1, 0.0, -0.1]), 1.3)
    points = dense_points(views, lambda i: images[i], ball, DenseOptions(seed=3))[0]
    off = np.abs(np.linalg.norm(points.xyz, axis=1) - 1)
    assert len(points.xyz) > 15_000
    assert np.mean(off > 0.02) < 0.08


def test_cells_in_white_frames_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = np.random.default_rng(5).standard_normal((260, 3))
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)

    def cells(p: np.ndarray) -> np.ndarray:
        near = np.sort(p @ corners.T, axis=1)
        return np.where(near[:, -1] - near[:, -2] < 0.012, 220.0, 70.0)

    monkeypatch.setattr(sys.modules[__name__], "texture", cells)
    views, images, seen = sphere_views()
    points = dense_points(views, lambda i: images[i], seen, DenseOptions(seed=3))[0]
    off = np.abs(np.linalg.norm(points.xyz, axis=1) - 1)
    assert len(points.xyz) > 2000
    assert np.mean(off > 0.05) < 0.05
    # in narrow windows there is nothing but one colour
    monkeypatch.setattr(reconstruct, "MUCH", 2.0)
    with pytest.raises(NotPossible, match="agree between views"):
        dense_points(views, lambda i: images[i], seen, DenseOptions(seed=3))


def test_further_views_ask_only_for_what_is_not_known() -> None:
    mask = np.zeros((40, 50), np.uint8)
    mask[5:35, 5:45] = 255
    v, u = np.mgrid[5:35, 5:25].reshape(2, -1)
    found = _unexplained(mask, np.column_stack([u, v]) + 0.2)
    assert np.all(found[mask == 0] == 0) and np.all(found[5:35, 5:25] == 1) and np.all(found[5:35, 25:45] == 2)
    views, _, seen = sphere_views(60, step=2.0)
    choice = select_views(views, seen)
    assert len(choice.reference) > 40 and choice.whole.sum() == 40
    assert np.array_equal(choice.reference[choice.whole], select_views(views, seen, 40).reference)


def test_sources_lie_at_useful_angles() -> None:
    views, _, seen = sphere_views(30, step=3.0)
    choice = select_views(views, seen, most=12)
    assert len(choice.reference) == 12
    for i, sources in zip(choice.reference, choice.sources, strict=True):
        cosine = views.R[sources][:, 2] @ views.R[i][2]
        angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        assert i not in sources and np.all((angle > 1) & (angle < 30))
    assert np.all(choice.depths[:, 0] < 4.0) and np.all(choice.depths[:, 1] > 4.2)


def test_a_view_placed_by_its_surroundings_is_matched_with_its_neighbours() -> None:
    """It shares next to none of the object's points with them, and those that it saw do not bound its depths."""
    views, _, seen = sphere_views(30, step=12.0)
    mine = np.flatnonzero(seen.obs_view == 7)
    kept = ~np.isin(np.arange(len(seen.obs_view)), mine[3:])
    few = seen._replace(obs_view=seen.obs_view[kept], obs_point=seen.obs_point[kept])
    choice = select_views(views, few)
    k = int(np.flatnonzero(choice.reference == 7)[0])
    angle = np.degrees(np.arccos(np.clip(views.R[choice.sources[k]][:, 2] @ views.R[7][2], -1, 1)))
    assert len(angle) >= 2 and (angle < 40).all()
    assert choice.depths[k, 0] < 4.0 and choice.depths[k, 1] > 4.2


def test_views_without_partners_are_said() -> None:
    views, images, seen = sphere_views(3, step=60.0)
    with pytest.raises(NotPossible, match="too few views"):
        dense_points(views, lambda i: images[i], seen)


def test_crop_keeps_the_rays() -> None:
    colour, mask = np.zeros((100, 120, 3), np.uint8), np.zeros((100, 120), np.uint8)
    mask[30:70, 40:90] = 255
    K = np.array([[200.0, 0, 60], [0, 200, 50], [0, 0, 1]])
    cut = crop(colour, mask, K, 0.5)
    v, u = np.nonzero(cut.mask)
    ray = ((u.mean() - cut.K[0, 2]) / cut.K[0, 0], (v.mean() - cut.K[1, 2]) / cut.K[1, 1])
    assert ray == pytest.approx(((64.5 - 60) / 200, (49.5 - 50) / 200), abs=0.006)


def test_noise_is_measured_through_texture() -> None:
    rng = np.random.default_rng(0)
    smooth = 100 + 40 * np.sin(np.mgrid[0:80, 0:80][0] / 9.0)
    measured = grey_noise(
        (smooth + 3.0 * rng.standard_normal((80, 80))).astype(np.float32), np.ones((80, 80), np.uint8)
    )
    assert measured == pytest.approx(3.0, rel=0.25)


def test_the_kernels_are_one_piece_of_machine_code_each() -> None:
    """Else what runs after compiling is not what the cache holds, and a second run differs in its last digits."""
    from numba.core.caching import NullCache
    from numba.core.dispatcher import Dispatcher

    from massprops.dense import patchmatch

    compiled = {k: f for k, f in vars(patchmatch).items() if isinstance(f, Dispatcher)}
    cached = {k for k, f in compiled.items() if not isinstance(f._cache, NullCache)}
    assert cached == {"sweep", "polish"}
    assert not any(f.targetoptions.get("parallel") for f in compiled.values())
    assert all(f.targetoptions.get("inline") == "always" for k, f in compiled.items() if k not in cached)


def test_a_look_up_gives_a_pixel_and_the_next_one() -> None:
    images = np.random.default_rng(6).random((2, 3, 5)).astype(np.float32)
    both = paired(images).view(np.float32).reshape(2, 3, 5, 2)
    assert np.array_equal(both[..., 0], images) and np.array_equal(both[..., :-1, 1], images[..., 1:])


def test_noise_is_taken_out_where_there_is_much_of_it():
    rng = np.random.default_rng(5)
    mask = np.full((80, 100), 255, np.uint8)
    some, much = (100 + s * rng.standard_normal(mask.shape).astype(np.float32) for s in (4.0, 20.0))
    same, noise = denoised(some, mask)
    assert same is some and noise == pytest.approx(4.0, rel=0.15)
    calm, noise = denoised(much, mask)
    assert calm[10:-10, 10:-10].std() == pytest.approx(noise, rel=0.15) and noise < 7.0
