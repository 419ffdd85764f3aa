"""Attitudes of bodies that other simulators move: the screen puts the effect that acts first, and bodies that sunlight pushes."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.core.robust import rms
from massprops.diagnosis.candidate import Candidate, within_noise
from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.effect_columns import Term, forcing_of, in_balance, scan
from massprops.diagnosis.effect_search import again
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.momentum_balance import Balance, Rows
from massprops.diagnosis.motion_path import path_from_rates
from massprops.diagnosis.record import Record, record_of_attitudes
from massprops.diagnosis.screen import screened
from massprops.diagnosis.unnamed import without_effects
from massprops.diagnosis.verdict import asks_for_two, may_be_named
from massprops.dynamics.environment import EnvironmentState
from massprops.effects import effects

BALL = Start(inertia=np.eye(3), left=1.0)


@pytest.mark.parametrize("kind", ["gravity-gradient-torque", "constant-body-torque", "sunlight"])
def test_the_screen_puts_what_acts_in_basilisk_first(kind: str) -> None:
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded(kind, 1)
    assert sequence.attitude is not None
    view = record_of_attitudes(sequence.attitude, sequence.environment).screen
    assert view is not None and view.environment is not None
    score = {}
    for effect in in_balance():
        if set(effect.NEEDS) <= view.environment.known and effect.NAME != "impulse":
            tried = [screened(view, (t,), BALL) for t in scan(effect, view.times, view.rows.measured)]
            score[effect.NAME] = max(s.score for s in tried if s is not None)
    faces = "solar-pressure-on-facets"
    first = max(score, key=lambda n: score[n])
    assert first in ((faces,) if kind == "sunlight" else (kind, faces))


def test_a_torque_is_likelier_than_faces_that_can_follow_it() -> None:
    """Twenty faces come near a constant torque, and follow the errors of rates by polynomials: the fits tell them apart."""
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded("constant-body-torque", 1)
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    names = ("constant-body-torque", "solar-pressure-on-facets")
    terms = [(Term(effect=effects()[n]),) for n in names]
    torque, faces = (fit_hypothesis(record, Hypothesis(terms=t, latent=False), BALL) for t in terms)
    assert torque.evidence > faces.evidence + 20.0


def test_a_free_body_in_basilisk_is_within_its_noise() -> None:
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded("none", 1)
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    free = fit_hypothesis(record, Hypothesis(latent=False), BALL)
    assert within_noise(free) and rms(free.residual) > 0.9


def test_a_face_is_pushed_while_it_is_lit() -> None:
    effect = effects()["solar-pressure-on-facets"]
    q, w, six = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    normal, across = np.array(effect.FACES[0][:3]), np.array(effect.FACES[0][3:6])
    p = [0.0] * len(effect.PARAMETERS)
    p[:4] = [*(2.0 * across), 1.0]

    def torque(sun: np.ndarray) -> np.ndarray:
        environment = EnvironmentState((0.0, 0.0, 0.0), tuple(sun), (0.0, 0.0, 0.0), 0.0)
        return np.array(effect.torque(0.0, q, w, p, six, environment))

    # the force is against the Sun at twice the direction across, the torque of what is reflected along it
    assert torque(normal) == pytest.approx(2.0 * np.cross(across, -normal) + across, abs=0.03)
    assert torque(-normal) == pytest.approx(np.zeros(3), abs=0.03)


def test_the_faces_columns_are_their_torques() -> None:
    effect = effects()["solar-pressure-on-facets"]
    rng = np.random.default_rng(2)
    q, sun = tuple(rng.normal(size=(4, 7)) / 2.0), tuple(np.array([0.6, 0.0, 0.8]))
    environment, p = (
        EnvironmentState((0.0, 0.0, 0.0), sun, (0.0, 0.0, 0.0), 0.0),
        rng.normal(size=len(effect.PARAMETERS)),
    )
    units = np.array(effect.unit_torques(0.0, q, None, environment))
    assert np.tensordot(p, units, 1) == pytest.approx(
        np.array(effect.torque(0.0, q, None, p, None, environment)), abs=1e-12
    )


def test_a_box_with_a_wing_is_named_by_its_faces_however_fine_the_attitudes() -> None:
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded("sunlight", 1, np.radians(0.005))
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, unknown = without_effects(record)
    term = Term(effect=effects()["solar-pressure-on-facets"])
    found = fit_hypothesis(record, Hypothesis(terms=(term,), latent=False), Start(inertia=unknown.inertia, left=1.0))
    assert rms(base.residual) > 5.0 and rms(found.residual) < 1.05
    assert found.evidence > unknown.evidence + 5.0


def test_a_swing_turns_the_body_by_as_much_and_leaves_its_momentum() -> None:
    path = path_from_rates(np.linspace(0, 1, 60), np.tile([0.3, 0.2, -0.1], (60, 1)))
    effect = effects()["inertia-change"]
    forcing = forcing_of(Term(effect=effect, held=(("time", 0.437),)), path, path.w, np.eye(3))
    assert forcing.rate is not None and forcing.momentum is None
    assert np.trapezoid(forcing.rate[:, 1, 7], path.t) == pytest.approx(1.0)
    rows = Rows(at=np.arange(len(path.t)), measured=np.zeros((len(path.t), 3)), sigma=np.ones(len(path.t)), rates=False)
    balance = Balance(path=path, shape=np.zeros(5), momentum=path.w, rate=path.w, rows=rows)
    turned = balance.columns(forcing)[:, :, 6:]
    assert np.abs(turned[path.t < 0.42]).max() < 1e-12
    after = turned[np.searchsorted(path.t, 0.46)]
    assert after == pytest.approx(np.eye(3), abs=0.05)


def candidate(record: Record, unknown: HypothesisFit, *names: str) -> Candidate:
    """Effects by themselves and beside an unknown torque."""
    terms = tuple(Term(effect=effects()[n]) for n in names)
    start = Start(inertia=unknown.inertia, left=1.0)
    alone = fit_hypothesis(record, Hypothesis(terms=terms, latent=False), start)
    return Candidate(alone=alone, with_latent=fit_hypothesis(record, Hypothesis(terms=terms), again(alone)))


def test_what_follows_all_of_a_pair_is_not_named_for_it() -> None:
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded("sunlight+constant-body-torque", 11)
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, unknown = without_effects(record)
    torque, faces = "constant-body-torque", "solar-pressure-on-facets"
    singles = [candidate(record, unknown, torque), candidate(record, unknown, faces)]
    both = candidate(record, unknown, torque, faces)
    # the faces follow both within the noise, but are no likelier than a torque that nothing is known of
    assert within_noise(singles[1].alone) and not may_be_named(singles[1], base, unknown)
    assert asks_for_two(singles, base, unknown)
    assert both.best is both.alone and may_be_named(both, base, unknown)
