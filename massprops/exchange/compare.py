"""`massprops compare`: a run or mesh against a CAD mesh."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.core.displayed import Displayed, number
from massprops.core.outputs import Outputs
from massprops.exchange.mesh_files import in_metres, read_solid

if TYPE_CHECKING:
    import trimesh

    from massprops.exchange.alignment import Similarity
    from massprops.exchange.body import Body
    from massprops.mass.properties import MassProperties

LIKE_MOMENTS = 0.005
"""Relative difference of two of the CAD's moments below which their axes are compared as a plane only."""

SAME = 1e-9
"""Difference of k1 up to which the cross-check is of this mesh."""

LEAST_MEASURED = 0.2
"""Share of measured faces below which the alignment takes the filled ones too."""


@dataclass(frozen=True, repr=False)
class Comparison(Displayed):
    """A body against its CAD, in the CAD's axes and metres.

    Attributes:
        transform: from our mesh to the CAD.
        free_scale: whether the scale was fitted.
        distances: of `massprops.exchange.distances.surface_distances`.
        rows: one dict a quantity: `quantity`, `cad`, `ours`, `error` (ours - cad), `relative_error` (None where a
            share means nothing), `error_text`, `unit`, `interval_90` of ours and whether it `holds` the CAD's value
            (None without an interval).
        warnings: one line each.
        mesh: our mesh in the CAD's axes.
        vertex_distance: (v,) signed distance of its vertices to the CAD, positive outside [m].
        fused: rows of the same kind for mesh and motion together; None where the run's cross-check joined nothing.
        recommended: `mesh` or `fused`, whichever the run recommends.
    """

    transform: Similarity
    free_scale: bool
    distances: dict[str, Any]
    rows: list[dict[str, Any]]
    warnings: tuple[str, ...]
    mesh: trimesh.Trimesh
    vertex_distance: np.ndarray
    fused: list[dict[str, Any]] | None = None
    recommended: str = "mesh"

    def row(self, quantity: str) -> dict[str, Any]:
        """The row of one quantity."""
        return next(r for r in self.rows if r["quantity"] == quantity)

    def facts(self) -> dict[str, str]:
        """Errors of the mass properties and the surface's distance."""
        shown = {r["quantity"]: r["error_text"] for r in self.rows}
        return shown | {"median distance": number(self.distances["ours"]["median"], unit="m")}

    def document(self) -> dict[str, Any]:
        """`compare.json`."""
        return {
            "format": "massprops-compare/1",
            "units": {"length": "m", "mass": "kg"},
            "frame": "the CAD's axes and origin; inertia about each body's own centre of mass, tensor signs",
            "free_scale": self.free_scale,
            "scale": self.transform.scale,
            "transform": self.transform.matrix.tolist(),
            "distances": self.distances,
            "rows": self.rows,
            "fused": self.fused,
            "recommended": self.recommended,
            "warnings": list(self.warnings),
        }


def compare(
    run_or_mesh: str | Path,
    cad: str | Path,
    out: str | Path | None = None,
    free_scale: bool | None = None,
    cad_unit: str = "auto",
    seed: int = 0,
    force: bool = False,
) -> Comparison:
    """Aligns a run's mesh (or a mesh file) with a CAD mesh and measures what differs.

    Args:
        run_or_mesh: run folder, or mesh file in metres.
        cad: closed mesh, as STL, OBJ, PLY, GLB or OFF; small defects are repaired with a warning.
        out: folder for `compare.json`, `compare.ply` (signed distance as colour and as the property `distance`) and
            `compare_legend.png`; nothing is written when None.
        free_scale: fit the scale too; by default when the run has none.
        cad_unit: of the CAD's coordinates, one of `mesh_files.UNITS`, or `auto`: metres, unless the lengths of the
            bodies say millimetres, centimetres or inches.
        seed: of the surface samples.
        force: files in `out` that no `compare` wrote may be replaced; the meshes may not.

    Raises:
        InputError: a file is missing or is no closed body, or `out` cannot be written.
    """
    from massprops.exchange.body import read_body
    from massprops.exchange.compare_files import check_place
    from massprops.mass.integrals import greatest_length

    body = read_body(run_or_mesh)
    inputs = [*body.files, Path(cad)]
    if out is not None:
        check_place(Path(out), body.run, inputs, force)
    free = (not body.metric) if free_scale is None else free_scale
    target, notes = read_solid(cad)
    ours_length = None if free or not body.metric else greatest_length(np.asarray(body.mesh.vertices))[0]
    target, unit_notes = in_metres(target, cad_unit, ours_length)
    comparison = _compared(body, target, free, seed, (*notes, *unit_notes))
    if out is not None:
        from massprops.exchange.compare_files import write_comparison

        write_comparison(comparison, out, inputs, force)
    return comparison


def _compared(body: Body, target: trimesh.Trimesh, free: bool, seed: int, notes: tuple[str, ...]) -> Comparison:
    """A body against a CAD mesh in metres; notes: warnings so far."""
    from massprops.exchange.alignment import align
    from massprops.exchange.distances import Surface, surface_distances
    from massprops.mass.integrals import greatest_length
    from massprops.mass.properties import mass_properties

    transform = align(body.mesh, target, free, _measured_faces(body.mesh), seed)
    ours = body.mesh.copy()
    ours.apply_transform(transform.matrix)
    density = float(body.document["density"])
    a, b = mass_properties(ours, density), mass_properties(target, density)
    length = greatest_length(np.asarray(target.vertices))[0]
    fused, together = read_fused(body.run, body.document), None
    if fused is not None:
        moved = in_frame(fused, transform, density)
        together = _rows(moved, b, _usable_intervals(fused, free, body.metric), length)
    return Comparison(
        transform=transform,
        free_scale=free,
        distances=surface_distances(ours, target, length, seed + 5),
        rows=_rows(a, b, _usable_intervals(body.document, free, body.metric), length),
        warnings=(*notes, *_scale_notes(body, free)),
        mesh=ours,
        vertex_distance=Surface(target).signed(np.asarray(ours.vertices)),
        fused=together,
        recommended=str((body.document.get("recommended") or {}).get("source", "mesh")),
    )


def _measured_faces(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """Faces that the run measured, by the `observed` property of its PLY; None for a plain mesh."""
    raw = mesh.metadata.get("_ply_raw", {}).get("face", {}).get("data")
    try:
        flag = np.asarray(raw["observed"]).ravel().astype(bool)
    except (KeyError, TypeError, ValueError, IndexError):
        return None
    return flag if len(flag) == len(mesh.faces) and flag.mean() > LEAST_MEASURED else None


def _usable_intervals(document: dict[str, Any], free: bool, metric: bool) -> dict[str, Any]:
    """Intervals of quantities that a turn leaves as they are; with a fitted scale, the ratios alone."""
    keys = ("k1", "k2") if free or not metric else ("volume", "principal_moments", "k1", "k2")
    interval = document.get("interval_90") or {}
    return {key: interval[key] for key in keys if interval.get(key)}


def _scale_notes(body: Body, free: bool) -> tuple[str, ...]:
    if free:
        why = "" if body.metric else "the run has no scale, so "
        return (f"{why}the scale was fitted to the CAD: volume and moments test the shape alone",)
    if not body.metric:
        return ("the run is in model units and the scale was kept: only ratios and axes can be compared",)
    return ()


def _rows(ours: MassProperties, cad: MassProperties, interval: dict[str, Any], length: float) -> list[dict[str, Any]]:
    """Quantity by quantity, both in the CAD's axes."""
    rows: list[dict[str, Any]] = []

    def add(name: str, of_cad: float, of_ours: float, unit: str, share_of: float | None, bounds: Any = None) -> None:
        error = float(of_ours - of_cad)
        rows.append(
            {
                "quantity": name,
                "cad": float(of_cad),
                "ours": float(of_ours),
                "error": error,
                "relative_error": error / share_of if share_of else None,
                "error_text": f"{100 * error / share_of:+.3f} %" if share_of else f"{error:+.5f}",
                "unit": unit,
                "interval_90": [float(v) for v in bounds] if bounds else None,
                "holds": bool(bounds[0] <= of_cad <= bounds[1]) if bounds else None,
            }
        )

    add("volume", cad.volume, ours.volume, "m^3", cad.volume, interval.get("volume"))
    for i, axis in enumerate("xyz"):
        add(f"center_of_mass_{axis}", cad.center_of_mass[i], ours.center_of_mass[i], "m", length)
    mean = float(np.trace(cad.inertia)) / 3
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        share_of = cad.inertia[i, j] if i == j else mean
        add(f"I_{'xyz'[i]}{'xyz'[j]}", cad.inertia[i, j], ours.inertia[i, j], "kg m^2", share_of)
    for i in range(3):
        bounds = (interval.get("principal_moments") or [None] * 3)[i]
        value = cad.principal_moments[i]
        add(f"I{i + 1}", value, ours.principal_moments[i], "kg m^2", value, bounds)
    for i, angle in enumerate(axis_angles(ours.principal_axes, cad.principal_axes, cad.principal_moments)):
        add(f"axis_{i + 1}", 0.0, angle, "deg", None)
        rows[-1]["error_text"] = f"{angle:.3f} deg"
    add("k1", cad.k1, ours.k1, "1", None, interval.get("k1"))
    add("k2", cad.k2, ours.k2, "1", None, interval.get("k2"))
    return rows


DISTANCES = {"median": "median", "mean_signed": "mean, signed", "rms": "rms", "p95": "95 %", "hausdorff": "Hausdorff"}
"""What each distance between surfaces is called in a table."""


def quantity_label(quantity: str) -> str:
    """The name of a row in words: `center_of_mass_x` is "centre of mass x"."""
    return quantity.replace("center_of_mass_", "centre of mass ").replace("axis_", "axis of I")


def axis_angles(ours: np.ndarray, cad: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """(3,) angles [deg] of our principal axes to the CAD's, whatever their sign.

    Axes whose moments differ by less than `LIKE_MOMENTS` may be any in their plane: ours is then measured to that
    plane, and to nothing (0) when all three are alike.

    Args:
        ours, cad: (3, 3) axes as columns.
        moments: (3,) of the CAD, ascending.
    """
    out = np.empty(3)
    for i in range(3):
        like = np.abs(moments - moments[i]) <= LIKE_MOMENTS * moments[2]
        inside = np.linalg.norm(cad[:, like].T @ ours[:, i])
        outside = np.linalg.norm(cad[:, ~like].T @ ours[:, i])
        out[i] = np.degrees(np.arctan2(outside, inside))
    return out


def read_fused(run: Path | None, document: dict[str, Any]) -> dict[str, Any] | None:
    """`fused` of a run's `crosscheck.json`; None where there is none, or it is of an earlier mesh.

    Args:
        run: the run folder, or None for a bare mesh.
        document: its `massprops.json`.
    """
    if run is None or not Outputs(run).intact("crosscheck.json"):
        return None
    try:
        crosscheck = json.loads((run / "crosscheck.json").read_text())
        fused, k1 = crosscheck["fused"], float(crosscheck["mesh"]["k1"])
        document_k1 = float(document["inertia_ratios"]["k1"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return fused if isinstance(fused, dict) and abs(k1 - document_k1) < SAME else None


def in_frame(fused: dict[str, Any], transform: Similarity, density: float) -> MassProperties:
    """The fused body's mass properties after a similarity x -> s R x + t of its mesh.

    Args:
        fused: of `read_fused`, in the mesh's axes.
        transform: to the other frame.
        density: [kg/m^3].
    """
    s, place = transform.scale, np.array([*fused["center_of_mass"], 1.0])
    R = transform.matrix[:3, :3] / s
    inertia = s**5 * R @ np.array(fused["inertia"], float) @ R.T
    from massprops.mass.properties import MassProperties

    return MassProperties.of(density, s**3 * float(fused["volume"]), (transform.matrix @ place)[:3], inertia)
