"""`massprops mass`: a run folder from a finished mesh, without images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.core.files import hash_of, write_json, write_whole
from massprops.core.inputs import hash_input, readable
from massprops.core.outputs import Outputs, claim
from massprops.errors import InputError
from massprops.run.reconstruct import Run
from massprops.run.runner import versions

if TYPE_CHECKING:
    import trimesh

COMMAND = "mass"
NAMES = ("run.yaml", "mesh.ply", "mesh.glb", "massprops.json")
SHORTEST = 1e-12
"""Metres, a tenth of an atom: what is shorter comes of a scale that was not meant."""


def mass(
    mesh: str | Path,
    out: str | Path,
    density: float | None = None,
    scale: float = 1.0,
    scale_sigma: float = 0.0,
    force: bool = False,
) -> Run:
    """Mass properties, report and exportable run folder of a mesh file.

    Args:
        mesh: STL, OBJ, PLY, GLB or OFF; small defects are repaired with a warning.
        out: the run folder.
        density: [kg/m^3]; None takes that of water, and says so.
        scale: metres per unit of the file (0.001 for millimetres).
        scale_sigma: relative one sigma of that.
        force: other files and results in the folder may be replaced; the mesh itself may not.

    Raises:
        InputError: not a closed body, a value out of range, or a folder that holds something else.
    """
    mesh = readable(Path(mesh))
    solid, content = measure(mesh, density, scale, scale_sigma)
    run = readable(Path(out)).resolve()
    with claim(run, COMMAND, NAMES, [mesh], force) as outputs:
        outputs.check("report", ("report.json", "report.html"), [mesh], force)
        if force and outputs.base is not None:  # of two bodies in one folder each would pass for the other
            outputs.start_over()
        try:
            _publish(outputs, mesh, solid, content, {"density": density, "scale": scale}, force)
        except OSError as error:
            raise InputError(f"{run}: cannot be written ({error.strerror}): choose another place with -o") from None
    return Run(run, warnings=list(content["warnings"]))


def measure(
    mesh: str | Path, density: float | None = None, scale: float = 1.0, scale_sigma: float = 0.0
) -> tuple[trimesh.Trimesh, dict[str, Any]]:
    """The body of a mesh file in metres, and its `massprops.json`; arguments and errors as `mass`."""
    from massprops.exchange.mesh_files import read_solid
    from massprops.mass.document import document
    from massprops.mass.properties import ASSUMED_DENSITY, mass_properties
    from massprops.mass.repair import LARGEST_COORDINATE

    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"--scale {scale}: metres per unit of the file is a number above 0")
    if not 0 <= scale_sigma < 0.5:
        raise InputError(f"--scale-sigma {scale_sigma}: give a relative sigma from 0 to 0.5")
    solid, notes = read_solid(readable(Path(mesh)))
    solid = solid.copy()
    solid.apply_scale(scale)
    length = float(np.ptp(np.asarray(solid.vertices), axis=0).max())
    if not SHORTEST < length < LARGEST_COORDINATE:
        raise InputError(f"--scale {scale:g} makes the body {length:.3g} m long: give the metres per unit of the file")
    properties = mass_properties(solid, ASSUMED_DENSITY if density is None else density)
    surface = {"watertight": True, "area": float(solid.area), "observed_fraction": 1.0}
    known = {"source": "given", "metres_per_unit": scale, "relative_sigma": scale_sigma}
    frame = "axes and origin of the mesh file"
    bounds = _intervals(properties, scale_sigma)
    content = document(properties, bounds, known, surface, list(notes), frame, density_assumed=density is None)
    content["images"] = {"given": 0, "used": 0, "registered": 0}
    return solid, content


def _publish(
    outputs: Outputs, mesh: Path, solid: Any, content: dict[str, Any], options: dict[str, float | None], force: bool
) -> None:
    """The run folder of a finished mesh, into a folder that the caller holds."""
    import yaml

    import massprops
    from massprops.report.page import publish_report
    from massprops.run.stages.publish import mesh_ply

    manifest: dict[str, Any] = {
        "format": "massprops-run/1",
        "massprops": massprops.__version__,
        "inputs": {"source": str(mesh.resolve()), "sha256": hash_input(mesh)},
        "options": options,
        "versions": versions(),
    }
    vertices, faces = np.asarray(solid.vertices), np.asarray(solid.faces)
    new = outputs.staging()
    write_whole(new / "mesh.ply", mesh_ply(vertices, faces, np.ones(len(faces), np.uint8), None))
    write_whole(new / "mesh.glb", solid.export(file_type="glb"))
    write_json(new / "massprops.json", content)
    write_whole(new / "run.yaml", yaml.safe_dump(manifest, sort_keys=False))
    outputs.publish(COMMAND, hash_of([manifest, content]), [mesh], force)
    publish_report(outputs, outputs.base, {"exit_code": 0, "reason": "", "stage": None}, force)


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
