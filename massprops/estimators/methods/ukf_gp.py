"""kabir2025: the unscented filter, carried through occlusions by Gaussian processes in place of the measurements.

Beyond the paper: the variance of the process and the correlation of its errors over time are used; relative translation
is removed before the processes are trained; and the features of one body share their frequencies.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.estimators.filters.state import Measurements, Settings
from massprops.estimators.result import Estimate, Prior
from massprops.model.problem import Problem

if TYPE_CHECKING:
    from massprops.estimators.start import Start

NAME = "ukf-gp"
ORDER = 40
SENTENCE = "the unscented filter with Gaussian processes in place of measurements during occlusions (kabir2025)"
NEEDS = ("stereo|attitude|rates",)
BEGINS_EARLY = True


def estimate(problem: Problem, prior: Prior, start: Start) -> Estimate:
    """As `ukf`, with pseudo-measurements where the sequence has none; equal to it where there is no occlusion.

    Raises:
        NotPossible: the first guess found no rotation or no inertia.
    """
    from massprops.estimators.filters.begin import early_start
    from massprops.estimators.filters.features import run_through
    from massprops.estimators.filters.occlusion import fill_gap, with_gap_epochs
    from massprops.estimators.filters.outcome import estimate_of
    from massprops.estimators.filters.setup import measurements, setup

    ready = setup(problem, prior, early_start(problem, start))
    longer, gaps = with_gap_epochs(problem, ready)
    if not gaps:
        passage = run_through(problem, ready, Settings())
        notes = ("the sequence has no occlusion: the same as ukf",)
        return estimate_of(NAME, problem, ready, passage, notes)
    warnings, carried = [], 0
    rows = measurements(longer, ready, ready.first, len(longer.times), ready.chosen, fresh=True)
    for gap in gaps:
        before = _until(rows, gap.begin - ready.first)
        passage = run_through(longer, ready, Settings(), rows=before)
        rows, count, reason = fill_gap(longer, ready, gap, passage, rows, ready.chosen)
        carried += count > 0
        if reason:
            warnings.append(f"occlusion of {longer.times[gap.end - 1] - longer.times[gap.begin]:.0f} s: {reason}")
    warnings.append(f"{carried} of {len(gaps)} occlusions carried by Gaussian processes")
    passage = run_through(longer, ready, Settings(), rows=rows)
    filter_estimate = estimate_of(NAME, longer, ready, passage, tuple(warnings))
    return (
        replace(filter_estimate, cpu_us_per_step=None)
        if not np.isfinite(filter_estimate.cpu_us_per_step or 0.0)
        else filter_estimate
    )


def _until(rows: Measurements, n: int) -> Measurements:
    """The first n epochs."""
    cut: dict[str, Any] = {
        name: None if getattr(rows, name) is None else getattr(rows, name)[:n]
        for name in ("dt", "z", "variance", "attitude", "pinned", "transition", "spin")
    }
    return replace(rows, **cut)
