"""`massprops compare`: a run or mesh against a CAD mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.errors import InputError
from massprops.exchange.alignment import Similarity, align, scene_of, surface_samples
from massprops.exchange.mesh_files import read_solid

if TYPE_CHECKING:
    import trimesh

SAMPLES = 40_000


@dataclass(frozen=True)
class Comparison:
    """A body against its CAD.

    Attributes:
        transform: from our mesh to the CAD's axes.
        free_scale: whether the scale was fitted.
        distances: surface distances in the CAD's unit: `median`, `mean_signed` (positive: we are outside), `rms`,
            `p95`, `hausdorff`, of ours to CAD (`ours`) and of CAD to ours (`cad`), and `length`, the CAD's greatest.
        rows: one dict a quantity: quantity, cad, ours, error, error_text, unit, holds (None without an interval).
        warnings: one line each.
        mesh: our mesh in the CAD's axes; vertex_distance: (v,) signed.
    """

    transform: Similarity
    free_scale: bool
    distances: dict[str, Any]
    rows: list[dict[str, Any]]
    warnings: tuple[str, ...]
    mesh: trimesh.Trimesh
    vertex_distance: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def row(self, quantity: str) -> dict[str, Any]:
        """The row of one quantity."""
        return next(r for r in self.rows if r["quantity"] == quantity)

    def document(self) -> dict[str, Any]:
        """`compare.json`."""
        return {
            "format": "massprops-compare/1",
            "free_scale": self.free_scale,
            "scale": self.transform.scale,
            "transform": self.transform.matrix.tolist(),
            "distances": self.distances,
            "rows": self.rows,
            "warnings": list(self.warnings),
            "note": "the scale was fitted to the CAD: volume and moments then test the shape alone"
            if self.free_scale
            else "",
        }


def compare(
    source: str | Path, cad: str | Path, out: str | Path | None = None, free_scale: bool | None = None, seed: int = 0
) -> Comparison:
    """Aligns a run's mesh (or a mesh file) with a CAD mesh and measures what differs.

    Args:
        source: run folder or mesh file.
        cad: closed mesh, taken to be in metres.
        out: folder for `compare.json`, `compare.ply` and `compare_legend.png`.
        free_scale: fit the scale too; by default when the run has none.
        seed: of the surface samples.

    Raises:
        InputError: a file is missing or is no closed body.
    """
    from massprops.exchange.body import read_body
    from massprops.mass.integrals import greatest_length
    from massprops.mass.properties import mass_properties

    body = read_body(source)
    target, notes = read_solid(cad)
    free = (not body.metric) if free_scale is None else free_scale
    measured = _measured_faces(body.mesh)
    transform = align(body.mesh, target, free, measured, seed)
    ours = body.mesh.copy()
    ours.apply_transform(transform.matrix)
    density = float(body.document["density"])
    a, b = mass_properties(ours, density), mass_properties(target, density)
    length = greatest_length(np.asarray(target.vertices))[0]
    distances = _distances(ours, target, seed, length)
    interval = {} if free else body.document.get("interval_90", {})
    return Comparison(
        transform,
        free,
        distances,
        _rows(a, b, interval, length),
        (*notes, *_hints(transform, free, a.volume / b.volume)),
        ours,
        _signed(scene_of(target), np.asarray(ours.vertices)),
    )


def write_comparison(comparison: Comparison, out: str | Path) -> Path:
    """Writes `compare.json`, the coloured mesh and its legend into a folder; gives the JSON's path."""
    from massprops.run.files import write_json, write_whole

    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "compare.json", comparison.document())
        colours, legend = _colours(comparison)
        mesh = comparison.mesh.copy()
        mesh.visual.vertex_colors = colours
        write_whole(folder / "compare.ply", mesh.export(file_type="ply"))
        write_whole(folder / "compare_legend.png", legend)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}): choose another place with -o") from None
    return folder / "compare.json"


def _measured_faces(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """Faces that the run measured, by the `observed` property of its PLY; None for a plain mesh."""
    raw = mesh.metadata.get("_ply_raw", {}).get("face", {}).get("data")
    try:
        flag = np.asarray(raw["observed"]).ravel().astype(bool)  # type: ignore[index]
    except (KeyError, TypeError, ValueError, IndexError):
        return None
    return flag if len(flag) == len(mesh.faces) and flag.mean() > 0.2 else None


def _signed(scene: Any, points: np.ndarray) -> np.ndarray:
    """Signed distance (n,), positive outside."""
    from massprops.native import load_open3d

    o3d = load_open3d()
    return (
        scene.compute_signed_distance(o3d.core.Tensor(np.ascontiguousarray(points, dtype=np.float32)))
        .numpy()
        .astype(float)
    )


def _distances(ours: trimesh.Trimesh, target: trimesh.Trimesh, seed: int, length: float) -> dict[str, Any]:
    out: dict[str, Any] = {"length": length}
    pairs = {"ours": (ours, scene_of(target), 1.0), "cad": (target, scene_of(ours), -1.0)}
    for name, (mesh, scene, sign) in pairs.items():
        points = np.concatenate([surface_samples(mesh, SAMPLES, seed + 5), np.asarray(mesh.vertices)[:200_000]])
        d = sign * _signed(scene, points)
        even, size = d[:SAMPLES], np.abs(d)
        out[name] = {
            "median": float(np.median(size[:SAMPLES])),
            "mean_signed": float(even.mean()),
            "rms": float(np.sqrt(np.mean(even**2))),
            "p95": float(np.percentile(size[:SAMPLES], 95)),
            "hausdorff": float(size.max()),
        }
    out["hausdorff"] = max(out["ours"]["hausdorff"], out["cad"]["hausdorff"])
    return out


def _rows(a: Any, b: Any, interval: dict[str, Any], length: float) -> list[dict[str, Any]]:
    """Quantity by quantity: CAD (b), ours (a) in the CAD's axes."""
    rows = []

    def add(name: str, cad: float, ours: float, unit: str, relative_to: float | None, bounds: Any = None) -> None:
        error = ours - cad
        shown = f"{100 * error / relative_to:+.3f} %" if relative_to else f"{error:+.5f}"
        holds = None if not bounds else bool(bounds[0] <= cad <= bounds[1])
        rows.append(
            {"quantity": name, "cad": float(cad), "ours": float(ours), "error": float(error), "error_text": shown, "unit": unit,
             "relative_error": float(error / relative_to) if relative_to else None, "holds": holds}
        )  # fmt: skip

    add("volume", b.volume, a.volume, "m^3", b.volume, interval.get("volume"))
    for i, axis in enumerate("xyz"):
        add(f"center_of_mass_{axis}", b.center_of_mass[i], a.center_of_mass[i], "m", length)
    trace = float(np.trace(b.inertia)) / 3
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        reference = b.inertia[i, j] if i == j else trace
        add(f"I_{'xyz'[i]}{'xyz'[j]}", b.inertia[i, j], a.inertia[i, j], "kg m^2", reference)
    for i in range(3):
        bounds = (interval.get("principal_moments") or [None] * 3)[i]
        add(f"I{i + 1}", b.principal_moments[i], a.principal_moments[i], "kg m^2", b.principal_moments[i], bounds)
    for i in range(3):
        cosine = abs(float(a.principal_axes[:, i] @ b.principal_axes[:, i]))
        angle = float(np.degrees(np.arccos(min(1.0, cosine))))
        rows.append({"quantity": f"axis_{i + 1}", "cad": 0.0, "ours": angle, "error": angle, "error_text": f"{angle:.3f} deg",
                     "unit": "deg", "relative_error": None, "holds": None})  # fmt: skip
    add("k1", b.k1, a.k1, "1", None, interval.get("k1"))
    add("k2", b.k2, a.k2, "1", None, interval.get("k2"))
    return rows


def _hints(transform: Similarity, free: bool, ratio: float) -> tuple[str, ...]:
    for factor, name in ((1e9, "millimetres"), (1e-9, "kilometres"), (1e6, "centimetres")):
        if not free and 0.5 < ratio * factor < 2.0:
            return (
                f"volumes differ by a factor of {1 / ratio:.3g}: is the CAD in {name}? Use --free-scale or convert it",
            )
    return ()


def _colours(comparison: Comparison) -> tuple[np.ndarray, bytes]:
    """Blue inside, white on, red outside; and a PNG legend with the limits."""
    import cv2

    d = comparison.vertex_distance
    limit = float(np.percentile(np.abs(d), 95)) or 1.0

    def paint(x: np.ndarray) -> np.ndarray:
        x = np.clip(x, -1, 1)[:, None]
        white, red, blue = np.array([245, 245, 245]), np.array([190, 30, 45]), np.array([35, 80, 170])
        return np.where(x > 0, white + x * (red - white), white - x * (blue - white)).astype(np.uint8)

    rgba = np.concatenate([paint(d / limit), np.full((len(d), 1), 255, np.uint8)], axis=1)
    bar = np.full((90, 640, 3), 255, np.uint8)
    bar[15:45, 40:600] = paint(np.linspace(-1, 1, 560))[None, :, ::-1]
    for x, label in ((40, f"-{limit:.3g} m inside"), (290, "0"), (470, f"+{limit:.3g} m outside")):
        cv2.putText(bar, label, (x, 70), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1, cv2.LINE_AA)
    return rgba, cv2.imencode(".png", bar)[1].tobytes()
