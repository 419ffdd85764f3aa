"""A null hypothesis of the cameras: all features of a frame are shifted alike, smoothly in time, as by a mount that gives way or a
flow that is off. What acts on the body moves features by where they stand on it, so it has to be likelier than that.

Each component of each camera's shift is a Gaussian process (Matern 3/2) as the unknown torque is, its size and length found by
evidence, beside all parameters of a fitted model linearised about it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.diagnosis.evidence import Block, solve
from massprops.diagnosis.hypothesis import TORQUE_KNOTS
from massprops.diagnosis.latent_torque import factor, hats, matern
from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.refit import FittedModel
from massprops.model.linearise import linearise

LENGTHS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Of the shift over the record's, of which the likeliest is taken."""
WIDE = 1e3
"""Prior of a model's parameters over what one measurement tells of them: no word at all."""
OWN_ROWS = 1.0
"""As how many measurements the stated noise counts: what is left tells the noise, as in BIC."""


@dataclass(frozen=True)
class Shift:
    """What a shift of the images would be: the log evidence that it adds to a fitted model, and its rms [px]."""

    gain: float
    rms_px: float


def latent_shift(case: Case, s: FittedModel) -> Shift | None:
    """The likeliest shift of the images beside a fitted model; None without tracks."""
    m = case.fitted
    if not len(m.uv):
        return None
    linear = linearise(case.problem, m, s.fit.predicted, case.environment)
    over = np.sqrt(s.fit.weights[linear.unit])
    points = np.zeros((len(linear.value), 3 * len(s.fit.state.points)))
    rows = np.arange(2 * len(m.uv)).reshape(-1, 2)
    for axis in range(3):
        points[rows, 3 * m.seen.feature[:, None] + axis] = linear.point[:, :, axis]
    base = np.concatenate([linear.shared[:, s.fit.free], points], axis=1) * over[:, None]
    base = base[:, np.any(base != 0.0, axis=0)]
    blocks = [Block(name="model", columns=base / np.sqrt(np.mean(base**2, axis=0)), sd=WIDE)]
    y = linear.value * over
    without = solve(blocks, y, OWN_ROWS).evidence
    shifts = []
    for length in LENGTHS:
        pixels = np.concatenate([_shapes(case, int(k), length) for k in np.unique(m.seen.camera)], axis=1)
        rows_of = np.zeros((len(y), pixels.shape[1]))
        rows_of[: len(pixels)] = pixels / np.repeat(m.sigma, 2)[:, None]
        solution = solve(
            [*blocks, Block(name="shift", columns=rows_of * over[:, None], sd=1.0, kind="common")], y, OWN_ROWS
        )
        size = float(np.sqrt(2.0 * np.mean((pixels @ solution.mean["shift"]) ** 2)))
        shifts.append(Shift(solution.evidence - without, size))
    return max(shifts, key=lambda f: f.gain)


def _shapes(case: Case, camera: int, length: float) -> np.ndarray:
    """(2 o, 2 k) pixels by which one camera's shift moves each observation, by independent unknowns right and down."""
    m, t = case.fitted, case.problem.times
    knots = np.linspace(t[0], t[-1], TORQUE_KNOTS)
    smooth = hats(t, knots) @ factor(matern(knots, length * (t[-1] - t[0])))
    smooth_of_camera = (m.seen.camera == camera)[:, None] * smooth[m.seen.epoch]
    return np.kron(smooth_of_camera[:, None, :], np.eye(2)[:, :, None]).reshape(2 * len(smooth_of_camera), -1)
