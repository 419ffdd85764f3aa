"""Unmeasured parts that lie farther out here and less far there, and what the motion makes of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from massprops.consistency.fusion import agreement, fuse, measured, read_draws
from massprops.consistency.mesh_side import read_mesh_side
from massprops.consistency.replicates import read_replicates
from massprops.mass.document import document
from massprops.mass.integrals import mesh_integrals, offset_response
from massprops.mass.properties import mass_properties
from massprops.mass.ratio_space import chi_square, log_components, p_value
from massprops.surface.error_modes import fill_modes


def partly_seen(seed: int, share: float = 0.67) -> tuple[trimesh.Trimesh, np.ndarray, trimesh.Trimesh]:
    """A mesh, which of its faces were measured, and the true body, which bulges where nothing was."""
    rng = np.random.default_rng(seed)
    mesh = trimesh.creation.icosphere(subdivisions=3)
    v = np.array(mesh.vertices) * [1.0, 0.75, 0.5]
    v *= 1 + 0.15 * np.sin(2.5 * v @ rng.standard_normal(3))[:, None]
    way = rng.standard_normal(3)
    along = v @ way / np.linalg.norm(way)
    hidden = along > np.quantile(along, share)
    away = np.where(hidden, cKDTree(v[~hidden]).query(v)[0], 0.0)
    bulge = 0.5 * away * (0.6 * rng.choice([-1, 1]) + 0.6 * np.sin(4 * v @ rng.standard_normal(3)))
    ours = trimesh.Trimesh(v, mesh.faces, process=False)
    true = trimesh.Trimesh(v + bulge[:, None] * ours.vertex_normals, mesh.faces, process=False)
    return ours, ~hidden[mesh.faces].any(axis=1), true


def make_run(folder: Path, mesh: trimesh.Trimesh, observed: np.ndarray) -> Path:
    """What the cross-check reads of a run, with replicates as the surface stage draws them, and a thousandth besides."""
    v, f = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    surface = {"observed_fraction": float(observed.mean())}
    content = document(mass_properties(mesh, 1000.0), {}, {"source": "given"}, surface, [])
    (folder / "work" / "surface").mkdir(parents=True)
    (folder / "work" / "scale").mkdir()
    (folder / "massprops.json").write_text(json.dumps(content))
    (folder / "work" / "scale" / "scale.json").write_text('{"source": "baseline", "metres_per_unit": 1.0}')
    rng, modes = np.random.default_rng(1), fill_modes(v, f, observed, 2.0)
    rows = mesh_integrals(v, f) * (1 + 1e-3 * rng.standard_normal((400, 1)))
    rows += rng.standard_normal((400, len(modes))) @ (modes @ offset_response(v, f))
    np.savez(
        folder / "work" / "surface" / "surface.npz",
        vertices=v, faces=f, observed=observed, replicate_integrals=rows, replicate_length=np.full(400, 2.0),
    )  # fmt: skip
    return folder


def test_a_wrong_fill_is_no_contradiction_and_the_motion_corrects_it(tmp_path: Path) -> None:
    plain, together, p = [], [], []
    for seed in range(6):
        ours, observed, true = partly_seen(seed)
        mesh = read_mesh_side(make_run(tmp_path / str(seed), ours, observed))
        target = mass_properties(true, 1000.0)
        y, sharp = log_components(target.inertia, mesh.axes), np.diag([2e-3, 2e-3, 5e-4, 5e-4, 5e-4]) ** 2
        p.append(p_value(*chi_square(y - log_components(mesh.inertia, mesh.axes), mesh.covariance + sharp)))
        draws = read_draws(tmp_path / str(seed), mesh)
        assert draws is not None
        motion = measured(y, sharp, target.center_of_mass, 1e-3**2 * np.eye(3))
        p.append(agreement(draws, motion, 2.0))
        both = fuse(draws, mesh, motion)
        plain.append(np.abs(np.array(mesh.document["principal_moments"]) / target.principal_moments - 1).mean())
        together.append(np.abs(np.array(both["principal_moments"]) / target.principal_moments - 1).mean())
    assert np.mean(together) < 0.3 * np.mean(plain) and np.mean(plain) > 0.02
    assert np.min(p) > 1e-3


def test_a_hidden_mass_moves_centre_and_inertia_as_no_fill_does(tmp_path: Path) -> None:
    for seed in range(3):
        ours, observed, _ = partly_seen(seed, share=0.85)
        mesh = read_mesh_side(make_run(tmp_path / str(seed), ours, observed))
        draws = read_draws(tmp_path / str(seed), mesh)
        place, share = np.array([0.4, 0.2, 0.1]), 0.08 / 1.08
        point = share * (place @ place * np.eye(3) - np.outer(place, place))
        heavy = np.array(mesh.document["inertia"]) / mesh.document["mass"] + point
        y, sharp = log_components(heavy, mesh.axes), np.diag([2e-3, 2e-3, 5e-4, 5e-4, 5e-4]) ** 2
        centre = mesh.centre + share * place, 1e-3**2 * np.eye(3)
        assert draws is not None
        assert agreement(draws, measured(y, sharp, *centre), 2.0) < 1e-4
        same = measured(log_components(mesh.inertia, mesh.axes), sharp, mesh.centre, centre[1])
        assert agreement(draws, same, 2.0) > 0.9


def test_intervals_without_ends_count_as_none(tmp_path: Path) -> None:
    ours, observed, _ = partly_seen(1)
    run = make_run(tmp_path, ours, observed)
    content = json.loads((run / "massprops.json").read_text())
    content["interval_90"] = {"k1": [None, None], "k2": [-0.2, -0.1]}
    (run / "massprops.json").write_text(json.dumps(content))
    assert np.isfinite(read_mesh_side(run).covariance).all()


def test_a_run_without_replicates_has_none(tmp_path: Path) -> None:
    assert read_replicates(tmp_path) is None


def test_what_was_filled_in_may_carry_the_centre_of_mass_as_far_as_its_gap_is_wide(tmp_path: Path) -> None:
    """A slab measured but for one end: that it ends half as far out, or reaches as far in, is no density; another way, it would be."""
    slab = trimesh.creation.box(extents=(4.0, 1.0, 1.0)).subdivide_to_size(0.2)
    open_end = slab.triangles_center[:, 0] > 1.999
    side = read_mesh_side(make_run(tmp_path / "a", slab, ~open_end))
    # the end's middle is half a width from what was measured, and its faces a third of that on average
    reach = 2.0 * 1.0 * (1.0 / 6.0) / 4.0
    assert np.abs(side.fill[:, 0]).sum() == pytest.approx(reach, rel=0.1)
    assert side.fill_reaches(side.centre + [0.8 * reach, 0, 0]) and side.fill_reaches(side.centre - [0.8 * reach, 0, 0])
    assert not side.fill_reaches(side.centre + [1.3 * reach, 0, 0])
    assert not side.fill_reaches(side.centre + [0, 0.8 * reach, 0])
    every = read_mesh_side(make_run(tmp_path / "b", slab, np.ones(len(slab.faces), bool)))
    assert not len(every.fill) and not every.fill_reaches(every.centre + [1e-6, 0, 0])
