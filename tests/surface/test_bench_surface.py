"""Benchmark of the surface on ideal dense points: truth, ours, error. Run with `-m bench -s`."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from synthetic_dense import asteroid, cameras, observe, spacecraft, sphere_directions

from massprops.mass.integrals import greatest_length, mesh_integrals
from massprops.mass.intervals import intervals
from massprops.mass.properties import properties_of_integrals
from massprops.surface.reconstruct import reconstruct_surface
from massprops.surface.spread import ErrorSources, replicates

CASES = {
    "asteroid, all round": (asteroid, -2.0, 0.01, 0.025),
    "spacecraft, all round": (spacecraft, -2.0, 0.01, 0.025),
    "asteroid, one side little seen": (asteroid, -0.15, 0.02, 0.04),
}


@pytest.mark.bench
@pytest.mark.parametrize("name", CASES)
def test_bench_surface(name):
    body, above, volume_limit, moment_limit = CASES[name]
    mesh = body()
    directions = sphere_directions(60)
    axis = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
    views = cameras(directions[directions @ axis > above], 3.0, 780)
    cloud, masks = observe(mesh, views, 0.001, 1)
    surface = reconstruct_surface(views, masks, cloud, points=40_000)
    truth = properties_of_integrals(mesh_integrals(mesh.vertices, mesh.faces), 1.0)
    ours = properties_of_integrals(mesh_integrals(surface.vertices, surface.faces), 1.0)
    bound = intervals(replicates(surface, len(views), ErrorSources(0.002))[0], ours)
    volume = ours.volume / truth.volume - 1
    moments = ours.principal_moments / truth.principal_moments - 1
    solid = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    sample, face = trimesh.sample.sample_surface(solid, 3000, seed=1)
    distance = trimesh.proximity.closest_point(mesh, sample[surface.observed[face]])[1]
    median = float(np.median(distance)) / greatest_length(mesh.vertices)[0]
    interval = 100 * (np.array(bound["volume"]) / truth.volume - 1)
    print(
        f"\n{name}: volume truth {truth.volume:.6f} ours {ours.volume:.6f} error {100 * volume:+.2f} % "
        f"interval {np.round(interval, 2)} %; moments {np.round(100 * moments, 2)} %; "
        f"k1 {ours.k1 - truth.k1:+.4f} k2 {ours.k2 - truth.k2:+.4f}; median distance {100 * median:.3f} % of length; "
        f"measured {100 * surface.observed.mean():.0f} % of faces"
    )
    assert solid.is_volume
    assert abs(volume) < volume_limit and (np.abs(moments) < moment_limit).all()
    assert abs(ours.k1 - truth.k1) < 0.01 and abs(ours.k2 - truth.k2) < 0.01
    assert median < 0.0015
