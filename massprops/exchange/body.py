"""What every exporter is given: one rigid body with its mass properties and its mesh."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.core.outputs import verify
from massprops.errors import InputError
from massprops.mass.document import document as make_document
from massprops.mass.document import read_document
from massprops.mass.recommended import as_recommended

if TYPE_CHECKING:
    import trimesh

READ = ("massprops.json", "mesh.ply", "work/sfm", "work/surface", "work/scale")
"""What is read of a run, as its record names it."""
CONVENTION = "inertia about the centre of mass in the mesh's axes, products as tensor elements (I_xy = -int x y dm)"


@dataclass(frozen=True)
class Body:
    """One rigid body.

    Attributes:
        name: an identifier, letters, digits and underscores.
        metric: lengths in metres and masses in kilograms; False in model units.
        mass: [kg].
        center_of_mass: (3,) in the mesh's axes [m].
        inertia: (3, 3) about the centre of mass, mesh axes, tensor signs [kg m^2].
        document: the whole `massprops.json`.
        mesh: the surface, in the same axes and units.
        run: the run folder, None when a bare mesh was given.
        files: what it was read from.
    """

    name: str
    metric: bool
    mass: float
    center_of_mass: np.ndarray
    inertia: np.ndarray
    document: dict[str, Any]
    mesh: trimesh.Trimesh
    run: Path | None = None
    files: tuple[Path, ...] = ()

    @property
    def elements(self) -> dict[str, float]:
        """`ixx`, `ixy`, `ixz`, `iyy`, `iyz` and `izz` of the inertia [kg m^2]."""
        return {f"i{'xyz'[i]}{'xyz'[j]}": float(self.inertia[i, j]) for i in range(3) for j in range(i, 3)}

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of an export must know: conventions, the source of the values, and assumptions."""
        block = self.document.get("recommended") or {}
        return (CONVENTION, *([f"values {block['because']}"] if block.get("because") else []), *self.assumptions)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """`assumed density ...` if neither density nor mass was given, else nothing."""
        if not (self.metric and self.document.get("density_assumed")):
            return ()
        return (f"assumed density {self.document['density']:g} kg/m^3 (water): give a density or a measured mass",)


def xml_comment(body: Body) -> str:
    """The body's remarks as a comment of XML, in which no two hyphens may follow one another."""
    lines = (line.replace("--", "- -").replace("--", "- -").rstrip("-") for line in (*body.remarks, "SI units"))
    return f"<!-- {'; '.join(lines)} -->"


def identifier(text: str) -> str:
    """`text` as a name that every format takes."""
    name = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_") or "body"
    return name if name[0].isalpha() else f"body_{name}"


def read_body(
    source: str | Path, density: float | None = None, mass: float | None = None, recommended: bool = False
) -> Body:
    """The body of a run folder, or of a mesh file filled with one density.

    Args:
        source: run folder or mesh file (taken as metres).
        density: [kg/m^3], for a mesh file; None takes that of water, and says so.
        mass: measured mass [kg]; the inertia is scaled to it.
        recommended: take the values that the run recommends, which may be those of mesh and motion together, in place
            of the mesh's own.

    Raises:
        InputError: no mesh there, or a mass or inertia that no body has.
    """
    from massprops.exchange.mesh_files import read_mesh, read_solid

    source = Path(source)
    if mass is not None and not (np.isfinite(mass) and mass > 0):
        raise InputError(f"--mass {mass}: give a number of kilograms above 0")
    if source.is_dir():
        files = mesh_file, document_file = source / "mesh.ply", source / "massprops.json"
        if missing := [file.name for file in reversed(files) if not file.is_file()]:
            raise InputError(f"{source}: no {missing[0]} in this run: finish it with 'massprops reconstruct' first")
        verify(source, *READ)
        document = read_document(document_file)
        mesh = read_mesh(mesh_file, process=False)
        if not mesh.is_volume:
            raise InputError(f"{mesh_file}: not watertight or inside out: make the run again, or repair the mesh")
        run: Path | None = source
        name = identifier(source.resolve().name)
    elif source.is_file():
        from massprops.mass.properties import ASSUMED_DENSITY, mass_properties

        mesh, notes = read_solid(source)
        surface = {"watertight": True, "area": float(mesh.area), "observed_fraction": 1.0}
        scale = {"source": "given", "metres_per_unit": 1.0, "relative_sigma": 0.0}
        properties = mass_properties(mesh, ASSUMED_DENSITY if density is None else density)
        document = make_document(properties, {}, scale, surface, list(notes), density_assumed=density is None)
        run, name, files = None, identifier(source.stem), (source,)
    else:
        raise InputError(
            f"{source}: no such run folder or mesh file; give what 'massprops reconstruct' wrote, or a mesh"
        )
    if recommended:
        document = as_recommended(document)
    inertia, factor = np.array(document["inertia"], float), 1.0
    if mass is not None:
        factor, document = mass / document["mass"], {**document, "density_assumed": False}
    return Body(
        name=name,
        metric=document["units"]["length"] == "m",
        mass=float(document["mass"] if mass is None else mass),
        center_of_mass=np.array(document["center_of_mass"], float),
        inertia=inertia * factor,
        document=document,
        mesh=mesh,
        run=run,
        files=files,
    )
