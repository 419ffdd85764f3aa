"""`massprops diagnose`: fit the base model, find where it fails, name what is missing, add it, show the gap shrink."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.core.outputs import Outputs, verify
from massprops.diagnosis.criteria import SHOWN
from massprops.diagnosis.document import blind_reason, corrected
from massprops.diagnosis.search.result import Diagnosis
from massprops.errors import InputError, NotPossible

if TYPE_CHECKING:
    from massprops.diagnosis.candidate import Selection as Named
    from massprops.diagnosis.diagnose import BalanceDiagnosis
    from massprops.diagnosis.search.case import Case
    from massprops.diagnosis.search.refit import FittedModel
    from massprops.diagnosis.search.select import Selection
    from massprops.model.problem import Problem
    from massprops.sequence.data import Sequence

ASTRAY = 8.0
"""Residual over the noise at which the first guess may have gone astray."""
AGREE = 0.01
"""Relative difference of the residuals at which two guesses led to the same."""
OTHER_PATH = 0.1
"""Fall of BIC per measurement with which the base model shows the path by itself."""
BETTER_PATH = 0.5
"""Share of the excess mean square that another path must explain to be worth a selection of its own."""
NOISE_INFLATIONS = (8.0, 40.0)
"""Times the stated noise that further guesses allow for."""

NAMES = ("residual.csv", "model.yaml", "diagnosis.json", "report.html", "law.py", "law.yaml")
"""Files of a diagnosis."""

Watch = Callable[[str, int, int], None]


def diagnose(
    source: str | Path | Sequence,
    out: str | Path | None = None,
    progress: Watch = lambda what, done, total: None,
    force: bool = False,
    discover: bool = False,
    simulator: str | None = None,
) -> Diagnosis | BalanceDiagnosis:
    """Where model and data disagree, and which effect the model lacks.

    Short records of body rates, and attitudes with or without rates, go by the balance of momentum (`massprops.diagnosis`),
    everything else by the search over starts.

    Args:
        source: sequence folder, run folder, or a `Sequence`.
        out: folder for `diagnosis.json`, `model.yaml`, `residual.csv` and `report.html`.
        progress: told of each step.
        discover: look for a law too (`massprops.diagnosis.discovery`): `law` in the document, `law.py`, `law.yaml`.
        simulator: `module:function` of the user's own, fitted as a black box (`massprops.diagnosis.black_box`).

    Raises:
        InputError: an unreadable sequence, or a body file that contradicts itself.
        NotPossible: nothing in the sequence shows how the body moves, or its sensors are at fault (`check_sensors`).
    """
    from massprops.diagnosis.measured_beside import effects_beside
    from massprops.effects import in_place
    from massprops.sequence.read import read_sequence

    given = [Path(source)] if isinstance(source, str | Path) else []
    for folder in given:
        verify(folder, "sequence/", "mesh.ply", "massprops.json")
    sequence = read_sequence(source) if isinstance(source, str | Path) else source
    if out is not None and Path(out).is_file():
        raise InputError(f"{out}: is a file, not a folder: choose another place with -o")
    if out is not None:  # before the work is done
        Outputs(Path(out)).check("diagnose", NAMES, given, force)
    with in_place(effects_beside(sequence)):
        diagnosis = _found(sequence, progress, discover, simulator)
        if out is not None:
            write_found(Path(out), diagnosis, given, force)
    return diagnosis


def _found(sequence: Sequence, progress: Watch, discover: bool, simulator: str | None) -> Diagnosis | BalanceDiagnosis:
    from massprops.diagnosis.diagnose import decides, diagnose_by_balance
    from massprops.diagnosis.measured_beside import mesh_of_run
    from massprops.diagnosis.search.noise import with_track_noise
    from massprops.model.problem import problem_of
    from massprops.sensing.check import check_sensors

    if decides(sequence):
        by_balance = diagnose_by_balance(sequence, progress)
        if simulator is not None:
            by_balance.document["simulator"] = _black_box(sequence, simulator, progress)
        if discover:
            by_balance = replace(by_balance, law=_law(sequence, by_balance.document, by_balance.selection, progress))
        return by_balance
    check_sensors(sequence)
    run = None if sequence.folder is None else sequence.folder.parent
    problem = with_track_noise(sequence, problem_of(sequence))
    diagnosis = diagnose_problem(problem, progress)
    if run is not None and diagnosis.case.first.body_frame == "attitude0":
        mesh = mesh_of_run(run)
        diagnosis = replace(diagnosis, surface=None if mesh is None else mesh[0])
    if simulator is not None:
        diagnosis.document["simulator"] = _black_box(sequence, simulator, progress)
    if discover:
        names = [e["name"] for e in diagnosis.document["effects"]]
        diagnosis = replace(
            diagnosis, law=_law(sequence, diagnosis.document, names[0] if len(names) == 1 else None, progress)
        )
    return diagnosis


def _black_box(sequence: Sequence, text: str, progress: Watch) -> dict[str, Any]:
    """How well a user's simulator explains the record, and with what parameters."""
    from massprops.diagnosis.black_box.fit import document_of_black_box, fit_black_box
    from massprops.diagnosis.black_box.worker import Simulator
    from massprops.model.problem import problem_of

    progress(f"simulator {text}", 0, 1)
    simulator = Simulator(text)
    try:
        return document_of_black_box(simulator, fit_black_box(simulator, problem_of(sequence)))
    finally:
        simulator.close()


def _law(
    sequence: Sequence, document: dict[str, Any], named: Named | str | None, progress: Watch
) -> dict[str, str | bytes]:
    """Adds the law to a diagnosis, beside what the catalogue named; its files by name."""
    from massprops.diagnosis.discovery.sequence_law import files_of_law, law_of_sequence

    progress("a law for the residuals", 0, 1)
    document["law"], files = files_of_law(law_of_sequence(sequence, named))
    return files


def write_found(
    out: Path,
    found: Diagnosis | BalanceDiagnosis,
    inputs: Iterable[Path] = (),
    force: bool = False,
) -> Path:
    """The files of a diagnosis, all of them or none; see `files.write_diagnosis`."""
    from massprops.diagnosis.diagnose import contents_of
    from massprops.diagnosis.search.files import write_contents, write_diagnosis

    if isinstance(found, Diagnosis):
        return write_diagnosis(out, found, inputs, force)
    return write_contents(out, contents_of(found), inputs, force)


def diagnose_problem(problem: Problem, progress: Watch = lambda what, done, total: None) -> Diagnosis:
    """`diagnose` on measurements in memory."""
    from massprops.diagnosis.search.acceptance import explained
    from massprops.diagnosis.search.axes import otherwise
    from massprops.diagnosis.search.case import case_of
    from massprops.diagnosis.search.outlier_features import without_outlier_features
    from massprops.diagnosis.search.refit import refit
    from massprops.diagnosis.search.select import Selection, unless_shifted
    from massprops.diagnosis.search.unexplained import recovered_torque

    progress("first guess", 0, 1)
    case, base = _begin(case_of, refit, problem, progress)
    case, base = without_outlier_features(case, base)
    blind = _blind(case)
    if blind:
        selection = Selection(base, best=base)
    else:
        if not explained(base):
            progress("base model, the axes otherwise", 0, 1)
            base = otherwise(case, base)
        case, selection = _on_some_path(case, base, progress)
        selection = unless_shifted(case, selection)
    base = selection.base
    torque = None
    if selection.verdict == "unexplained":
        progress("torque without a model", 0, 1)
        torque = recovered_torque(case, base)
    history = _history(case, selection)
    document = _document(case, selection, torque, history)
    if blind:
        document["reason"] = blind
    best = selection.best if selection.best is not None else base
    return Diagnosis(document, _model(base, best), case, selection, torque, history)


def _begin(
    case_of: Callable[..., Any], refit: Callable[..., Any], problem: Problem, progress: Watch
) -> tuple[Case, FittedModel]:
    """The base model from the first guess that leads somewhere: sensors that are wrong together look like outliers to it.

    Raises:
        NotPossible: no guess shows an attitude.
    """
    best: tuple[Case, FittedModel] | None = None
    refused: NotPossible | None = None
    for inflation in (1.0, *NOISE_INFLATIONS):
        try:
            case = case_of(problem, inflation)
        except NotPossible as error:
            refused = refused or error
            continue
        progress("base model", 0, 1)
        base = refit(case, case.first.state, (), most=40)
        again = best is not None and abs(base.fitted - best[1].fitted) < AGREE * base.fitted
        if best is None or base.fitted < best[1].fitted:
            best = case, base
        if again or best[1].fitted < ASTRAY or not case.first.observed.any():
            break
    if best is None:
        raise refused or NotPossible(
            "nothing in the sequence shows how the body moves: give attitudes, body rates or tracks"
        )
    return best


def _on_some_path(case: Case, base: FittedModel, progress: Watch) -> tuple[Case, Selection]:
    """The selection of effects on the path of free fall beside the chaser, or on a straight one where that explains more:
    then one of the two is held in its place, or the record was made so."""
    from massprops.diagnosis.search.acceptance import PATH_PREDICTS, explained
    from massprops.diagnosis.search.event_time import EVIDENCE
    from massprops.diagnosis.search.refit import refit
    from massprops.diagnosis.search.stepwise import lean
    from massprops.dynamics.environment import EnvironmentModel

    if not case.environment.falls or not len(case.fitted.uv) or (explained(base) and not base.held > PATH_PREDICTS):
        return case, _selected(case, base, progress)
    warning = (
        "the target moves straight and not as in free fall beside the chaser, so a straight path is used; check the orbit in "
        "environment.yaml"
    )
    other = replace(
        case,
        environment=EnvironmentModel(case.problem.environment, falls=False, compiled=True),
        warnings=(*case.warnings, warning),
    )
    other_base = refit(other, base.fit.state, (), most=40)
    much = case.fitted.count
    if other_base.bic < base.bic - OTHER_PATH * much or explained(other_base):
        (case, base), (other, other_base) = (other, other_base), (case, base)
    selection = _selected_unless(other, case, base, progress)
    if selection is None:
        (case, base), (other, other_base) = (other, other_base), (case, base)
        selection = _selected(case, base, progress)
    best = selection.best or base
    begun = replace(best.fit.state, points=other_base.fit.state.points)
    # an effect that stood for the wrong path is idle on the right one
    same = lean(other, refit(other, begun, best.added, against=best.fit.cost))
    if explained(best) and not best.held > PATH_PREDICTS:
        if explained(same) and same.bic < best.bic - EVIDENCE:
            return other, replace(selection, base=other_base, best=same)
        return case, selection
    remaining_square, there = best.fitted**2 - 1.0, same.fitted**2 - 1.0
    if there > (1.0 - BETTER_PATH) * remaining_square:
        return case, selection
    again = _selected(other, other_base, progress)
    return (other, again) if (again.best or other_base).bic < best.bic else (case, selection)


def _selected(case: Case, base: FittedModel, progress: Watch) -> Selection:
    selection = _selected_unless(None, case, base, progress)
    assert selection is not None
    return selection


def _selected_unless(other: Case | None, case: Case, base: FittedModel, progress: Watch) -> Selection | None:
    """The selection of effects; None where one alone explains more in the `other` case."""
    from massprops.diagnosis.search.select import select

    violated = False
    if case.inertia_prior.inertia is not None:
        base, violated = _judged(case, base, case.inertia_prior.inertia)
    return select(case, base, progress, violated, other)


def _judged(case: Case, base: FittedModel, assumed: np.ndarray) -> tuple[FittedModel, bool]:
    """The base model with its inertia held at what is assumed, when the data contradict that assumption: as it is where
    that leads astray."""
    from massprops.diagnosis.search.assumed import contradicts
    from massprops.diagnosis.search.refit import refit

    if not contradicts(case, base):
        return base, False
    firm = replace(case, inertia_prior=replace(case.inertia_prior, sigma=1e-3 * case.inertia_prior.sigma))
    state = replace(base.fit.state, inertia=assumed)
    held = refit(firm, state, (), most=40)
    if held.fitted > ASTRAY * base.fitted:
        return base, True
    return replace(held, bic=base.bic), True


def _blind(case: Case) -> str:
    """Why this record can show no missing effect at all; empty when it can."""
    turned = case.speed * case.span
    return blind_reason(turned) if turned < MOST_HIDDEN_TURN else ""


MOST_HIDDEN_TURN = 0.5
"""Turn over the whole record [rad] below which free rotation and its inertia cannot be told from anything else."""


def _history(case: Case, selection: Selection) -> dict[str, Any] | None:
    from massprops.diagnosis.search.history import momentum_and_energy

    best = selection.best or selection.base
    motion = best.fit.predicted
    return momentum_and_energy(case.problem.times, motion.q, motion.motion.w, best.fit.state.inertia)


def _document(
    case: Case, s: Selection, torque: dict[str, Any] | None, history: dict[str, Any] | None
) -> dict[str, Any]:
    from massprops.diagnosis.search.assumed import DENSITY
    from massprops.diagnosis.search.where import worst_places

    base, best = s.base, s.best or s.base
    named = best if s.verdict in ("named", "ambiguous") else None
    effects = [] if named is None else _entries(named, s)
    if s.verdict == "ambiguous":
        for rival in s.rivals:
            effects += [e for e in _entries(rival, s) if e["name"] not in {x["name"] for x in effects}]
    # an effect may be fitted from several starts: the best of these is listed
    tried = {x.names: x for x in sorted(s.tried, key=lambda x: -x.bic)}
    candidates = [_entry(x, s) for x in sorted(tried.values(), key=lambda x: x.bic)]
    after = named or (best if s.verdict == "unexplained" else base)
    document = {
        "format": "massprops-diagnosis/1",
        "verdict": s.verdict,
        "reason": _reason(case, s),
        "effects": effects,
        "candidates": candidates,
        "skipped": s.skipped,
        "where": worst_places(case.problem, case.fitted, base.fit.residuals, base.fit.state.points),
        "gap": {
            "fitted": {"before": base.fitted, "after": after.fitted},
            "held_out": {"before": base.held, "after": after.held},
            "noise_floor": 1.0,
        },
        "whiteness": {"before": base.white, "after": after.white},
        "corrected": _corrected(base, after),
        "axes": AXES[case.first.body_frame],
        "model": "model.yaml",
        "warnings": list(case.warnings),
    }
    if torque is not None:
        document["torque"] = {k: v for k, v in torque.items() if k not in ("times", "torque", "sigma")}
    if history is not None:
        document["momentum"] = {k: v for k, v in history.items() if np.ndim(v) == 0}
    if named is not None and DENSITY in named.names and case.inertia_prior.inertia is not None:
        from massprops.diagnosis.search.hidden_mass import hidden_mass

        document["hidden_mass"] = hidden_mass(case.inertia_prior.inertia, whole_inertia(named))
    return document


AXES = {
    "attitude0": "body axes are those of attitude0",
    "body.yaml": "body axes are those of body.yaml, but for half turns about its principal axes, which no motion shows",
    "own": "body axes are cam0's at the first epoch that shows the body, or the gyroscope's: attitude0 or body.yaml would fix them",
}
"""What parameters in body axes refer to."""


def whole_inertia(s: FittedModel) -> np.ndarray:
    """(3, 3) inertia at the start of the record with what effects change of it, mean moment 1."""
    from massprops.dynamics.rotation import inertia_at_start

    state = s.fit.state
    inertia = inertia_at_start(state.inertia, state.model.active, state.model.flat(True))
    return 3.0 * inertia / np.trace(inertia)


def _corrected(base: FittedModel, after: FittedModel) -> dict[str, Any]:
    return corrected(*((whole_inertia(s), s.fit.state.w0) for s in (base, after)))


def _entries(model: FittedModel, s: Selection) -> list[dict[str, Any]]:
    """One entry for each effect of a model, with what that effect alone is worth."""
    out = []
    for a in model.added:
        without = [x for x in s.tried if set(x.names) == set(model.names) - {a.name}]
        rest = min(without, key=lambda x: x.bic) if without else s.base
        entry = _entry(model, s, rest)
        values, sigma = model.fit.state.model.value(a.name), model.sigma[a.name]
        names = [q.name for q in a.effect.PARAMETERS]
        entry["name"] = a.name
        entry["sentence"] = a.effect.SENTENCE
        entry["parameters"], entry["sigma"] = _shown(names, values, sigma)
        entry["units"] = {q.name: q.unit for q in a.effect.PARAMETERS}
        out.append(entry)
    return out


def _shown(
    names: list[str], values: np.ndarray, sigma: np.ndarray
) -> tuple[dict[str, float | None], dict[str, float | None]]:
    """Parameters with their 1-sigma, None for those that the data do not show."""
    shown = np.isfinite(sigma) & (np.abs(values) > SHOWN * sigma)
    told = [
        (n, float(v), float(e)) if k else (n, None, None)
        for n, v, e, k in zip(names, values, sigma, shown, strict=True)
    ]
    return {n: v for n, v, _ in told}, {n: e for n, _, e in told}


def _entry(model: FittedModel, s: Selection, without: FittedModel | None = None) -> dict[str, Any]:
    base = without or s.base
    parameters: dict[str, float | None] = {}
    sigma: dict[str, float | None] = {}
    for a in model.added:
        names = [q.name if len(model.added) == 1 else f"{a.name}.{q.name}" for q in a.effect.PARAMETERS]
        shown = _shown(names, model.fit.state.model.value(a.name), model.sigma[a.name])
        parameters, sigma = parameters | shown[0], sigma | shown[1]
    return {
        "name": " + ".join(model.names),
        "parameters": parameters,
        "sigma": sigma,
        "delta_bic": float(base.bic - model.bic),
        "held_out_gain": float(base.held - model.held),
        "fitted": model.fitted,
        "held_out": model.held,
        "whiteness": model.white,
        "implausible": model.implausible or None,
    }


def _reason(case: Case, s: Selection) -> str:
    base, best = s.base, s.best or s.base
    if s.verdict == "none":
        return f"the base model explains the data: residuals are {base.fitted:.2f} times the stated noise, without structure"
    if s.verdict == "named":
        return "; ".join(a.effect.SENTENCE for a in best.added)
    if s.verdict == "ambiguous":
        every = [" + ".join(x.names) for x in (best, *s.rivals)]
        return f"these data cannot tell apart: {', '.join(every)}. {_separates(case, every)}"
    if s.shift is not None:
        return (
            f"residuals of {base.fitted:.2f} times the noise, and a smooth shift of each camera's whole image ({s.shift.rms_px:.2g} px) is "
            f"as likely as any effect of the catalogue or likelier: log evidence {s.shift.gain:+.0f} over the base model, "
            f"{0.5 * (base.bic - best.bic):+.0f} with the best effect. Check the camera's mount and the tracks"
        )
    held = f", and {best.held:.2f} on data held out" if np.isfinite(best.held) else ""
    of_best = "" if best is base else f"; the best of them, {' + '.join(best.names)}, leaves {best.fitted:.2f}{held}"
    return f"residuals of {base.fitted:.2f} times the noise have structure that no effect of the catalogue accounts for{of_best}"


def _separates(case: Case, names: list[str]) -> str:
    text = " ".join(names)
    if "range" not in case.there and ("baseline-error" in text or "focal-length-error" in text):
        return "A range sensor would separate them."
    if "magnetic" in text or "eddy" in text or "solar" in text:
        return "A longer record, over which Sun and field change their direction in the body, would separate them."
    return "A longer record or a second sensor (range, body rates) would separate them."


def _model(base: FittedModel, best: FittedModel) -> dict[str, Any]:
    from massprops.model import document_of

    state = best.fit.state
    document = document_of(replace(state.model, inertia=whole_inertia(best)), best.sigma)
    document["inertia_note"] = "body axes, mean moment 1, with the effects at the start of the record"
    document["angular_velocity_rad_s"] = state.w0.tolist()
    document["attitude"] = state.q0.tolist()
    document["corrected"] = _corrected(base, best)
    return document
