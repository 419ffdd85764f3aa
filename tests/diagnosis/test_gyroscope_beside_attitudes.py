"""Attitudes with a gyroscope beside them: its offset is no torque and no wheel, and its rates narrow what attitudes leave open."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.diagnose import contents_of, decides, diagnose_by_balance
from massprops.diagnosis.effect_columns import Term
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.record import record_of_attitudes
from massprops.dynamics.quaternion import from_rotation_vector, multiply, normalise
from massprops.effects import effects
from massprops.sequence.data import AttitudeSeries, RateSeries, Sequence

INERTIA = np.diag([0.8, 1.0, 1.2])
TORQUE = np.array([4e-6, -3e-6, 5e-6])
OFFSET = np.array([1e-3, -5e-4, 3e-4])
ATTITUDE, RATE = 5e-3, 3e-5
STEP_S, COUNT = 2.0, 300


def measured(torque: np.ndarray, seed: int = 3, late: float = 0.0, part: float = 1.0) -> Sequence:
    """Attitudes, and rates halfway between them from a gyroscope with an offset, whose clock is late [s]; part: of the usual noise."""

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        q, w = y[:4], y[4:]
        turning = 0.5 * multiply(q, np.concatenate([[0.0], w]))
        return np.concatenate([turning, np.linalg.solve(INERTIA, torque - np.cross(w, INERTIA @ w))])

    t = STEP_S * np.arange(COUNT)
    start = np.concatenate([[1.0, 0.0, 0.0, 0.0], [0.03, 0.02, -0.015]])
    found = solve_ivp(slope, (0.0, t[-1]), start, dense_output=True, rtol=1e-9, atol=1e-11)
    rng = np.random.default_rng(seed)
    turns = from_rotation_vector(part * ATTITUDE * rng.standard_normal((COUNT, 3)))
    q = normalise(multiply(normalise(found.sol(t).T[:, :4]), turns))
    between = t[:-1] + 0.5 * STEP_S
    w = found.sol(between - late).T[:, 4:] + OFFSET + part * RATE * rng.standard_normal((COUNT - 1, 3))
    return Sequence(
        attitude=AttitudeSeries(np.round(t * 1e9).astype(np.int64), q, np.full(COUNT, part * ATTITUDE)),
        rates=RateSeries(np.round(between * 1e9).astype(np.int64), w, part * RATE),
    )


def torque_of(sequence: Sequence, rates: bool) -> HypothesisFit:
    """Fit of a constant torque."""
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment, sequence.rates if rates else None)
    h = Hypothesis(terms=(Term(effect=effects()["constant-body-torque"]),), latent=False)
    return fit_hypothesis(record, h, Start(inertia=np.eye(3), left=1.0))


def test_an_offset_alone_is_nothing() -> None:
    sequence = measured(np.zeros(3))
    assert decides(sequence)
    found = diagnose_by_balance(sequence)
    assert found.document["verdict"] == "none"
    rows = str(contents_of(found)["residual.csv"]).splitlines()
    kinds = [row.split(",")[1] for row in rows[1:]]
    assert kinds.count("attitude") == 3 * COUNT and kinds.count("rate") == 3 * (COUNT - 1)


def test_a_clock_that_is_late_is_nothing() -> None:
    found = diagnose_by_balance(measured(np.zeros(3), late=0.15, part=0.1))
    assert found.document["verdict"] == "none"
    post = found.selection.base.posterior
    late, sd = post.mean["gyroscope"][12], np.sqrt(post.covariance["gyroscope"][12, 12])
    assert sd < 0.03 and abs(late - 0.15) < 4.0 * sd


def test_rates_narrow_a_torque_and_show_their_offset() -> None:
    sequence = measured(TORQUE)
    alone, both = torque_of(sequence, False), torque_of(sequence, True)
    name = "constant-body-torque"
    sd = [np.sqrt(np.diag(f.covariance[name])) for f in (alone, both)]
    assert np.linalg.norm(sd[1]) < 0.7 * np.linalg.norm(sd[0])
    assert (np.abs(both.values[name] - TORQUE) < 4.0 * sd[1]).all()
    sensor, covariance = both.posterior.mean["gyroscope"], both.posterior.covariance["gyroscope"]
    assert (np.abs(sensor[9:12] - OFFSET) < 4.0 * np.sqrt(np.diag(covariance))[9:12]).all()
    assert both.residual.shape == (2 * COUNT - 1, 3) and both.noise == pytest.approx([1.0, 1.0], abs=0.1)
