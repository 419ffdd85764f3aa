"""`massprops crosscheck`: the mesh's inertia against every estimator that the run's footage allows."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from massprops.consistency.trust import enter_verdict
from massprops.core.displayed import Displayed, number
from massprops.core.files import json_text
from massprops.core.linalg import at_least
from massprops.core.outputs import Outputs, claim, deliver, verify
from massprops.core.progress import Progress, silent
from massprops.errors import InputError, NotPossible

STILL = "the object is still: nothing moves, so nothing shows its inertia"
OWNER = "crosscheck"
MOST_POINTS = 300
"""Epochs of the residuals kept for the page."""


@dataclass(frozen=True, repr=False)
class CrossCheck(Displayed):
    """The document of `crosscheck.json` with the estimates behind it.

    Attributes:
        folder: the run.
        document: `crosscheck.json`.
        estimates: of every method that ran.
        warnings: one line each.
    """

    folder: Path
    document: dict[str, Any]
    estimates: list[Any] = field(default_factory=list)
    warnings: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """`consistent`, `inconsistent` or `unobservable`."""
        return str(self.document["verdict"])

    @property
    def reason(self) -> str:
        """One sentence."""
        return str(self.document["reason"])

    @property
    def p_value(self) -> float | None:
        """How often shape and motion of one body differ as much as here; None where they could not be compared."""
        value = self.document["p_value"]
        return None if value is None else float(value)

    def report(self) -> Path:
        """The run's page."""
        return self.folder / "report.html"

    def facts(self) -> dict[str, str]:
        """Verdict, its probability and reason."""
        return {"verdict": self.verdict, "p": number(self.p_value), "reason": self.reason}


def crosscheck(
    run: str | Path,
    sequence: str | Path | None = None,
    methods: Iterable[str] = ("all",),
    write: bool = True,
    report: bool = True,
    progress: Progress = silent,
    force: bool = False,
) -> CrossCheck:
    """Shape against motion.

    The estimators see neither the mesh nor the `body.yaml` that was made from it.

    Args:
        run: a run folder with `massprops.json`.
        sequence: another sequence of the same footage, in place of the run's own.
        methods: estimators to run.
        write: whether `crosscheck.json` is written into the run.
        report: whether the run's page is made again with it.
        progress: told of each estimator.
        force: a `crosscheck.json` that massprops did not write may be replaced.

    Raises:
        InputError: no mass properties in the run, or a sequence that cannot be read.

    Example:
        >>> massprops.crosscheck("runs/demo").verdict  # doctest: +SKIP
        'consistent'
    """
    from massprops.consistency.mesh_side import read_mesh_side
    from massprops.exchange.body import READ

    folder = Path(run)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give a run that 'massprops reconstruct' made")
    outputs = Outputs(folder)
    verify(folder, *READ, *(["sequence/"] if sequence is None else []))
    if write:  # before the work is done
        outputs.check(OWNER, ["crosscheck.json"], force=force)
    result = _check(folder, read_mesh_side(folder), sequence, methods, progress)
    if write:
        if Outputs(folder).base != outputs.base:
            raise InputError(f"{folder}: was made anew in the meantime: give the command again")
        key = (outputs.files.get("crosscheck.json") or {"key": None})["key"]  # of the stage, whose place this takes
        deliver(folder, OWNER, {"crosscheck.json": json_text(result.document)}, key, force=force, derived=True)
        with claim(folder, OWNER) as held:
            enter_verdict(held, result.document)
        if report:
            from massprops.report import write_report

            write_report(folder)
    return result


def _check(
    folder: Path, mesh: Any, sequence: str | Path | None, methods: Iterable[str], progress: Progress
) -> CrossCheck:
    from massprops.consistency import verdict as judge
    from massprops.consistency.film import film_estimate
    from massprops.consistency.fusion import agreement, fuse, read_draws
    from massprops.consistency.motion_side import frame_of, scale_against, to_mesh_axes, tumble_of
    from massprops.estimators.estimate import estimate_all
    from massprops.sequence.read import read_sequence

    from_run = sequence is None
    own = read_sequence(folder) if (folder / "sequence").is_dir() else None
    footage = own if sequence is None else read_sequence(sequence)
    if footage is None:
        raise InputError(f"{folder}: no sequence/ in this run: give one of the same footage with --sequence")
    frame = None if own is None else frame_of(folder, own)
    if footage.attitude is None and footage.rates is None and (from_run or footage.tracks is None):
        return CrossCheck(folder, document(mesh, [], judge.unobservable(STILL)), warnings=footage.warnings)
    watched = frame if frame is not None and len(frame.stamp_ns) else None
    tumble = None if watched is None else tumble_of(watched.stamp_ns, watched.q, watched.sigma)
    stopped = judge.not_turning(tumble)
    try:
        outcome = estimate_all(footage, methods, progress=progress, body_known=False)
    except NotPossible as stop:
        verdict = stopped or judge.unobservable(str(stop))
        return CrossCheck(folder, document(mesh, [], verdict), warnings=footage.warnings)
    centre, slides = _centre(folder, mesh, frame)
    compared = []
    for e in outcome.estimates:
        tie = None if frame is None else to_mesh_axes(e, outcome.problem, frame, from_run)
        scaled = mesh.document["units"]["length"] == "m" and (outcome.problem.stereo or outcome.problem.has_range)
        scale = scale_against(e, frame) if frame is not None and scaled else None
        compared.append(judge.compare_one(e, mesh, tie, scale, None if slides is None else slides.inertia))
    film = film_estimate(folder, mesh.axes) if from_run else None
    # a gyroscope may show what the film does not
    if film is not None and (film[0].observable or footage.rates is None):
        compared.insert(0, judge.compare_tied(film[0], mesh, (np.eye(3), "attitude0"), film[1]))
    best = judge.reference_of(compared)
    residuals = {} if watched is None or stopped else _residuals(watched, mesh, best)
    free = {name: series["rms"] for name, series in residuals.items() if "rms" in series}
    motion = _motion(mesh, best, centre)
    draws = None if motion is None else read_draws(folder, mesh)
    joint = None if draws is None else agreement(draws, motion, mesh.length)
    verdict = judge.decide(compared, mesh, centre, tumble, free, joint)
    result = document(mesh, compared, verdict, centre, residuals, outcome.skipped)
    result["fused"] = None
    if draws is not None and best is not None and best.found.reliable and verdict.verdict == "consistent":
        result["fused"] = {"with": verdict.rests_on, **fuse(draws, mesh, motion)}
    return CrossCheck(folder, result, outcome.estimates, outcome.warnings)


def _centre(folder: Path, mesh: Any, frame: Any) -> tuple[Any, Any]:
    """The point that the body turns about, in the mesh's axes and units, and what single regions of the surface change
    of the motion; None for each where the run does not show it."""
    from massprops.consistency.motion_side import centre_of_motion, slides_of
    from massprops.sfm.points import SparsePoints
    from massprops.views import Views

    try:
        views = Views.load(folder / "work" / "sfm" / "views.npz")
        points = SparsePoints.load(folder / "work" / "sfm" / "points.npz")
    except (OSError, ValueError, KeyError):
        return None, None
    rows = np.flatnonzero(views.of_first_camera)
    stamps = views.timestamp_ns[rows]
    if not (stamps >= 0).all():
        # images without a clock: the sequence counts them, in the same order
        if frame is None or len(frame.stamp_ns) != len(rows):
            return None, None
        rows, stamps = rows[np.argsort([views.names[i] for i in rows])], frame.stamp_ns
    order = np.argsort(stamps, kind="stable")
    rows, stamps = rows[order], stamps[order]
    centre = centre_of_motion(stamps, views.R[rows], views.t[rows] * mesh.factor, mesh.length)
    seen = points.of_views(rows)
    if not len(seen.xyz) or len(rows) < 8:
        return centre, None
    sigma = frame.sigma if frame is not None and len(frame.sigma) == len(rows) else np.full(len(rows), 1e-3)
    slides = slides_of(views.take(rows), seen, stamps, sigma, mesh)
    if centre is not None:
        more = _drift(folder, mesh, views.take(rows), stamps)
        centre = replace(centre, covariance=at_least(centre.covariance, slides.centre) + more)
    return centre, slides


def _drift(folder: Path, mesh: Any, views: Any, stamps: np.ndarray) -> np.ndarray:
    """(3, 3) what the drift of the cameras, as the outlines of the run's mesh show it, adds to the centre's covariance."""
    from massprops.consistency.drift import centre_drift

    path = folder / "work" / "surface" / "surface.json"
    pixels = float(json.loads(path.read_text()).get("camera_drift_px") or 0.0) if path.is_file() else 0.0
    if not (pixels > 0 and mesh.length > 0):
        return np.zeros((3, 3))
    return centre_drift(views, stamps, pixels, mesh)


def _motion(mesh: Any, best: Any, centre: Any) -> Any:
    """What the trusted estimator and the centre of rotation say of the mesh's numbers; None where no axes are tied."""
    from massprops.consistency.fusion import measured
    from massprops.mass.ratio_space import log_components

    if best is None or best.turn is None or best.found.axes_covariance is None:
        return None
    inertia = best.turn @ best.found.inertia @ best.turn.T
    R = best.covariance
    place = () if centre is None else (centre.place, centre.covariance)
    return measured(log_components(inertia, mesh.axes), R, *place)


def _residuals(frame: Any, mesh: Any, best: Any) -> dict[str, Any]:
    """Turns left over by the best free rotation with the mesh's inertia and with the motion's, in units of noise."""
    from massprops.consistency.free_rotation import free_rotation_residuals

    times = (frame.stamp_ns - frame.stamp_ns[0]) * 1e-9
    if len(times) < 8:
        return {}
    keep = np.unique(np.linspace(0, len(times) - 1, min(len(times), MOST_POINTS)).round().astype(int))
    out: dict[str, Any] = {
        "times": times[keep].tolist(),
        "noise_deg": np.degrees(np.sqrt(3.0) * frame.sigma[keep]).round(6).tolist(),
    }
    inertias = {"mesh": mesh.inertia}
    if best is not None and best.turn is not None:
        inertias["motion"] = best.turn @ best.found.inertia @ best.turn.T
    for name, inertia in inertias.items():
        residual_turns = free_rotation_residuals(times, frame.q, frame.sigma, inertia)
        z = residual_turns / frame.sigma[:, None]
        out[name] = {
            "turn_deg": np.degrees(residual_turns[keep]).round(6).tolist(),
            "rms": float(np.sqrt(np.mean(z**2))),
            "rms_deg": float(np.degrees(np.sqrt(np.mean(np.sum(residual_turns**2, axis=1))))),
        }
    return out


def document(
    mesh: Any,
    compared: list[Any],
    verdict: Any,
    centre: Any = None,
    residuals: dict[str, Any] | None = None,
    skipped: dict[str, str] | None = None,
) -> dict[str, Any]:
    """`crosscheck.json`."""
    sigma = mesh.sigma_k if mesh.stated else (None, None)
    return {
        "format": "massprops-crosscheck/1",
        "mesh": {
            "k1": float(mesh.k[0]),
            "k2": float(mesh.k[1]),
            "sigma_k1": sigma[0],
            "sigma_k2": sigma[1],
            "k_covariance": mesh.covariance[:2, :2] if mesh.stated else None,
            "principal_axes": mesh.axes,
            "center_of_mass": mesh.centre,
        },
        "estimators": [_entry(c) for c in compared],
        "skipped": [{"name": name, "reason": reason} for name, reason in (skipped or {}).items()],
        "verdict": verdict.verdict,
        "p_value": verdict.p_value,
        "reason": verdict.reason,
        "hints": list(verdict.hints),
        "rests_on": verdict.rests_on,
        "tests": verdict.facts.get("tests", {}),
        "centre_of_motion": None
        if centre is None
        else {
            "place": centre.place,
            "sigma": np.sqrt(np.diag(centre.covariance)),
            "from_mesh": float(np.linalg.norm(centre.place - mesh.centre)),
        },
        "residuals": residuals or None,
    }


def _entry(c: Any) -> dict[str, Any]:
    e = c.found

    def degrees(value: float | None) -> float | None:
        return None if value is None else float(np.degrees(value))

    axes = None
    if c.turn is not None and e.principal_axes is not None:
        axes = c.turn @ e.principal_axes
    return {
        "name": e.name,
        **e.ratios(),
        "axis_misalignment_deg": degrees(c.misalignment),
        "sigma_axis_deg": degrees(c.sigma_axis),
        "principal_axes": axes,
        "tied_by": c.tied_by,
        "converged": bool(e.converged),
        "observable": bool(e.observable),
        "reason": e.reason,
        "chi2": c.chi2,
        "degrees": c.degrees,
        "p_value": c.p,
        "p_ratios": c.p_ratios,
        "p_axes": c.p_axes,
        "nees": None if c.chi2 is None or not c.degrees else c.chi2 / c.degrees,
        "scale": c.scale,
        "innovation": e.innovation,
        "cpu_us_per_step": e.cpu_us_per_step,
    }
