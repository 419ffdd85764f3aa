"""`massprops estimate`: every estimator that a sequence allows, on one problem, from one start and one prior."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from massprops.core.log import log
from massprops.core.outputs import verify
from massprops.core.progress import Progress, silent
from massprops.documents.loading import excerpt
from massprops.errors import InputError, MasspropsError, NotPossible
from massprops.estimators.outcome import Outcome

if TYPE_CHECKING:
    from massprops.estimators.methods import Method
    from massprops.estimators.prior import FilterPrior, PriorTest
    from massprops.estimators.result import Estimate, Prior
    from massprops.model.problem import Problem
    from massprops.sequence.data import Sequence

REFERENCE = "smoother"
"""The method that the others are measured against, and that judges a prior."""

BREAKS = (ArithmeticError, ValueError, IndexError)
"""What numbers that overflow or are none end in, inside one method; numpy's LinAlgError is a ValueError."""

EQUAL = 1e-14
"""Of the cosine of half a turn: rounding."""
NO_TURN = "all attitudes are the same: the body does not turn"
MOST_FEATURES, MOST_MATCHED_FEATURES = 300, 3000
"""Longest tracks used: those of structure from motion are many and short, and each adds to what images show."""


def estimate_all(
    source: str | Path | Sequence,
    methods: Iterable[str] = ("all",),
    prior: str | Path | Prior | None = None,
    progress: Progress = silent,
    model: str | Path | None = None,
    body_known: bool = True,
) -> Outcome:
    """Motion and inertia ratios of a sequence by several estimators; with what was skipped, the judgement of the prior and
    the problem itself.

    Args:
        source: sequence folder, run folder, or a `Sequence`.
        methods: names of estimators, or `all`.
        prior: file of `massprops export --to filter`, or a `Prior`.
        progress: told of each method.
        model: `model.yaml` of `massprops diagnose`, for the methods that take one.
        body_known: False hides `body.yaml` from the estimators, for a comparison with the mesh that wrote it.

    Raises:
        InputError: unknown method, unreadable sequence or prior.
        NotPossible: every method asked for by name needs what the sequence lacks.
    """
    from massprops.model import load_model
    from massprops.model.measured_wheel import measured_wheel
    from massprops.model.problem import problem_of
    from massprops.sensing.check import check_sensors
    from massprops.sequence.read import read_sequence

    chosen, named = chosen_methods(methods)
    given = _read_prior(prior)
    effects = None if model is None else load_model(model)
    if isinstance(source, str | Path):
        verify(Path(source), "sequence/")
    sequence = read_sequence(source) if isinstance(source, str | Path) else source
    check_sensors(sequence)
    matched = sequence.of_run or 1 not in sequence.cameras
    problem = problem_of(sequence, MOST_MATCHED_FEATURES if matched else MOST_FEATURES)
    if not body_known:
        problem = replace(problem, body=None)
    rotor = sequence.rotor
    first, last = problem.stamp_ns[[0, -1]]
    wheel = None if rotor is None else measured_wheel(rotor, int(first), int(last), problem.first_ns)
    if wheel is not None and effects is not None and wheel.NAME not in effects.names:
        line = f"rotor0 is not used: the model that --model names has no {wheel.NAME}"
        problem = replace(problem, warnings=(*problem.warnings, line))
    return run_methods(problem, chosen, given, progress, effects, named, wheel)


def run_methods(
    problem: Problem,
    chosen: list[Method],
    prior: FilterPrior | None = None,
    progress: Progress = silent,
    model: Any = None,
    named: bool = False,
    wheel: ModuleType | None = None,
) -> Outcome:
    """Runs the methods one after the other; one that gives up does not cost the others.

    Args:
        problem: the measurements.
        chosen: modules of `massprops.estimators.methods`.
        prior: what is believed of the body beforehand; judged by the data first, and left out when they contradict it.
        progress: told of each method.
        model: what `massprops.dynamics.model.load_model` gave, or None.
        named: the user named the methods: it is an error if none of them can run.
        wheel: what `massprops.model.measured_wheel` made of rotor0, or None.

    Raises:
        NotPossible: every named method lacks what it needs.
    """
    from massprops.estimators.judgement import against
    from massprops.estimators.needs import unmet

    lacks = {method.NAME: unmet(method, problem) for method in chosen}
    skipped = {name: lack for name, lack in lacks.items() if lack}
    able = [method for method in chosen if method.NAME not in skipped]
    if not able:
        if named:
            raise NotPossible("; ".join(f"{name} {lack}" for name, lack in skipped.items()))
        return Outcome(problem, skipped=skipped, warnings=problem.warnings)
    bench, warnings = _Bench(problem, model, wheel), list(problem.warnings)
    total = len(able) + 1
    progress(0, total, "start")
    start = bench.start(any(getattr(method, "BEGINS_EARLY", False) for method in able))
    verdict = None if prior is None else _judged_prior(prior, bench, able, start, warnings)
    belief = None if verdict is None else verdict.prior
    warnings += [line for line in getattr(start, "warnings", ()) if line not in warnings]
    estimates, cpu = [], {}
    for number, method in enumerate(able, 1):
        progress(number, total, method.NAME)
        log.info("method %s", method.NAME)
        begun = time.process_time()
        try:
            estimate = bench.run(method, belief, start)
        except NotPossible as stop:
            skipped[method.NAME] = str(stop)
            continue
        finally:
            cpu[method.NAME] = time.process_time() - begun
        if estimate.cpu_us_per_step is None:
            estimate = replace(estimate, cpu_us_per_step=1e6 * cpu[method.NAME] / len(bench.problem.times))
        estimates.append(estimate)
    progress(total, total, "")
    reference = next((e for e in estimates if e.name == REFERENCE), None)
    if reference is not None:
        estimates = [e if e is reference else against(e, reference) for e in estimates]
    return Outcome(bench.problem, estimates, skipped, cpu, verdict, tuple(dict.fromkeys(warnings)))


def _judged_prior(prior: FilterPrior, bench: _Bench, able: list[Method], start: Any, warnings: list[str]) -> PriorTest:
    """What the data say of the prior, by the reference method where it can run; warnings are added to the list."""
    from massprops.estimators.methods import methods
    from massprops.estimators.needs import unmet
    from massprops.estimators.prior import judge

    reference = None
    judges = [m for m in methods().values() if m.NAME == REFERENCE and not unmet(m, bench.problem)] or able[:1]
    try:
        reference = bench.run(judges[0], None, start)
    except NotPossible as stop:
        warnings.append(f"the prior could not be checked: {judges[0].NAME}: {stop}")
    verdict = judge(prior, reference, start, bench.problem)
    warnings += verdict.warnings
    return verdict


def chosen_methods(names: Iterable[str]) -> tuple[list[Method], bool]:
    """The modules of the named methods, and whether the user named them one by one.

    Raises:
        InputError: no such method.
    """
    from massprops.estimators.methods import methods

    known = methods()
    wanted = [names] if isinstance(names, str) else list(names)
    wanted = [part for name in wanted for part in name.replace(",", " ").split()] or ["all"]
    for name in wanted:
        if name != "all" and name not in known:
            raise InputError(f"--method {name}: no such estimator; there are {', '.join(known)} and all")
    if "all" in wanted:
        return list(known.values()), False
    return [module for name, module in known.items() if name in wanted], True


class _Bench:
    """One problem on which methods run; a method's failure in its arithmetic is a reason, not a crash."""

    def __init__(self, problem: Problem, model: Any, wheel: ModuleType | None) -> None:
        self.problem, self.model, self.wheel = problem, model, wheel

    def start(self, early: bool) -> Any:
        """`first_guess` of the problem, with its early part where a method begins there; the reason when it cannot be
        had, for methods that need none. Attitudes whose errors hang together are believed less from here on, and a known
        wheel is the model where the user gave none."""
        from massprops.estimators.attitude_noise import with_correlated_noise
        from massprops.estimators.filters.begin import early_start
        from massprops.estimators.known_wheel import model_of_wheel
        from massprops.estimators.start import first_guess

        still, alone = _still(self.problem), not (self.problem.has_tracks or self.problem.has_rates)
        if still and alone:  # the arithmetic below may or may not break down on this
            return _NoStart(NO_TURN)
        try:
            whole = first_guess(self.problem)
            self.problem, line = with_correlated_noise(self.problem, whole)
            if line:
                whole = first_guess(self.problem)
                whole = replace(whole, warnings=(*whole.warnings, line))
            if self.wheel is not None and self.model is None:
                self.model = model_of_wheel(self.wheel, self.problem, whole)
        except NotPossible as stop:
            return _NoStart(str(stop))
        except BREAKS as error:
            if still:
                return _NoStart(NO_TURN)
            return _NoStart(f"its arithmetic broke down ({type(error).__name__}: {excerpt(error)})")
        return replace(whole, early=early_start(self.problem, whole)) if early else whole

    def run(self, method: Method, prior: Prior | None, start: Any) -> Estimate:
        """One estimate, checked.

        Raises:
            NotPossible: the method gives up, with the reason.
        """
        import inspect

        from massprops.estimators.judgement import judged
        from massprops.estimators.known_wheel import without_wheel
        from massprops.estimators.result import Prior

        if isinstance(start, _NoStart) and getattr(method, "NEEDS_START", True):
            raise NotPossible(f"no start: {start.reason}")
        takes_model = "model" in inspect.signature(method.estimate).parameters
        extra = {"model": self.model} if self.model is not None and takes_model else {}
        try:
            estimate = judged(method.estimate(self.problem, prior or Prior(), start, **extra), self.problem)
        except MasspropsError as error:
            raise NotPossible(str(error)) from None
        except BREAKS as error:
            raise NotPossible(f"its arithmetic broke down ({type(error).__name__}: {excerpt(error)})") from None
        return estimate if self.wheel is None or takes_model else without_wheel(estimate)


def _still(problem: Problem) -> bool:
    """Whether the attitudes that are there are all one."""
    import numpy as np

    q = problem.attitude[np.isfinite(problem.attitude[:, 0])] if problem.has_attitude else np.zeros((0, 4))
    return len(q) > 1 and bool(np.abs(q @ q[0]).min() > 1.0 - EQUAL)


@dataclass(frozen=True)
class _NoStart:
    reason: str
    warnings: tuple[str, ...] = ()


def _read_prior(prior: str | Path | Prior | None) -> FilterPrior | None:
    if prior is None:
        return None
    from massprops.estimators.prior import FilterPrior, read_filter
    from massprops.estimators.result import Prior

    if isinstance(prior, FilterPrior):
        return prior
    if isinstance(prior, Prior):
        return FilterPrior(prior)
    return read_filter(prior)
