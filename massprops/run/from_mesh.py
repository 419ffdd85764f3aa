"""`massprops mass`: a run folder from a finished mesh, without images."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from massprops.errors import InputError
from massprops.run.files import hash_input, locked, write_json, write_whole
from massprops.run.job import ReconstructOptions
from massprops.run.reconstruct import Run
from massprops.run.runner import versions


def mass(
    mesh: str | Path, out: str | Path, density: float = 1000.0, scale: float = 1.0, scale_sigma: float = 0.0
) -> Run:
    """Mass properties, report and exportable run folder of a mesh file.

    Args:
        mesh: STL, OBJ, PLY, GLB or OFF; small defects are repaired with a warning.
        out: the run folder.
        density: [kg/m^3].
        scale: metres per unit of the file (0.001 for millimetres).
        scale_sigma: relative one sigma of that.

    Raises:
        InputError: not a closed body, or a value out of range.
    """
    import yaml

    import massprops
    from massprops.exchange.mesh_files import read_solid
    from massprops.mass.document import document
    from massprops.mass.properties import mass_properties
    from massprops.report import write_report
    from massprops.run.stages.publish import MEASURED, mesh_ply

    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"--scale {scale}: metres per unit of the file is a number above 0")
    if not 0 <= scale_sigma < 0.5:
        raise InputError(f"--scale-sigma {scale_sigma}: give a relative sigma from 0 to 0.5")
    solid, notes = read_solid(mesh)
    solid = solid.copy()
    solid.apply_scale(scale)
    properties = mass_properties(solid, density)
    surface = {"watertight": True, "area": float(solid.area), "observed_fraction": 1.0}
    known = {"source": "given", "metres_per_unit": scale, "relative_sigma": scale_sigma}
    content = document(
        properties, _intervals(properties, scale_sigma), known, surface, list(notes), "axes and origin of the mesh file"
    )
    content["images"] = {"given": 0, "used": 0, "registered": 0}
    run = Path(out).resolve()
    with locked(run):
        colours = np.tile(np.array(MEASURED, np.uint8), (len(solid.faces), 1))
        vertices, faces = np.asarray(solid.vertices), np.asarray(solid.faces)
        write_whole(run / "mesh.ply", mesh_ply(vertices, faces, np.ones(len(faces), bool), colours))
        write_whole(run / "mesh.glb", solid.export(file_type="glb"))
        write_json(run / "massprops.json", content)
        write_json(run / "report.json", {"format": "massprops-report/1", "exit_code": 0, "reason": "", "stage": None})
        manifest: dict[str, Any] = {
            "format": "massprops-run/1",
            "massprops": massprops.__version__,
            "inputs": {"source": str(Path(mesh).resolve()), "sha256": hash_input(Path(mesh))},
            "options": {
                k: v
                for k, v in asdict(ReconstructOptions(density=density, scale=scale)).items()
                if k in ("density", "scale")
            },
            "versions": versions(),
        }
        write_whole(run / "run.yaml", yaml.safe_dump(manifest, sort_keys=False))
        write_report(run)
    return Run(run, warnings=list(notes))


def _intervals(properties: Any, sigma: float) -> dict[str, Any]:
    """A finished mesh is exact but for its scale: 3 sigma in volume, 5 in inertia, none in the ratios."""
    if sigma == 0:
        return {}
    reach = 1.645 * sigma

    def span(value: float, power: int) -> list[float]:
        return sorted([float(value * (1 - power * reach)), float(value * (1 + power * reach))])

    return {
        "volume": span(properties.volume, 3),
        "mass": span(properties.mass, 3),
        "principal_moments": [span(m, 5) for m in properties.principal_moments],
        "k1": [properties.k1, properties.k1],
        "k2": [properties.k2, properties.k2],
    }
