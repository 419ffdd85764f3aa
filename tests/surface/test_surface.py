"""The surface from points and silhouettes of bodies whose volume is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from synthetic_dense import boxes, cameras, observe, sphere_directions

from massprops.errors import NotPossible
from massprops.mass.integrals import greatest_length, mesh_integrals
from massprops.mass.intervals import intervals
from massprops.mass.properties import mass_properties, properties_of_integrals
from massprops.run.stages.surface import integrals_of_body, lost_share
from massprops.surface.cloud import Cloud
from massprops.surface.cut import manifold, surface_faces
from massprops.surface.error_modes import fill_modes, measured_modes
from massprops.surface.reconstruct import FILLED, STRETCHED, Surface, reconstruct_surface
from massprops.surface.refine import least_area, membrane
from massprops.surface.spread import ErrorSources, Joint, deform, replicates
from massprops.surface.tetra import tetrahedralise

POINTS = 6000
SIZE, FOCAL = (180, 135), 345.0


def build(
    mesh: trimesh.Trimesh, above: float = -2.0, seed: int = 1, noise: float = 0.001, count: int = 36
) -> tuple[Surface, int]:
    """Surface of a body seen from those of `count` directions whose height is over `above`."""
    directions = sphere_directions(count)
    views = cameras(directions[directions[:, 2] > above], 3.0, FOCAL, SIZE)
    cloud, masks = observe(mesh, views, noise, seed, most=75_000)
    return reconstruct_surface(views, masks, cloud, points=POINTS, seed=seed), len(views)


@pytest.fixture(scope="module")
def seen_all_round() -> tuple[Surface, int]:
    return build(trimesh.creation.icosphere(5, radius=0.5))


@pytest.fixture(scope="module")
def seen_from_above() -> tuple[Surface, int]:
    return build(trimesh.creation.icosphere(5, radius=0.5), above=0.5)


def solid(surface: Surface) -> trimesh.Trimesh:
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False)


def observed_fraction(surface: Surface) -> float:
    area = solid(surface).area_faces
    return float(area[surface.observed].sum() / area.sum())


def test_sphere_is_closed_one_body_and_unbiased(seen_all_round):
    surface, _ = seen_all_round
    mesh = solid(surface)
    assert mesh.is_volume and mesh.body_count == 1
    assert mesh.volume == pytest.approx(4 / 3 * np.pi / 8, rel=0.004)
    assert abs(np.median(np.linalg.norm(surface.vertices, axis=1)) - 0.5) < 0.0005
    assert observed_fraction(surface) > 0.98


def test_a_plate_of_one_percent_is_kept():
    plate = boxes(((0.9, 0.45, 0.01), (0, 0, 0)))
    surface, _ = build(plate, noise=0.0007)
    mesh = solid(surface)
    assert mesh.is_volume and mesh.body_count == 1
    assert mesh.volume == pytest.approx(plate.volume, rel=0.06)
    assert np.ptp(mesh.vertices, axis=0)[:2] == pytest.approx([0.9, 0.45], abs=0.012)


def test_unseen_side_is_filled_and_flagged(seen_from_above):
    surface, _ = seen_from_above
    mesh = solid(surface)
    assert mesh.is_volume and mesh.body_count == 1
    assert 0.45 < observed_fraction(surface) < 0.92
    height = mesh.triangles_center[:, 2]
    assert surface.observed[height > 0.0].mean() > 0.97
    assert not surface.observed[height < -0.42].any()


def test_an_unseen_base_of_a_still_object_is_a_film_and_not_the_hulls_cone():
    dome = trimesh.creation.icosphere(4, radius=0.5).slice_plane([0, 0, 0], [0, 0, 1], cap=True)
    views = cameras((d := sphere_directions(60))[d[:, 2] > 0.4], 3.0, FOCAL, SIZE)
    cloud, masks = observe(dome, views, 0.001, 1, most=75_000)
    cloud = cloud.take(np.flatnonzero(cloud.xyz[:, 2] > 0.02))
    filled, stretched = (
        solid(reconstruct_surface(views, masks, cloud, POINTS, 1, moving=False, fill=fill))
        for fill in (FILLED, STRETCHED)
    )
    assert filled.vertices[:, 2].min() < -0.08
    assert stretched.vertices[:, 2].min() > -0.03
    assert abs(stretched.volume - dome.volume) < 0.5 * abs(filled.volume - dome.volume)


def test_interval_holds_truth_and_widens_with_the_unseen_part(seen_all_round, seen_from_above):
    truth = 4 / 3 * np.pi / 8
    widths = []
    for surface, views in (seen_all_round, seen_from_above):
        rows, lengths = replicates(surface, views, ErrorSources(0.002), seed=3)
        assert (lengths > 0).all()
        estimate = properties_of_integrals(mesh_integrals(surface.vertices, surface.faces), 1.0)
        low, high = intervals(rows, estimate)["volume"]
        assert low <= truth <= high
        widths.append(high - low)
    assert widths[1] > 1.5 * widths[0]
    assert widths[0] < 0.16 * truth


def test_replicates_reach_in_and_hardly_below_what_the_body_was_closed_at(seen_from_above):
    surface, views = seen_from_above
    own = mesh_integrals(surface.vertices, surface.faces)[0]
    closed = replace(surface, inferred=~surface.observed)
    filled, below = (replicates(s, views, ErrorSources(), seed=3)[0][:, 0] / own - 1 for s in (surface, closed))
    assert abs(np.median(filled)) < 0.02 and np.median(below) < -0.02
    assert np.quantile(below, 0.95) < 0.25 * np.quantile(filled, 0.95)


def test_replicates_follow_the_seed(seen_all_round):
    surface, views = seen_all_round
    one, two, other = (replicates(surface, views, ErrorSources(0.002), count=20, seed=s)[0] for s in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert not np.allclose(one, other, rtol=1e-6)


def test_same_seed_gives_the_same_mesh():
    mesh = boxes(((0.6, 0.4, 0.3), (0, 0, 0)))
    (a, _), (b, _) = build(mesh, count=14), build(mesh, count=14)
    np.testing.assert_array_equal(a.faces, b.faces)
    np.testing.assert_array_equal(a.vertices, b.vertices)


def test_one_wrong_silhouette_does_not_carve():
    mesh = boxes(((0.6, 0.4, 0.3), (0, 0, 0)))
    views = cameras(sphere_directions(36), 3.0, FOCAL, SIZE)
    cloud, masks = observe(mesh, views, 0.001, 1, most=75_000)
    for i in (3, 20):
        masks[i] = masks[i].copy()
        masks[i][:, : masks[i].shape[1] // 2] = 0
    surface = reconstruct_surface(views, masks, cloud, points=POINTS)
    assert solid(surface).volume == pytest.approx(mesh.volume, rel=0.01)


def test_points_that_several_views_see_against_the_sky_are_dropped():
    views = cameras(sphere_directions(36), 3.0, FOCAL, SIZE)
    cloud, masks = observe(trimesh.creation.icosphere(5, radius=0.5), views, 0.001, 1, most=75_000)
    rng = np.random.default_rng(0)
    stray = np.flatnonzero(cloud.xyz[:, 2] > 0.49)
    stray = rng.choice(stray, min(len(stray), len(cloud) // 200), replace=False)
    xyz = cloud.xyz.copy()
    xyz[stray] += [0, 0, 0.06]
    wrong = Cloud(xyz, cloud.normal, cloud.sigma, cloud.view_start, cloud.view_index)
    surface = reconstruct_surface(views, masks, wrong, points=POINTS, seed=1)
    assert len(stray) > 30 and surface.vertices[:, 2].max() < 0.53


def test_fill_is_uncertain_in_proportion_to_the_distance_from_measured_surface(seen_from_above):
    surface, _ = seen_from_above
    modes = fill_modes(surface.vertices, surface.faces, surface.observed, 1.0)
    assert len(modes) > 5 and not modes[:, surface.observed].any()
    sigma = np.sqrt((modes**2).sum(0))[~surface.observed]
    middle = surface.vertices[surface.faces].mean(1)[~surface.observed]
    rim, pole = sigma[middle[:, 2] > -0.05], sigma[middle[:, 2] < -0.45]
    assert len(rim) and len(pole) and pole.min() > 2 * np.median(rim)


def test_two_sides_of_a_plate_err_apart():
    mesh = boxes(((1.0, 0.6, 0.02), (0, 0, 0))).subdivide().subdivide().subdivide()
    modes = measured_modes(
        mesh.vertices, mesh.faces, np.ones(len(mesh.faces), bool), 1.17, np.full(len(mesh.faces), 0.003)
    )
    top, bottom = (mesh.face_normals[:, 2] * sign > 0.9 for sign in (1, -1))
    covariance = (modes[:, top] @ mesh.area_faces[top]) @ (modes[:, bottom] @ mesh.area_faces[bottom])
    own = np.sum((modes[:, top] @ mesh.area_faces[top]) ** 2)
    assert abs(covariance) < 0.05 * own
    np.testing.assert_allclose(np.sqrt((modes**2).sum(0)), 0.003)


def test_points_that_scatter_leave_the_volume_more_uncertain(seen_all_round):
    surface, views = seen_all_round
    rng = np.random.default_rng(5)
    cloud = surface.cloud
    pixel = surface.hull.pixel
    # half of a pixel either way: their middle, and so the surface, stays
    apart = 0.5 * pixel * rng.choice([-1.0, 1.0], len(cloud))
    loose = replace(cloud, xyz=cloud.xyz + apart[:, None] * cloud.normal, sigma=np.full(len(cloud), 0.5 * pixel))
    spread = [replicates(s, views, ErrorSources())[0][:, 0].std() for s in (surface, replace(surface, cloud=loose))]
    area = solid(surface).area
    assert spread[0] < 0.35 * pixel * area
    assert 0.45 * pixel * area < spread[1] < 0.8 * pixel * area


@pytest.mark.usefixtures("scatter_once")
def test_a_placement_that_may_lie_elsewhere_carries_its_side_with_it(seen_all_round):
    """All views moved together move the body and leave its volume; those of one half make it thicker or thinner."""
    surface, views = seen_all_round
    sigma = np.diag([0.0, 0, 0, 0, 0, 0.05**2])

    def rows(first, last):
        return replicates(surface, views, ErrorSources(joints=[Joint(first, last, np.zeros(3), sigma)]))[0]

    none, whole = rows(views, 2 * views), rows(0, views - 1)
    height, volume = (lambda r: (r[:, 3] / r[:, 0]).std()), (lambda r: r[:, 0].std() / r[:, 0].mean())
    assert height(none) < 0.01 and abs(height(whole) - 0.05) < 0.01
    assert abs(volume(whole) - volume(none)) < 0.1 * volume(none)
    above = np.zeros(views)
    point = np.repeat(np.arange(len(surface.cloud)), np.diff(surface.cloud.view_start))
    np.add.at(above, surface.cloud.view_index, surface.cloud.normal[point, 2])
    order = np.argsort(above)
    number = np.empty(views, int)
    number[order] = np.arange(views)
    sorted_ = replace(surface, cloud=replace(surface.cloud, view_index=number[surface.cloud.view_index]))
    half = replicates(sorted_, views, ErrorSources(joints=[Joint(views // 2, views - 1, np.zeros(3), sigma)]))[0]
    assert volume(half) > 1.5 * volume(none)


def test_nothing_is_uncertain_about_a_fill_where_all_was_measured(seen_all_round):
    surface, _ = seen_all_round
    every = np.ones(len(surface.faces), bool)
    assert len(fill_modes(surface.vertices, surface.faces, every, 1.0)) == 0
    unseen = fill_modes(surface.vertices, surface.faces, ~every, 1.0)
    assert len(unseen) and np.isfinite(unseen).all() and (unseen != 0).any()


def test_deform_is_the_deformed_mesh():
    mesh = trimesh.creation.icosphere(2)
    mesh.vertices = mesh.vertices * [1, 2, 3] + [5, 0, 1]
    strain = np.array([[0.01, 0.004, 0], [0.004, -0.02, 0.003], [0, 0.003, 0.005]])
    middle = mass_properties(mesh).center_of_mass
    moved = middle + (mesh.vertices - middle) @ (np.eye(3) + strain)
    row = deform(mesh_integrals(mesh.vertices, mesh.faces)[None], strain[None])[0]
    np.testing.assert_allclose(row, mesh_integrals(moved, mesh.faces), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_border_of_any_labels_is_closed(seed):
    rng = np.random.default_rng(seed)
    tetra = tetrahedralise(rng.random((300, 3)))
    inner = (np.abs(tetra.points[tetra.corners].mean(1) - 0.5) < 0.35).all(1)
    label = manifold(tetra, inner & (rng.random(len(inner)) < 0.7))
    mesh = trimesh.Trimesh(tetra.points, surface_faces(tetra, label), process=False)
    mesh.remove_unreferenced_vertices()
    assert mesh.is_volume and mesh.volume == pytest.approx(tetra.volume[label].sum())


def test_areas_of_facets_and_tetrahedra_about_a_point() -> None:
    tetra = tetrahedralise(np.random.default_rng(8).random((60, 3)))
    start, about = tetra.incidence
    assert np.array_equal(
        tetra.corners.ravel()[np.argsort(tetra.corners.ravel(), kind="stable")],
        np.repeat(np.arange(60), np.diff(start)),
    )
    assert all(p in tetra.corners[t] for p in range(60) for t in about[start[p] : start[p + 1]])
    for k in range(4):
        a, b, c = (tetra.points[tetra.corners[:, j]] for j in range(4) if j != k)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        np.testing.assert_allclose(tetra.facet_area[:, k], area, rtol=1e-12)


def test_a_pinched_edge_is_closed_on_its_narrow_side_alone():
    """Two parts meet at an edge, 50 degrees apart on one side and 230 on the other."""
    angle = np.deg2rad([0, 40, 90, 130, 180, 230, 280, 320])
    ring = 2.0 * np.column_stack([np.cos(angle), np.sin(angle), 0.01 * np.arange(8)])
    far = 30.0 * np.concatenate([np.eye(3), -np.eye(3)]) @ Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix()
    tetra = tetrahedralise(np.concatenate([[[0, 0, -0.5], [0, 0, 0.5]], ring, far]))
    about = {tuple(c[2:]): t for t, c in enumerate(np.sort(tetra.corners, axis=1).tolist()) if c[:2] == [0, 1]}
    assert len(about) == 8, "one tetrahedron for each step of the ring"
    label = np.zeros(len(tetra.corners), bool)
    label[[about[2, 3], about[4, 5]]] = True
    closed = manifold(tetra, label)
    assert np.flatnonzero(closed).tolist() == sorted([about[2, 3], about[3, 4], about[4, 5]])


@pytest.mark.parametrize("seed", range(4))
def test_no_pinched_edge_is_thickened_by_what_reaches_out(seed):
    """Far points hold the space about a body: a tetrahedron with one of them would be a needle."""
    rng = np.random.default_rng(seed)
    far = 3 * rng.standard_normal((40, 3))
    tetra = tetrahedralise(np.concatenate([rng.random((300, 3)), 0.5 + far / np.linalg.norm(far, axis=1)[:, None] * 3]))
    out = (tetra.corners >= 300).any(1)
    # ragged up to the very border, where the far points begin
    label = manifold(tetra, ~out & (rng.random(len(out)) < 0.6), out)
    assert not label[out].any()
    mesh = trimesh.Trimesh(tetra.points, surface_faces(tetra, label), process=False)
    mesh.remove_unreferenced_vertices()
    assert mesh.is_volume and mesh.volume == pytest.approx(tetra.volume[label].sum())


@pytest.mark.parametrize("count", [0, 50])
def test_too_few_points_say_so(count):
    views = cameras(sphere_directions(6), 3.0, 600)
    start = np.arange(count + 1)
    normal = np.tile([0.0, 0, 1], (count, 1))
    cloud = Cloud(np.zeros((count, 3)), normal, np.full(count, 0.01), start, np.zeros(count, int))
    with pytest.raises(NotPossible, match="dense points"):
        reconstruct_surface(views, [np.full((240, 320), 255, np.uint8)] * 6, cloud)


def test_greatest_length_of_the_surface(seen_all_round):
    assert greatest_length(seen_all_round[0].vertices)[0] == pytest.approx(1.0, abs=0.006)


def test_membrane_is_flat_over_a_flat_rim():
    mesh = trimesh.creation.icosphere(3)
    fixed = mesh.vertices[:, 2] > -0.5
    film = membrane(np.asarray(mesh.vertices), np.asarray(mesh.faces), fixed)
    np.testing.assert_array_equal(film[fixed], mesh.vertices[fixed])
    rim = mesh.vertices[fixed][:, 2].min()
    assert film[~fixed][:, 2].min() >= rim - 1e-6
    assert np.abs(film[~fixed][:, 2] - rim).max() < 0.1


def test_the_film_of_least_area_between_two_rings_is_a_catenoid():
    """Rings of radius 1 at a distance of 0.5: the waist a of a cosh(0.25 / a) = 1 is 0.968 (Euler 1744)."""
    around, levels = 60, 31
    angle, z = np.meshgrid(np.linspace(0, 2 * np.pi, around, endpoint=False), np.linspace(-0.25, 0.25, levels))
    vertices = np.column_stack([np.cos(angle).ravel(), np.sin(angle).ravel(), z.ravel()])
    i, j = np.meshgrid(np.arange(levels - 1), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    quads = np.stack([a, b, b + around, a + around], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    rings = np.abs(vertices[:, 2]) > 0.249
    film = least_area(vertices, faces, rings)
    np.testing.assert_array_equal(film[rings], vertices[rings])
    assert np.hypot(film[:, 0], film[:, 1]).min() == pytest.approx(0.968, abs=0.015)
    membranes = membrane(vertices, faces, rings)
    assert np.hypot(membranes[:, 0], membranes[:, 1]).min() < 0.5, "and not a membrane by its triangles"


def test_a_mesh_that_folds_over_itself_is_no_body():
    """A box, and a longer bar within it that is wound inward."""
    outer, inner = trimesh.creation.box((1.0, 1.0, 1.0)), trimesh.creation.box((4.0, 0.3, 0.3))
    inner.invert()
    assert integrals_of_body(outer.vertices, outer.faces)[0] == pytest.approx(1.0)
    folded = trimesh.util.concatenate([outer, inner])
    assert folded.volume > 0.5
    with pytest.raises(NotPossible, match="folds over itself"):
        integrals_of_body(folded.vertices, folded.faces)


def test_a_part_that_the_mesh_lost_is_noticed():
    whole = boxes(((0.6, 0.4, 0.3), (0, 0, 0)), ((0.6, 0.4, 0.05), (2, 0, 0)))
    points = whole.sample(4000, seed=1)
    rest = boxes(((0.6, 0.4, 0.3), (0, 0, 0))).subdivide().subdivide().subdivide().subdivide()
    assert lost_share(rest.vertices, points, 0.2) > 0.3
    assert lost_share(rest.vertices, points[points[:, 0] < 1], 0.2) == 0.0
