"""How far a run on a rendered scene is from the truth.

A reconstruction from images alone has no scale, so its scale comes from the cameras: the similarity that lays the
run's camera centres on the true ones, both in axes fixed to the object. Volume and centre of mass are compared after
it. Moments of shape, I / V^(5/3), and the ratios k1 and k2 need no scale. Intervals are stated in units of the object's
greatest length, and compared in these.

Half of the cameras may be wrong, as when one placement of a turned object was not joined. So the similarity is the
one on which most cameras agree (random triples, then least squares on those that agree).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from trimesh.registration import procrustes

from massprops.mass.integrals import greatest_length
from massprops.mass.properties import mass_properties
from tabletop.silhouettes import intersection_over_union, silhouette
from tabletop.truth import SceneTruth

AGREES = 0.01
"""A camera agrees where its centre is within this share of its distance to the object. Well-registered cameras of
the eight shared scenes are within 0.002; a camera of the wrong placement is off by about its own distance."""
TRIPLES = 500
"""Random triples of cameras: with half of the cameras wrong, one in eight triples is right."""


@dataclass(frozen=True, kw_only=True)
class CameraFit:
    """The similarity x -> scale * R x + t from the run's axes to the object's, and the cameras that agree with it."""

    scale: float
    R: np.ndarray
    t: np.ndarray
    agree: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the run in object axes [m]."""
        return self.scale * points @ self.R.T + self.t


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What a run came to, against the truth. Errors are ours minus truth; NaN where there is nothing to compare.

    Attributes:
        exit_code: of the command; -1 where it was not run by the judge.
        cpu_seconds: user and system time of the command and its children [s].
        registered: images placed, of `images`.
        agree: placed images on which the fit of the camera centres agrees.
        closed: the mesh is a closed body.
        volume: relative error, scale by the cameras.
        shape: (3,) relative errors of I / V^(5/3), ascending moments.
        k: (2,) errors of k1, k2.
        centre: distance of the centres of mass over the object's greatest extent.
        strays: greatest distance of the run's surface from the CAD over the object's greatest extent. Beyond about
            0.05 something else than the object is in the mesh.
        iou_median, iou_worst: intersection over union of the run's silhouettes with the true ones.
        masks: silhouettes that were compared.
        holds: `interval_90` holds the truth, for each of volume, I1, I2, I3, k1, k2.
        half_width: of the volume's interval, relative.
        confidence: the level that the run states, or an empty text.
        together: volume, (3,) I / V^(5/3) and (2,) k of what mesh and motion say together, as errors; None where the run gives none.
    """

    exit_code: int = -1
    cpu_seconds: float = float("nan")
    images: int = 0
    registered: int = 0
    agree: int = 0
    closed: bool = False
    volume: float = float("nan")
    shape: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    k: np.ndarray = field(default_factory=lambda: np.full(2, np.nan))
    centre: float = float("nan")
    strays: float = float("nan")
    iou_median: float = float("nan")
    iou_worst: float = float("nan")
    masks: int = 0
    holds: dict[str, bool] = field(default_factory=dict)
    half_width: float = float("nan")
    confidence: str = ""
    together: tuple[float, np.ndarray, np.ndarray] | None = None


def fit_cameras(ours: np.ndarray, true: np.ndarray, seed: int = 0) -> CameraFit | None:
    """The similarity on which most camera centres agree; None where fewer than four do.

    Args:
        ours: (n, 3) centres in the run's axes.
        true: (n, 3) the same cameras in object axes, whose origin is the object's centre of mass.
        seed: of the random triples.
    """
    if len(ours) < 4:
        return None
    rng = np.random.default_rng(seed)
    reach = AGREES * np.linalg.norm(true, axis=1)
    best = np.zeros(len(ours), bool)
    for _ in range(TRIPLES):
        three = rng.choice(len(ours), 3, replace=False)
        agree = _off(_similarity(ours[three], true[three]), ours, true) < reach
        best = agree if agree.sum() > best.sum() else best
    for _ in range(5):
        if best.sum() < 4:
            return None
        matrix = _similarity(ours[best], true[best])
        best = _off(matrix, ours, true) < reach
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    return CameraFit(scale=scale, R=matrix[:3, :3] / scale, t=matrix[:3, 3], agree=best)


def _similarity(ours: np.ndarray, true: np.ndarray) -> np.ndarray:
    return np.asarray(procrustes(ours, true, reflection=False, return_cost=False))


def _off(matrix: np.ndarray, ours: np.ndarray, true: np.ndarray) -> np.ndarray:
    return np.linalg.norm(ours @ matrix[:3, :3].T + matrix[:3, 3] - true, axis=1)


def judge_mesh(mesh: trimesh.Trimesh, truth: SceneTruth, fit: CameraFit | None) -> dict[str, Any]:
    """Errors of a closed mesh in the run's axes: the fields of `Judgement` that need nothing else."""
    if not mesh.is_volume:
        return {"closed": False}
    ours = mass_properties(mesh, 1.0)
    shape = ours.principal_moments / ours.volume ** (5 / 3)
    true = truth.moments / truth.volume ** (5 / 3)
    logs = [np.log(m[:2] / m[1:]) for m in (ours.principal_moments, truth.moments)]
    found: dict[str, Any] = {"closed": True, "shape": shape / true - 1, "k": logs[0] - logs[1]}
    if fit is None:
        return found
    length = float(truth.mesh.extents.max())
    found["volume"] = ours.volume * fit.scale**3 / truth.volume - 1
    found["centre"] = float(np.linalg.norm(fit.apply(ours.center_of_mass[None])[0])) / length
    points = fit.apply(mesh.vertices)
    points = points[:: max(1, len(points) // 5000)]
    found["strays"] = float(trimesh.proximity.closest_point(truth.mesh, points)[1].max()) / length
    return found


def judge_intervals(document: dict[str, Any], truth: SceneTruth) -> dict[str, Any]:
    """Whether `interval_90` of `massprops.json` holds the truth, in the document's own unit: metres of a stereo pair; where no length is
    given the object's greatest length, and the interval says how well that is known too."""
    bounds = document.get("interval_90") or {}
    k = np.log(truth.moments[:2] / truth.moments[1:])
    true = {f"k{i + 1}": (bounds.get(f"k{i + 1}"), float(k[i])) for i in (0, 1)}
    found: dict[str, Any] = {}
    if bounds.get("volume"):
        found["half_width"] = float(np.ptp(bounds["volume"])) / 2 / float(document["volume"])
    metric, density = document["units"]["length"] == "m", float(document["density"])
    unit = 1.0 if metric else greatest_length(np.asarray(truth.mesh.vertices))[0]
    true["volume"] = (bounds.get("volume"), truth.volume / unit**3)
    for i, moment in enumerate(truth.moments):
        interval = (bounds.get("principal_moments") or [None] * 3)[i]
        true[f"I{i + 1}"] = (interval, density * moment / unit**5)
    found["holds"] = {
        name: interval is not None and None not in interval and bool(interval[0] <= value <= interval[1])
        for name, (interval, value) in true.items()
    }
    return found


def judge_together(
    document: dict[str, Any], truth: SceneTruth, fit: CameraFit | None
) -> tuple[float, np.ndarray, np.ndarray] | None:
    """Errors of the recommended values where they are of mesh and motion together: volume, (3,) I / V^(5/3), (2,) k."""
    values = document.get("recommended") or {}
    if values.get("source") != "fused":
        return None
    moments = np.array(values["principal_moments"]) / float(document["density"])
    ours, true = (m / v ** (5 / 3) for m, v in ((moments, values["volume"]), (truth.moments, truth.volume)))
    k = np.array([values["k1"], values["k2"]]) - np.log(truth.moments[:2] / truth.moments[1:])
    volume = float("nan") if fit is None else float(values["volume"]) * fit.scale**3 / truth.volume - 1
    return volume, ours / true - 1, k


def judge_masks(masks: dict[int, np.ndarray], truth: SceneTruth) -> dict[str, Any]:
    """Intersection over union of silhouettes with the CAD's.

    Args:
        masks: row of the truth -> (h, w) bool, in the size of the source or reduced.
    """
    values = []
    for row, mask in masks.items():
        factor = mask.shape[1] / float(truth.size[row, 0])
        K = np.diag([factor, factor, 1.0]) @ truth.K
        size = np.array([mask.shape[1], mask.shape[0]])
        true = silhouette(truth.mesh.vertices, truth.mesh.faces, truth.poses[row], K, truth.distortion, size)
        values.append(intersection_over_union(mask, true))
    if not values:
        return {}
    return {"masks": len(values), "iou_median": float(np.median(values)), "iou_worst": float(min(values))}


def judge_run(run: Path, truth: SceneTruth, exit_code: int = -1, cpu_seconds: float = float("nan")) -> Judgement:
    """Judges a run folder by its public files: `sparse/`, `mesh.ply`, `masks/` and `massprops.json`.

    Args:
        run: the run folder; whatever is missing there stays NaN.
        truth: of the scene.
        exit_code, cpu_seconds: of the command.
    """
    rows, centres = run_cameras(run, truth)
    fit = fit_cameras(centres, truth.centres[rows])
    found: dict[str, Any] = {"images": len(truth.poses), "registered": len(rows)}
    found["agree"] = 0 if fit is None else int(fit.agree.sum())
    if (run / "mesh.ply").is_file():
        found |= judge_mesh(trimesh.load(run / "mesh.ply", force="mesh"), truth, fit)
    if (run / "massprops.json").is_file():
        document = json.loads((run / "massprops.json").read_text())
        found |= judge_intervals(document, truth)
        found["confidence"] = (document.get("confidence") or {}).get("level", "")
        found["together"] = judge_together(document, truth, fit)
    return Judgement(exit_code=exit_code, cpu_seconds=cpu_seconds, **found, **judge_masks(run_masks(run, truth), truth))


def run_cameras(run: Path, truth: SceneTruth) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the truth and camera centres (n, 3), in the run's axes, of the images that were placed."""
    import pycolmap

    if not (run / "sparse").is_dir():
        return np.zeros(0, int), np.zeros((0, 3))
    model = pycolmap.Reconstruction(run / "sparse")
    found = {}
    for image in model.images.values():
        row = truth.row(image.name)
        if image.has_pose and row is not None:
            found[row] = image.projection_center()
    rows = np.array(sorted(found), int)
    return rows, np.array([found[r] for r in rows]).reshape(-1, 3)


def run_masks(run: Path, truth: SceneTruth) -> dict[int, np.ndarray]:
    """Row of the truth -> silhouette (h, w) bool of the files `masks/**/IMAGE.png`; none of an image that was left out, all of whose
    pixels cannot be told."""
    masks = {}
    for path in sorted((run / "masks").rglob("*.png")):
        row, mask = truth.row(str(path.with_suffix(""))), cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if row is not None and not (mask == 128).all():
            masks[row] = mask > 127
    return masks
