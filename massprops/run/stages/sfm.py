"""Stage: cameras and points of the footage."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.errors import InputError, NotPossible
from massprops.run.job import Job
from massprops.sfm.model_bytes import write_model

if TYPE_CHECKING:
    import pycolmap

    from massprops.sequence.data import AttitudeSeries
    from massprops.sfm.footage import FootageRecord
    from massprops.sfm.last_adjustment import SolvedCamera
    from massprops.sfm.points import SparsePoints
    from massprops.sfm.rolling_shutter import Shutter
    from massprops.views import Views

READS = ("capture",)
OPTIONS = ("mapper", "sparse", "focal", "motion", "masks")

LENS = {
    "SIMPLE_PINHOLE": "no distortion",
    "SIMPLE_RADIAL": "k1",
    "RADIAL": "k1 k2",
    "OPENCV": "k1 k2 p1 p2 fx fy",
    "OPENCV_FISHEYE": "fisheye",
}
"""What is estimated of a lens, by COLMAP's name of the model."""


def run(job: Job) -> dict[str, Any]:
    """Writes views.npz, points.npz, sparse/ and sfm.json; matches.npz too where pairs of images contradict the model, and frames/ and
    masks/ where a rolling shutter was corrected."""
    from massprops.sfm.footage import read_footage

    footage = read_footage(job.work("capture"))
    if job.options.mapper not in ("incremental", "global"):
        raise InputError(f"--mapper {job.options.mapper}: unknown; use incremental or global")
    document = _import(job, footage) if job.options.sparse else _placed(job, footage)
    for line in document["warnings"]:
        job.warn(line)
    (job.out / "sfm.json").write_text(json.dumps(document, indent=1))
    facts = {k: document[k] for k in ("registered", "reprojection_error_px", "focal_px", "focal_sigma_relative")}
    return (
        facts if document["imported"] else {**facts, "lens": document["lens"], "shutter": document["shutter"]["state"]}
    )


def _placed(job: Job, footage: FootageRecord) -> dict[str, Any]:
    """By what the images have in common; where that is not enough, by attitudes that the sequence gives."""
    try:
        return _solve(job, footage)
    except NotPossible as error:
        given = _attitudes(Path(job.options.source)) if footage.motion == "tumbling" else None
        if given is None:
            raise
        shutil.rmtree(job.out / "tmp", ignore_errors=True)
        return _by_attitudes(job, footage, given, str(error))


def _attitudes(source: Path) -> AttitudeSeries | None:
    from massprops.sequence.read import sequence_with

    sequence = sequence_with(source, "attitude0")
    return None if sequence is None else sequence.attitude


def _by_attitudes(job: Job, footage: FootageRecord, given: AttitudeSeries, because: str) -> dict[str, Any]:
    """Writes what `_import` does; because: why the images did not place themselves."""
    from massprops.sfm.given_attitudes import place_by_attitudes
    from massprops.sfm.points import SparsePoints

    job.progress(0, 1, "placing by attitudes and outlines")
    try:
        placed = place_by_attitudes(footage, given, job.seed)
    except NotPossible as error:
        raise NotPossible(f"{because}. By attitude0 they could not be placed either: {error}") from error
    job.progress(1, 1, "placing by attitudes and outlines")
    line = (
        f"the images were placed by attitude0 and the object's outlines, which miss each other by {placed.path.error_px:.1f} px, "
        f"as they have too little in common: {because}"
    )
    np.savez(job.out / "precision.npz", attitude=placed.sigma)
    return _given(job, footage, (placed.model, placed.views, SparsePoints.none()), [line, *placed.warnings])


def _solve(job: Job, footage: FootageRecord) -> dict[str, Any]:
    from massprops.sfm.attempt import SfmOptions
    from massprops.sfm.reconstruct import reconstruct

    work = job.out / "tmp"
    work.mkdir(parents=True)
    # with two threads the solver's sums round differently from run to run, and an outlier decided otherwise moves the
    # focal length by a tenth of a percent
    options = SfmOptions(mapper=job.options.mapper, seed=job.seed, threads=1, parts=job.parts)
    result = reconstruct(footage, work, options, job.progress)
    for part in result.corrected.iterdir() if result.corrected else ():  # frames/, perhaps masks/, and what moved them
        part.rename(job.out / part.name)
    shutil.rmtree(work)
    cameras = [_camera(footage, c) for c in result.cameras]
    result.views.save(job.out / "views.npz")
    result.points.save(job.out / "points.npz")
    shown = result.precision.shown
    precision: dict[str, Any] = {"attitude": result.precision.attitude}
    if shown is not None:
        precision |= {"inertia": shown.inertia, "inertia_covariance": shown.covariance}
    np.savez(job.out / "precision.npz", **precision)
    write_model(result.model, job.out / "sparse")
    if result.against.matches:
        result.against.matches.save(job.out / "matches.npz")
    rig = footage.rig and _seen_by(result.views.names) > 1
    return {
        "models": [{"images": n, "points": p} for n, p in result.models],
        "given": len(footage.frames),
        "registered": len(result.views),
        "points": len(result.points.xyz),
        "reprojection_error_px": _mean_error(result.points),
        "residual_rms_px": result.precision.rms_px,
        "contradicted_share": result.against.share,
        "matches_required": result.matches_required,
        "masked": result.masked,
        "unsure": result.unsure,
        "focal_px": result.cameras[0].focal_px[0],
        "focal_sigma_relative": _finite(result.precision.focal_relative),
        "distortion": list(result.cameras[0].distortion),
        "distortion_estimated": any(c.estimated for c in result.cameras),
        "cameras": cameras,
        "lens": _lens_line(cameras),
        "shutter": _shutter(result.shutter),
        # the mounting of the second camera is in metres, and the adjustment keeps it
        "scale_metres_per_unit": 1.0 if rig else None,
        "imported": False,
        "warnings": list(result.warnings),
    }


def _camera(footage: FootageRecord, camera: SolvedCamera) -> dict[str, Any]:
    """One camera of `sfm.json`; `held_out_px` is the error of observations set aside, by lens model."""
    prior = next(c for c in footage.cameras if c.id == camera.id)
    return {
        "id": camera.id,
        "device": prior.device,
        "images": camera.images,
        "given": sum(f.camera == camera.id for f in footage.frames),
        "focal_px": list(camera.focal_px),
        "focal_sigma_relative": _finite(camera.focal_sigma_relative),
        "focal_prior_px": prior.focal_px,
        "focal_source": prior.focal_source,
        "model": camera.lens.model,
        "distortion": list(camera.distortion),
        "distortion_estimated": camera.estimated,
        "held_out_px": camera.lens.held_out_px,
        "held_out": camera.lens.observations,
    }


def _shutter(shutter: Shutter) -> dict[str, Any]:
    """`shutter` of `sfm.json`: `readout` in frames, from the first row (or column) to the last."""
    if shutter.readout is None:
        return {"state": shutter.state}
    return {
        "state": shutter.state,
        "readout": shutter.readout.duration,
        "sigma": shutter.sigma,
        "along": "rows" if shutter.readout.axis == 1 else "columns",
        "moved_px": shutter.moved_px,
        "held_out_px": list(shutter.held_out_px),
        "said": shutter.said(),
        "doubtful": shutter.doubtful,
    }


def _lens_line(cameras: list[dict[str, Any]]) -> str:
    """The lens models in one line, with the errors that decided."""
    parts = []
    for c in cameras:
        who = f"camera {c['id']}: " if len(cameras) > 1 else ""
        tried = ", ".join(f"{LENS[m]} {e:.3f}" for m, e in c["held_out_px"].items())
        parts.append(f"{who}{LENS[c['model']]}" + (f" (held-out error in px: {tried})" if tried else ""))
    return "; ".join(parts)


def _import(job: Job, footage: FootageRecord) -> dict[str, Any]:
    from massprops.sfm.precision import precision
    from massprops.sfm.sparse_import import import_sparse

    job.progress(0, 1, "import")
    model, views, points, warnings = import_sparse(Path(str(job.options.sparse)), footage)
    free = not all(c.focal_source == "given" for c in footage.cameras)
    accuracy = precision(views, points, free, 0, 1.0)
    np.savez(job.out / "precision.npz", attitude=accuracy.attitude)
    job.progress(1, 1, "import")
    facts = {"residual_rms_px": _finite(accuracy.rms_px), "focal_sigma_relative": _finite(accuracy.focal_relative)}
    return _given(job, footage, (model, views, points), warnings) | facts


def _given(
    job: Job,
    footage: FootageRecord,
    placed: tuple[pycolmap.Reconstruction, Views, SparsePoints],
    warnings: list[str],
) -> dict[str, Any]:
    """`sfm.json` of images whose poses were given, and its files."""
    model, views, points = placed
    views.save(job.out / "views.npz")
    points.save(job.out / "points.npz")
    write_model(model, job.out / "sparse")
    return {
        "models": [{"images": model.num_reg_images(), "points": model.num_points3D()}],
        "given": len(footage.frames),
        "registered": len(views),
        "points": len(points.xyz),
        "reprojection_error_px": _mean_error(points),
        "residual_rms_px": None,
        "focal_px": float(views.K[0, 0, 0]),
        "focal_sigma_relative": 0.0,
        "distortion": [float(v) for v in views.distortion[0]],
        "distortion_estimated": bool(np.any(views.distortion)),
        "scale_metres_per_unit": None,
        "imported": True,
        "warnings": warnings,
    }


def _seen_by(names: tuple[str, ...]) -> int:
    return len({n.split("/", 1)[0] for n in names})


def _mean_error(points: SparsePoints) -> float | None:
    return _finite(float(np.mean(points.error))) if len(points.error) else None


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
