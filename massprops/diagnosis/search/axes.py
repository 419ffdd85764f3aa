"""Which way round the body lies in the axes of `body.yaml`, where only its motion tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.refit import FittedModel, refit
from massprops.model.state import in_axes

OTHERWISE = (
    ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
)
"""Turns that exchange principal axes; half turns about them change nothing in free rotation."""
FIRST = 10
"""Iterations after which the best of them is followed further."""


def otherwise(case: Case, base: FittedModel) -> FittedModel:
    """The base model from the other ways to match principal axes, where one explains more.

    What the model lacks can turn the axes that the first guess takes from the motion, and the search then rests where
    no effect leads to the true ones.
    """
    if case.first.body_frame != "body.yaml" or case.inertia_prior.inertia is None:
        return base
    _, axes = np.linalg.eigh(base.fit.state.inertia)
    begun = [in_axes(base.fit.state, axes @ np.array(turn, float) @ axes.T) for turn in OTHERWISE]
    tried = [refit(case, replace(state, inertia=case.inertia_prior.inertia), (), most=FIRST) for state in begun]
    good = min(tried, key=lambda s: s.bic)
    refitted = refit(case, good.fit.state, (), most=40, against=base.fit.cost)
    return refitted if refitted.bic < base.bic else base
