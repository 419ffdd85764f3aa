"""Bodies as a tumbling before one lit camera would measure them, and what the motion says of them: without images, in
a second each.

The shape is measured where the motion shows it lit; there it is off by patches of one side, by one common offset, by a bent
focal length. What is never shown is closed by a membrane, as smooth as its rim allows, so the error of the fill is that of a
real shape and not one drawn from the model that `massprops.surface.error_modes` has of it. The motion's ratios, axes and
centre are off by more than they state: squared errors of attitudes from images are about twice their covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.sparse import identity
from scipy.sparse.linalg import spsolve

from massprops.consistency.fusion import Draws, Measured, measured, ten_numbers, with_floor, with_own_size
from massprops.consistency.mesh_side import SHAPE_FLOOR, MeshSide
from massprops.dynamics.quaternion import rotation_matrix
from massprops.mass.document import document
from massprops.mass.integrals import central_inertia, greatest_length, mesh_integrals, offset_response
from massprops.mass.intervals import intervals, scaled_replicates, valid_bodies
from massprops.mass.properties import MassProperties, mass_properties, properties_of_integrals
from massprops.mass.ratio_space import covariance_of_replicates, log_components
from massprops.simulation.motion import tumbling
from massprops.simulation.scenario import load_scenario
from massprops.surface.error_modes import SIDE_PIXELS, fill_modes, measured_modes
from massprops.surface.refine import mean_matrix
from massprops.surface.spread import BIAS_PIXELS, deform

PIXELS = 0.85 * 360
"""Length of the body in the images [px]."""
FOCAL_SIGMA = 0.002
FILL = (0.3, 1.5)
"""How far a fill goes from the membrane (0) to the real shape (1) and beyond it."""
OVERCONFIDENT = 1.5
"""Errors of the motion over what it states."""


@dataclass(frozen=True)
class Body:
    """One body: what is true, what the mesh says, and what the motion says.

    Attributes:
        true: of the real shape, in the mesh's axes.
        side: the mesh's side, with its document and 90 % intervals; draws: its replicates.
        motion: what the cross-check is given.
        observed: share of the surface that was measured; length: of the body.
    """

    true: MassProperties
    side: MeshSide
    draws: Draws
    motion: Measured
    observed: float
    length: float


def real_shape(seed: int, rng: np.random.Generator) -> trimesh.Trimesh:
    """An asteroid or a spacecraft, stretched along each axis, with faces small against its features."""
    mesh = trimesh.load(load_scenario(("asteroid", "spacecraft")[seed % 2]).mesh, force="mesh")
    mesh.merge_vertices()
    longest = greatest_length(np.asarray(mesh.vertices))[0]
    v, f = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, longest / 30)
    out = trimesh.Trimesh(v * rng.uniform(0.75, 1.3, 3), f, process=True)
    out.apply_translation(-out.center_mass)
    return out


def shown(mesh: trimesh.Trimesh, seed: int, phase: float, inertia: np.ndarray, length: float) -> np.ndarray:
    """(f,) faces that turn to the camera and the Sun in three frames or more."""
    scenario = load_scenario("asteroid", seed=seed, frames=64, size=(480, 360), rate_deg=5.5, sun_phase_deg=phase)
    path = tumbling(scenario, inertia, length, np.zeros(3))
    view = -np.einsum("nji,nj->ni", rotation_matrix(path.q), path.position)
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    lit = (view @ mesh.face_normals.T > np.cos(np.radians(65))) & (path.sun @ mesh.face_normals.T > 0.1)
    out: np.ndarray = lit.sum(axis=0) >= 3
    return out


def closed_by_membrane(mesh: trimesh.Trimesh, observed: np.ndarray) -> np.ndarray:
    """(v, 3) vertices, those that touch no measured face at the mean of their neighbours."""
    fixed = np.zeros(len(mesh.vertices), bool)
    fixed[mesh.faces[observed]] = True
    out = np.array(mesh.vertices)
    free = np.flatnonzero(~fixed)
    if len(free) and fixed.any():
        A = (identity(len(out)) - mean_matrix(mesh.faces, len(out))).tocsc()
        out[free] = spsolve(A[free][:, free], -(A[free][:, np.flatnonzero(fixed)] @ out[fixed]))
    return out


def moved(mesh: trimesh.Trimesh, offset: np.ndarray) -> np.ndarray:
    """(v, 3) vertices moved outward by the mean offset (f,) of the faces about them."""
    total = np.zeros(len(mesh.vertices))
    np.add.at(total, mesh.faces, (offset * mesh.area_faces)[:, None])
    area = np.zeros(len(mesh.vertices))
    np.add.at(area, mesh.faces, mesh.area_faces[:, None])
    return np.asarray(mesh.vertices) + (total / area)[:, None] * np.asarray(mesh.vertex_normals)


def make_body(seed: int, low_sun: bool) -> Body:
    """One body; a low Sun leaves a third of it unseen.

    Args:
        seed: even for an asteroid, odd for a spacecraft.
    """
    rng = np.random.default_rng([seed, 77])
    truth = real_shape(seed, rng)
    length = greatest_length(np.asarray(truth.vertices))[0]
    true = mass_properties(truth, 1000.0)
    observed = shown(truth, seed, 45.0 if low_sun else 15.0 + 20.0 * rng.random(), true.inertia, length)
    pixel = length / PIXELS
    every = np.full(len(truth.faces), SIDE_PIXELS * pixel)
    sides = measured_modes(np.asarray(truth.vertices), truth.faces, observed, length, every)
    offset = rng.standard_normal(len(sides)) @ sides + BIAS_PIXELS * pixel * rng.standard_normal() * observed
    ours = trimesh.Trimesh(moved(truth, offset), truth.faces, process=False)
    flat = closed_by_membrane(ours, observed)
    ours.vertices = flat + rng.uniform(*FILL) * (np.asarray(ours.vertices) - flat)
    bend = FOCAL_SIGMA * rng.standard_normal((3, 3))
    ours.vertices = np.asarray(ours.vertices) @ (np.eye(3) + 0.5 * (bend + bend.T))
    side, draws = mesh_side(ours, observed, length, pixel, rng)
    return Body(
        true,
        side,
        draws,
        motion_of(true, side, length, rng),
        float(ours.area_faces[observed].sum() / ours.area),
        length,
    )


def mesh_side(
    ours: trimesh.Trimesh, observed: np.ndarray, length: float, pixel: float, rng: np.random.Generator
) -> tuple[MeshSide, Draws]:
    """The mesh's document, intervals and replicates, as the surface and the mass stage make them."""
    v, f, count = np.asarray(ours.vertices), np.asarray(ours.faces), 600
    response, own = offset_response(v, f), mesh_integrals(v, f)
    rows = np.tile(own, (count, 1))
    rows += BIAS_PIXELS * pixel * rng.standard_normal((count, 1)) * response[observed].sum(0)
    sides = measured_modes(v, f, observed, length, np.full(len(f), SIDE_PIXELS * pixel))
    modes = np.concatenate([sides, fill_modes(v, f, observed, length)])
    rows += rng.standard_normal((count, len(modes))) @ (modes @ response)
    strain = FOCAL_SIGMA * rng.standard_normal((count, 3, 3))
    rows = deform(rows, 0.5 * (strain + strain.transpose(0, 2, 1)))
    rows = scaled_replicates(rows, np.full(count, length), length, 1.0, 2e-3, False, rng)
    rows = rows[valid_bodies(rows)]
    found = properties_of_integrals(own, 1000.0)
    scale = {"source": "given", "metres_per_unit": 1.0, "relative_sigma": 2e-3}
    surface = {"watertight": True, "observed_fraction": float(ours.area_faces[observed].sum() / ours.area)}
    content = document(found, intervals(rows, found), scale, surface, [])
    _, centres, inertias = central_inertia(rows, 1000.0)
    axes = found.principal_axes
    numbers = ten_numbers(found.volume, found.center_of_mass, found.inertia, axes)
    spread = with_floor(ten_numbers(rows[:, 0], centres, inertias, axes), rng)
    draws = Draws(numbers, with_own_size(spread, numbers, rng))
    covariance = covariance_of_replicates(inertias, found.inertia, axes) + SHAPE_FLOOR**2 * np.eye(5)
    apart = centres - found.center_of_mass
    side = MeshSide(
        content, found.inertia / np.trace(found.inertia), axes, np.array([found.k1, found.k2]), covariance,
        found.center_of_mass, apart.T @ apart / len(apart), True, 1.0 - surface["observed_fraction"], 1.0, length,
    )  # fmt: skip
    return side, draws


def motion_of(true: MassProperties, side: MeshSide, length: float, rng: np.random.Generator) -> Measured:
    """Ratios, axes and centre by the motion, off by more than it states."""
    sigma = np.array([*np.exp(rng.uniform(np.log([5e-4, 2e-4]), np.log([1e-2, 4e-3]))), *(3 * [1e-3])])
    R = np.diag(sigma**2)
    y = log_components(true.inertia, side.axes) + OVERCONFIDENT * sigma * rng.standard_normal(5)
    place_sigma = length * np.exp(rng.uniform(np.log(1e-3), np.log(4e-3)))
    place = true.center_of_mass + OVERCONFIDENT * place_sigma * rng.standard_normal(3)
    return measured(y, R, place, place_sigma**2 * np.eye(3))
