"""Effects of the catalogue that follow something known beside the motion: a wheel's measured rate, the mesh of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.mesh_faces import rows_of_mesh
from massprops.effects import effects, of_record
from massprops.errors import InputError
from massprops.model.measured_wheel import measured_wheel
from massprops.sequence.data import Sequence

SAME_AXIS, SAME_MOMENT = 1e-3, 1e-3
"""Of one wheel in two records: angle between its axes [rad], and part by which its moments may differ, as rounded numbers do."""


def effects_beside(sequence: Sequence) -> list[ModuleType]:
    """The effects of the catalogue as what was measured makes them; none where nothing was.

    Raises:
        InputError: what was measured does not reach over the record.
    """
    out = []
    if sequence.rotor is not None:
        out.append(measured_wheel(sequence.rotor, *_bounds(sequence), sequence.first_ns))
    run = None if sequence.folder is None or sequence.attitude is None else sequence.folder.parent
    mesh = None if run is None else mesh_of_run(run)
    if mesh is not None:
        known = {"mesh", *EnvironmentModel(sequence.environment).known}
        given: dict[str, object] = {"faces": rows_of_mesh(mesh[0][mesh[1]])}
        if sequence.environment.orbit is not None:
            given["orbit_normal"] = np.asarray(sequence.environment.orbit.R_inertial_perifocal)[:, 2].tolist()
        needed = [m for m in effects().values() if "mesh" in m.NEEDS]
        out += [of_record(m, given) for m in needed if set(m.NEEDS) <= known]
    return out


def of_one_wheel(sequences: dict[str, Sequence]) -> dict[str, Sequence]:
    """Records of one body with what any of them states of its wheel (`rotor0`): the axis and the moment of inertia. In one whose wheel
    stands still there is none.

    Raises:
        InputError: they state different ones.
    """
    wheels = {name: s.rotor for name, s in sequences.items() if s.rotor is not None}
    axis = next((w.axis for w in wheels.values() if w.axis is not None), None)
    moment = next((w.inertia_kg_m2 for w in wheels.values() if w.inertia_kg_m2 is not None), None)
    out = dict(sequences)
    for name, wheel in wheels.items():
        if axis is not None and wheel.axis is not None and wheel.axis @ axis < np.cos(SAME_AXIS):
            raise InputError(
                f"{name}: rotor0 states another axis than in another record: one wheel has one in the body"
            )
        if moment is not None and not np.isclose(wheel.inertia_kg_m2 or moment, moment, rtol=SAME_MOMENT):
            raise InputError(
                f"{name}: rotor0 states {wheel.inertia_kg_m2:g} kg m² and another record {moment:g}: one wheel has one"
            )
        rotor = replace(wheel, axis=axis, inertia_kg_m2=moment) if np.any(wheel.rate) else None
        out[name] = replace(sequences[name], rotor=rotor)
    return out


def mesh_of_run(run: Path) -> tuple[np.ndarray, np.ndarray] | None:
    """Vertices (v, 3) and faces (f, 3) of a run's mesh from its centre of mass, in the axes of its attitudes; None where there is no run."""
    if not (run / "mesh.ply").is_file() or not (run / "massprops.json").is_file():
        return None
    import json

    import trimesh

    mesh = trimesh.load(run / "mesh.ply", process=False)
    centre = np.array(json.loads((run / "massprops.json").read_text())["center_of_mass"], float)
    return np.asarray(mesh.vertices, float) - centre, np.asarray(mesh.faces)


def _bounds(sequence: Sequence) -> tuple[int, int]:
    """First and last time of the record that effects are told in [ns]."""
    series = [sequence.attitude, sequence.tracks, sequence.rates]
    if sequence.tracks is None:  # a gyroscope beside attitudes is used within theirs
        series = [sequence.attitude or sequence.rates]
    stamps = np.concatenate([s.timestamp_ns for s in series if s is not None] or [np.zeros(1, np.int64)])
    return int(stamps.min(initial=2**62)), int(stamps.max(initial=0))
