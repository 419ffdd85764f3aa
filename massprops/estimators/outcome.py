"""What a set of methods made of one sequence."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from massprops.estimators.prior import PriorTest
    from massprops.estimators.result import Estimate
    from massprops.model.problem import Problem


@dataclass(frozen=True)
class Outcome:
    """What a set of methods made of one sequence.

    Attributes:
        problem: what they were given.
        estimates: one per method that ran, in the registry's order.
        skipped: method to one line: what the sequence lacks, or why the method gave up.
        cpu_seconds: by method.
        prior: judgement of the prior, None when there was none to judge.
        warnings: of reading, of the start, of the prior.
    """

    problem: Problem
    estimates: list[Estimate] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)
    cpu_seconds: dict[str, float] = field(default_factory=dict)
    prior: PriorTest | None = None
    warnings: tuple[str, ...] = ()

    @property
    def sound(self) -> list[Estimate]:
        """Those that converged on observable ratios and can be believed."""
        return [e for e in self.estimates if e.converged and e.observable and e.reliable]

    @property
    def reason(self) -> str:
        """Why there is no sound estimate; empty when there is one."""
        if self.sound:
            return ""
        reasons = [f"{e.name}: {e.because or e.reason or 'did not converge'}" for e in self.estimates]
        reasons += [f"{name}: {why}" for name, why in self.skipped.items()]
        return "no estimator gives the inertia ratios from this data; " + "; ".join(reasons)
