"""Compares each estimator with the mesh, and decides: consistent, inconsistent or unobservable, with the reason."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from massprops.consistency.film import FILM
from massprops.consistency.mesh_side import MeshSide
from massprops.consistency.motion_side import Centre, Tumble, motion_covariance
from massprops.estimators.estimate import REFERENCE
from massprops.estimators.result import Estimate
from massprops.mass.ratio_space import chi_square, log_components, p_value, turn_between

SIGNIFICANT = 0.0027
"""Agreement that chance would spoil less often than this, three sigma of one number, is called inconsistent."""
WIDEST_K = 0.3
"""1-sigma of k1 or k2 above which a motion shows nothing of the ratios."""
SMALLEST_WANDER = np.radians(0.5)
"""Wander of the rate's direction in the body below which a spin is flat."""
FLAT = 3.0
"""Wander over the noise's own below which it is noise."""
LEAST_TURN = np.radians(20.0)
"""Whole angle below which a body counts as at rest."""
ELSEWHERE = "the body turns about another point than the mesh's centre of mass"


@dataclass(frozen=True)
class Compared:
    """One estimator beside the mesh.

    Attributes:
        found: the estimate; turn: (3, 3) its body axes to the mesh's, None when nothing ties them; tied_by: what does.
        covariance: (5, 5) of its `log_components` in the mesh's principal axes; None without a tie.
        chi2, degrees, p: of ratios and axes together (of the ratios alone without a tie); None when not sound.
        p_ratios, p_axes: of each alone.
        misalignment: [rad] between principal frames modulo their symmetries; sigma_axis: of it, both sides together.
        scale: mesh length over the estimate's, from common features, or None.
    """

    found: Estimate
    turn: np.ndarray | None = None
    tied_by: str = "none"
    chi2: float | None = None
    degrees: int = 0
    p: float | None = None
    p_ratios: float | None = None
    p_axes: float | None = None
    misalignment: float | None = None
    sigma_axis: float | None = None
    scale: float | None = None
    covariance: np.ndarray | None = None

    @property
    def sound(self) -> bool:
        return self.chi2 is not None


def is_sound(estimate: Estimate) -> bool:
    """Whether an estimate claims ratios with a covariance."""
    return bool(
        estimate.converged
        and estimate.observable
        and estimate.inertia is not None
        and estimate.k_covariance is not None
    )


def compare_one(
    estimate: Estimate,
    mesh: MeshSide,
    tie: tuple[np.ndarray, str] | None,
    scale: float | None,
    alike: np.ndarray | None = None,
) -> Compared:
    """The chi-square of ratios and axes, in the mesh's principal frame.

    Args:
        alike: (5, 5) see `motion_covariance`.
    """
    if not is_sound(estimate):
        return Compared(estimate)
    assert estimate.inertia is not None
    turn, how = tie if tie is not None else (None, "none")
    if turn is None:
        axes = np.linalg.eigh(estimate.inertia)[1]
        difference = log_components(estimate.inertia, axes)[:2] - mesh.k
        spread = motion_covariance(estimate, np.eye(3), axes)[:2, :2] + mesh.covariance[:2, :2]
        chi2, degrees = chi_square(difference, spread)
        p = p_value(chi2, degrees)
        return Compared(estimate, None, how, chi2, degrees, p, p, scale=scale)
    return compare_tied(estimate, mesh, (turn, how), motion_covariance(estimate, turn, mesh.axes, alike), scale)


def compare_tied(
    estimate: Estimate, mesh: MeshSide, tie: tuple[np.ndarray, str], motion: np.ndarray, scale: float | None = None
) -> Compared:
    """As `compare_one`, of an estimate whose axes are tied to the mesh's, with the covariance (5, 5) of its `log_components`."""
    if not is_sound(estimate):
        return Compared(estimate)
    assert estimate.inertia is not None
    turn, how = tie
    inertia = turn @ estimate.inertia @ turn.T
    difference = log_components(inertia, mesh.axes) - log_components(mesh.inertia, mesh.axes)
    spread = motion + mesh.covariance
    with_axes = estimate.axes_covariance is not None
    use = slice(0, 5) if with_axes else slice(0, 2)
    chi2, degrees = chi_square(difference[use], spread[use, use])
    ratios_alone = chi_square(difference[:2], spread[:2, :2])
    axes_alone = chi_square(difference[2:], spread[2:, 2:]) if with_axes else (0.0, 0)
    away = turn_between(np.linalg.eigh(inertia)[1], mesh.axes)
    return Compared(
        found=estimate,
        turn=turn,
        tied_by=how,
        chi2=chi2,
        degrees=degrees,
        p=p_value(chi2, degrees),
        p_ratios=p_value(*ratios_alone),
        p_axes=p_value(*axes_alone) if with_axes else None,
        misalignment=float(np.linalg.norm(away)),
        sigma_axis=_sigma_of_turn(spread, mesh, away) if with_axes else None,
        scale=scale,
        covariance=motion,
    )


def _sigma_of_turn(spread: np.ndarray, mesh: MeshSide, away: np.ndarray) -> float:
    """1-sigma [rad] of the angle between the frames, along the turn that was found."""
    gaps = np.maximum(np.abs([mesh.k[1], mesh.k.sum(), mesh.k[0]]), 1e-9)
    cov = spread[2:, 2:] / np.outer(gaps, gaps)
    size = float(np.linalg.norm(away))
    direction = away / size if size > 1e-12 else np.full(3, 3**-0.5)
    return float(min(np.sqrt(max(direction @ cov @ direction, 0.0)), np.pi))


@dataclass(frozen=True)
class Verdict:
    """`verdict`, its p-value, one sentence of reason, what it hints at, and the estimator it rests on."""

    verdict: str
    p_value: float | None
    reason: str
    hints: tuple[str, ...] = ()
    rests_on: str = ""
    facts: dict[str, Any] = field(default_factory=dict)


def unobservable(reason: str, **facts: Any) -> Verdict:
    """The verdict `unobservable`, with its reason."""
    return Verdict("unobservable", None, reason, facts=facts)


def not_turning(tumble: Tumble | None) -> Verdict | None:
    """`unobservable` if the motion cannot show the ratios, whatever an estimator says; else None."""
    if tumble is None:
        return None
    degrees = np.degrees(tumble.turned)
    if tumble.turned < LEAST_TURN:
        return unobservable(f"the object turned by {degrees:.0f} deg in all: too short, or at rest")
    if tumble.wander < max(SMALLEST_WANDER, FLAT * tumble.noise):
        return unobservable(
            f"flat spin: the axis of rotation stays within {np.degrees(tumble.wander):.2f} deg of one line in the body "
            f"(noise alone gives {np.degrees(tumble.noise):.2f} deg), and a spin about one principal axis shows no ratios"
        )
    return None


def reference_of(compared: list[Compared]) -> Compared | None:
    """The estimate that the verdict rests on: the film's own adjustment by one free motion, or the smoother, or without both the sharpest
    whose residuals fit their noise.

    Where the film or else the smoother ran and found the ratios unobservable, no other estimator's claim counts. What reads the film's
    attitudes knows no more than it, and takes their errors, alike in all images, for errors of each: of a body in foil (Blender) whose
    film showed k1 to .39, the smoother said -.19 to .03 where the truth was -.89.
    """
    for name in (FILM, REFERENCE):
        for c in compared:
            if c.found.name == name and (c.sound or not c.found.observable):
                return c if c.sound else None
    sound = [c for c in compared if c.sound]

    def quality(c: Compared) -> tuple[bool, float]:
        assert c.found.k_covariance is not None
        return (c.found.innovation or 1.0) > 4.0, float(np.linalg.det(c.found.k_covariance))

    return min(sound, key=quality) if sound else None


def decide(
    compared: list[Compared],
    mesh: MeshSide,
    centre: Centre | None,
    tumble: Tumble | None,
    free: dict[str, float],
    joint: float | None = None,
) -> Verdict:
    """The verdict of all estimators, resting on the most trusted one.

    Args:
        compared: every estimator that ran.
        mesh: the mesh's side.
        centre: the point that the body turns about, where the footage shows it.
        tumble: how the attitude moved.
        free: rms residual over noise of free rotation with the motion's own inertia (`motion`) and the mesh's (`mesh`).
        joint: p-value of `fusion.agreement`, which counts in place of the single tests where there is one.
    """
    stopped = not_turning(tumble)
    if stopped is not None:
        return stopped
    best = reference_of(compared)
    p_centre = None
    if centre is not None and mesh.stated:
        p_centre = p_value(*chi_square(centre.place - mesh.centre, centre.covariance + mesh.centre_covariance))
    silent = _no_ratios(compared, best)
    if best is None or silent:
        return _by_centre(silent, mesh, centre, p_centre if tumble is not None else None, free)
    tests = {"ratios and axes" if best.turn is not None else "ratios": best.p}
    if p_centre is not None:
        tests["centre of mass"] = p_centre
    p = min(1.0, len(tests) * min(v for v in tests.values() if v is not None))
    if joint is not None:
        tests["all together"] = p = joint
    facts = {"tests": tests}
    if p >= SIGNIFICANT:
        return Verdict("consistent", p, _agreement(best), rests_on=best.found.name, facts=facts)
    if not best.found.reliable:
        # sigmas that are too small make any two bodies differ
        reason = f"the motion cannot be compared with the mesh ({best.found.name}: {best.found.because})"
        return _by_centre(reason, mesh, centre, p_centre if tumble is not None else None, free)
    if mesh.open:
        reason = (
            f"{_difference(best, mesh, tests)}; but the images leave open how large the body is, as {_filled(mesh)}"
        )
        return unobservable(reason, tests=tests)
    hints = hints_of(best, mesh, centre, tests, free)
    return Verdict("inconsistent", p, _difference(best, mesh, tests) + ": " + hints[0], hints, best.found.name, facts)


def _no_ratios(compared: list[Compared], best: Compared | None) -> str:
    """Why no estimator determines the ratios; empty if one does."""
    if best is None or best.found.k_covariance is None:
        first = sorted(compared, key=lambda c: (c.found.name != FILM, c.found.name != REFERENCE))
        reasons = [f"{c.found.name}: {c.found.reason}" for c in first if c.found.reason]
        return reasons[0] if reasons else "no estimator could be run on this footage"
    sigma = np.sqrt(np.diag(best.found.k_covariance))
    if sigma.max() > WIDEST_K:
        return (
            f"{best.found.name} gives k1 and k2 within {sigma[0]:.2g} and {sigma[1]:.2g} (one sigma): "
            "too short or too slow a motion, or a nearly symmetric body"
        )
    return ""


def _by_centre(silent: str, mesh: MeshSide, centre: Centre | None, p: float | None, free: dict[str, float]) -> Verdict:
    """The verdict where no ratios count: where the mass lies is seen without them, but alone it confirms nothing.

    Args:
        silent: why they do not. p: of the centre of mass, or None.
    """
    if p is None or p >= SIGNIFICANT:
        return unobservable(silent)
    tests: dict[str, float | None] = {"centre of mass": p}
    if centre is not None and (mesh.open or mesh.fill_reaches(centre.place)):
        return unobservable(
            f"{ELSEWHERE}, which its shape may explain, as {_filled(mesh)}, or its density ({silent})", tests=tests
        )
    hints = hints_of(None, mesh, centre, tests, free)
    return Verdict("inconsistent", p, f"{ELSEWHERE}: {hints[0]} ({silent})", hints, facts={"tests": tests})


def _filled(mesh: MeshSide) -> str:
    return f"{100 * mesh.unseen:.0f} % of the surface was filled in"


def _agreement(best: Compared) -> str:
    what = "k1, k2 and the principal axes" if best.turn is not None else "k1 and k2"
    return f"{what} of the mesh and of the motion ({best.found.name}) agree within their joint uncertainty"


def _difference(best: Compared, mesh: MeshSide, tests: dict[str, float | None]) -> str:
    parts = []
    if best.p is not None and best.p < SIGNIFICANT:
        assert best.found.k1 is not None and best.found.k2 is not None
        parts.append(
            f"k1, k2 are {mesh.k[0]:.3f}, {mesh.k[1]:.3f} by the mesh and {best.found.k1:.3f}, {best.found.k2:.3f} "
            f"by the motion ({best.found.name})"
        )
        if best.misalignment is not None:
            parts.append(f"the axes are {np.degrees(best.misalignment):.1f} deg apart")
    centre = tests.get("centre of mass")
    if centre is not None and centre < SIGNIFICANT:
        parts.append(ELSEWHERE)
    return ", ".join(parts) or "ratios, axes and centre of mass together differ by more than unseen parts can explain"


def hints_of(
    best: Compared | None,
    mesh: MeshSide,
    centre: Centre | None,
    tests: dict[str, float | None],
    free: dict[str, float],
) -> tuple[str, ...]:
    """Possible causes of the disagreement, the likeliest first; `best` is None if no estimator determines the ratios."""
    hints = []
    innovation = 1.0 if best is None else best.found.innovation or 1.0
    if innovation > 2.0 or free.get("motion", 0.0) > 2.0:
        worst = max(np.sqrt(innovation), free.get("motion", 0.0))
        hints.append(
            f"unmodelled torque: free rotation leaves residuals {worst:.1f} times their noise with any inertia "
            "(massprops diagnose names the effect)"
        )
    apart = tests.get("centre of mass")
    if apart is not None and apart < SIGNIFICANT and centre is not None:
        if mesh.fill_reaches(centre.place):
            hints.append(f"an unseen side: {_filled(mesh)}, and its shape may carry the centre of mass as far")
        off = float(np.linalg.norm(centre.place - mesh.centre))
        size = mesh.document.get("units", {}).get("length", "model")
        hints.append(
            f"density: the mass is not spread evenly, its centre lies {off:.3g} {'m' if size == 'm' else 'model units'} "
            "from the volume's"
        )
    if mesh.unseen > 0.1 and best is not None and best.covariance is not None and best.turn is not None:
        assert best.found.inertia is not None
        wide = best.covariance + 4.0 * mesh.covariance
        inertia = best.turn @ best.found.inertia @ best.turn.T
        difference = log_components(inertia, mesh.axes) - log_components(mesh.inertia, mesh.axes)
        if p_value(*chi_square(difference, wide)) >= SIGNIFICANT:
            hints.append(
                f"an unseen side: {_filled(mesh)}, and twice its stated uncertainty would cover the difference"
            )
    if best is not None and best.scale is not None and abs(np.log(best.scale)) > 0.05:
        hints.append(f"scale: the mesh is {best.scale:.3f} times as large as the motion's features say")
    if not any(h.startswith("density") for h in hints):
        line = (
            "density: a mass that is not spread evenly, or hidden inside, moves the ratios without changing the shape"
        )
        hints.append(line)
    return tuple(hints)
