"""Rendered footage that the benchmarks share, chosen by how much of the body its motion shows, and runs on it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from massprops.dynamics.quaternion import rotation_matrix
from massprops.mass.integrals import greatest_length
from massprops.mass.properties import mass_properties
from massprops.run.reconstruct import Run, reconstruct
from massprops.sequence.truth import Truth, read_truth
from massprops.simulation import simulate
from massprops.simulation.motion import tumbling, with_hidden_mass
from massprops.simulation.scenario import load_scenario

MOST = int(os.environ.get("MASSPROPS_BENCH_RUNS", "20"))
"""Runs of each kind (half as many of the bodies that are partly seen)."""
HIDDEN = 0.08
"""Hidden mass over the body's."""


def place(tmp_path: Path, name: str) -> Path:
    """Folder of a run; `MASSPROPS_BENCH_OUT` keeps the runs, and they are used again."""
    kept = os.environ.get("MASSPROPS_BENCH_OUT")
    return (Path(kept) if kept else tmp_path) / name


def body(seed: int) -> str:
    return ("asteroid", "spacecraft")[seed % 2]


def well_shown(seed: int) -> dict[str, Any]:
    """Footage under changing light."""
    return {"frames": 64, "size": (480, 360), "rate_deg": 5.5, "sun_phase_deg": 15.0 + 20.0 * ((0.618 * seed) % 1.0)}


def partly_shown(seed: int) -> dict[str, Any]:
    """Low Sun; the spacecraft, whose thin arrays need the smaller steps to be followed, is shown longer."""
    frames, rate = ((64, 6.5), (76, 5.5))[seed % 2]
    return {"frames": frames, "size": (480, 360), "rate_deg": rate, "sun_phase_deg": 45.0}


def hidden(seed: int) -> tuple[float, float, float, float]:
    """Share and place of a mass inside the body, well off its centre."""
    mesh = trimesh.load(load_scenario(body(seed)).mesh, force="mesh")
    vertices = np.asarray(mesh.vertices) - mesh.center_mass
    size = np.linalg.norm(vertices, axis=1)
    far = vertices[size > 0.5 * size.max()]
    x, y, z = 0.6 * far[np.random.default_rng([seed, 8]).integers(len(far))]
    return HIDDEN, float(x), float(y), float(z)


def shown_share(seed: int, **options: Any) -> float:
    """Share of the surface that the motion shows: facing within 65 deg and lit in three frames or more, whatever stands
    before it."""
    scenario = load_scenario(body(seed), seed=seed, **options)
    mesh = trimesh.load(scenario.mesh, force="mesh")
    mesh.apply_translation(-mesh.center_mass)
    length = greatest_length(np.asarray(mesh.vertices))[0]
    whole = mass_properties(mesh, scenario.density)
    inertia, centre = whole.inertia, np.zeros(3)
    if scenario.hidden_mass is not None:
        inertia, centre = with_hidden_mass(inertia, whole.mass, scenario.hidden_mass)
    path = tumbling(scenario, inertia, length, centre)
    view = -np.einsum("nji,nj->ni", rotation_matrix(path.q), path.position)
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    shown = (view @ mesh.face_normals.T > np.cos(np.radians(65))) & (path.sun @ mesh.face_normals.T > 0.1)
    return float(mesh.area_faces[shown.sum(axis=0) >= 3].sum() / mesh.area)


def chosen(kind: str, count: int) -> list[tuple[str, int, dict[str, Any]]]:
    """Name, seed and options of footage, asteroid and spacecraft in turn.

    Args:
        kind: `uniform` and `hidden` show 80 % or more, as the footage of the accuracy benchmark does; `partly` shows 60
            to 73 %, and with the creases that the count passes over a third is unseen.
    """
    low, high, seed, footage = {
        "uniform": (0.8, 1.0, 100, well_shown),
        "hidden": (0.8, 1.0, 100, well_shown),
        "partly": (0.6, 0.73, 200, partly_shown),
    }[kind]
    found: list[list[tuple[str, int, dict[str, Any]]]] = [[], []]
    while min(len(f) for f in found) < (count + 1) // 2:
        options = footage(seed)
        if kind == "hidden":
            options["hidden_mass"] = hidden(seed)
        if low <= shown_share(seed, **options) <= high:
            found[seed % 2].append((f"{kind}-{seed}", seed, options))
        seed += 1
    return [one for pair in zip(*found, strict=False) for one in pair][:count]


def simulated(sequence: Path, scenario: str, **options: Any) -> tuple[Path, Truth]:
    """The bare images of a sequence, simulated where it is not there yet, and its truth."""
    if not (sequence / "truth" / "mesh.ply").is_file():
        simulate(scenario, sequence, **options)
    truth = read_truth(sequence)
    assert truth is not None
    return sequence / "cam0" / "data", truth


def run_on(folder: Path, seed: int, options: dict[str, Any]) -> tuple[Run, Truth]:
    """Simulates and reconstructs what is not there yet, given the bare images and the greatest length."""
    images, truth = simulated(folder / "sequence", body(seed), seed=seed, **options)
    return reconstruct(images, folder / "run", scale=truth.facts["greatest_length_m"], threads=1), truth
