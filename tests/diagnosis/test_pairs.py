"""Two effects at once in the rates of a body that scipy moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis.test_momentum_balance import tumble

from massprops.core.robust import rms
from massprops.diagnosis import pairs as module
from massprops.diagnosis.candidate import Candidate, Selection, paid, within_noise
from massprops.diagnosis.conserved_start import conserved
from massprops.diagnosis.document import document_of_selection, model_of_selection
from massprops.diagnosis.effect_columns import Term, looked_at, scan, term_of
from massprops.diagnosis.effect_search import again, widening
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.pair_scan import ANCHORED, FEW, KEPT, LOCAL_MINIMA, least_left, scanned
from massprops.diagnosis.pairs import pairs
from massprops.diagnosis.record import Record, record_of_attitudes, record_of_rates
from massprops.diagnosis.selection import usable_effects
from massprops.diagnosis.unnamed import without_effects
from massprops.diagnosis.verdict import asks_for_two, may_be_named, verdict_of
from massprops.diagnosis.wheel_of_any_history import wheel_of_any_history
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.quaternion import from_rotation_vector, multiply
from massprops.dynamics.rotation import trajectory
from massprops.effects import effects
from massprops.model import model_of
from massprops.sequence.data import AttitudeSeries, Environment

DRAG = np.array([0.6, 0.3, 0.9])
TORQUE = np.array([3.0, -2.0, 1.5])


@pytest.fixture(scope="module")
def record() -> Record:
    return record_of_rates(tumble(lambda t, w: -DRAG * w + TORQUE, rate=60.0))


def alone(record: Record, name: str) -> HypothesisFit:
    effect = next(m for m in usable_effects(record)[0] if name == m.NAME)
    start = conserved(record.path, record.rows.at)
    return fit_hypothesis(record, Hypothesis(terms=(Term(effect=effect),), latent=False), start)


def test_the_second_of_two_effects_is_found_beside_the_first(record: Record) -> None:
    usable, _ = usable_effects(record)
    single = [alone(record, "drag-by-axis"), alone(record, "constant-body-torque")]
    assert all(rms(fit.residual) > 1.2 for fit in single)
    base, unknown = without_effects(record)
    found = pairs(record, unknown, single, [m for m in usable if m.NAME != "impulse"])[0]
    assert set(found.names) == {"drag-by-axis", "constant-body-torque"}
    assert found.evidence > max(f.evidence for f in single) + 20 and rms(found.residual) < 1.15
    for name, truth in (("drag-by-axis", DRAG), ("constant-body-torque", TORQUE)):
        sd = np.sqrt(np.diag(found.covariance[name]))
        assert np.all(np.abs(found.values[name] - truth) < 4 * sd + 0.02)

    tried = [Candidate(alone=f) for f in single]
    assert asks_for_two(tried, base, unknown)
    assert not asks_for_two([*tried, Candidate(alone=found)], base, unknown)
    named = Selection(base=base, unknown=unknown, tried=(), verdict="named", named=(Candidate(alone=found),))
    document = document_of_selection(named, [])
    assert {e["name"] for e in document["effects"]} == {"drag-by-axis", "constant-body-torque"}
    assert all(np.isfinite(v) for e in document["effects"] for v in e["parameters"].values() if v is not None)
    assert {e["name"] for e in model_of_selection(named)["effects"]} == {"drag-by-axis", "constant-body-torque"}


def test_what_one_pair_rules_out_is_not_followed(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pair that is enough leaves nothing to a wheel; one that explains less than half of what another does has no fits besides."""
    usable = [effects()[name] for name in ("constant-body-torque", "drag-by-axis", "inertia-change")]
    base, unknown = without_effects(record)
    begun: list[int] = []

    def counted(*given: object, **named: object) -> HypothesisFit:
        begun.append(1)
        return fit_hypothesis(*given, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "fit_hypothesis", counted)
    whole = pairs(record, unknown, [base], usable)
    found = pairs(record, unknown, [base], usable, base.evidence, lambda fit: True)
    assert found[0].names == whole[0].names and found[0].evidence == pytest.approx(whole[0].evidence, abs=0.01)
    assert any(f.hypothesis.wheel for f in whole) and not any(f.hypothesis.wheel for f in found)
    firing, drag = (scanned(record, effects()[name], unknown, None) for name in ("inertia-change", "drag-by-axis"))
    tried = least_left(record, firing, drag)
    for least in (np.inf, -np.inf):
        begun.clear()
        module._begun(record, tried, 0.01, least)
        assert (len(begun) > len(tried)) == (least < 0.0)


def test_values_of_a_pair_are_tried_beside_what_each_is_likeliest_at_alone(record: Record) -> None:
    """Of many values the least momentum may be left by what no body can be: a boom's own moment is tried all the same."""
    _, unknown = without_effects(record)
    boom, sphere = effects()["inertia-change"], effects()["energy-dissipation"]
    moment, pace = term_of(boom, {"time": 0.4321}), term_of(sphere, {"coupling": 0.777})
    a, b = scanned(record, boom, unknown, moment), scanned(record, sphere, unknown, pace)
    w = record.path.w[record.rows.at]
    assert len(a.terms) == len(scan(boom, record.times, w)) + 1 and a.alone and a.terms[-1] == moment
    tried = [terms for terms, _ in least_left(record, a, b)]
    assert len(tried) <= KEPT + 2 * ANCHORED + LOCAL_MINIMA and len(set(tried)) == len(tried)
    assert sum(t[0] == moment for t in tried) >= ANCHORED and sum(t[1] == pace for t in tried) >= ANCHORED
    # a few values are all tried
    torque = scanned(record, effects()["constant-body-torque"], unknown, None)
    assert len(torque.terms) == 1 and len(least_left(record, b, torque)) == len(b.terms) <= FEW


def test_a_boom_is_found_beside_sunlight_where_an_unknown_torque_leaves_a_needle() -> None:
    """The unknown torque leaves the inertia open: from a needle no fit of a boom beside sunlight leads anywhere, and a twentieth
    of the record away from its moment a boom does not show."""
    pytest.importorskip("mujoco")
    from diagnosis.pair_worlds import drawn

    sequence = drawn(230, rejected=0).sequence
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, unknown = without_effects(record)
    needle = replace(unknown, inertia=np.diag([0.1, 1.42, 1.48]))
    names = ("inertia-change", "solar-pressure-on-facets")
    found = pairs(record, needle, [base], [effects()[n] for n in names])[0]
    # the boom deploys at 337.7 s; its body is nearly a ball
    assert set(found.names) == set(names) and rms(found.residual) < 1.05
    assert dict(found.hypothesis.term("inertia-change").held)["time"] == pytest.approx(337.7, abs=2.0)
    assert np.linalg.eigvalsh(found.inertia)[0] == pytest.approx(0.92, abs=0.05)


def test_two_events_are_found_at_moments_of_their_own() -> None:
    """Two events at one moment part the record in two and leave less momentum than a firing and a boom do at theirs."""
    pytest.importorskip("mujoco")
    from diagnosis.pair_worlds import drawn

    sequence = drawn(233, rejected=0).sequence
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, unknown = without_effects(record)
    names = ("inertia-change", "impulse")
    found = pairs(record, unknown, [base], [effects()[n] for n in names])[0]
    assert set(found.names) == set(names) and rms(found.residual) < 1.05
    # the boom deploys at 620.6 s, the jet fires for 15 s from 487.1 s on
    held = dict(found.hypothesis.term("impulse").held)
    assert dict(found.hypothesis.term("inertia-change").held)["time"] == pytest.approx(620.6, abs=3.0)
    assert held["time"] + 0.5 * held["duration"] == pytest.approx(494.6, abs=1.0)


def test_what_strikes_twice_is_a_second_knock_beside_the_first() -> None:
    times, first, second = np.arange(0.0, 100.0, 0.5), np.array([0.02, -0.01, 0.015]), np.array([-0.01, 0.02, 0.01])
    sizes = {
        "impulse": np.array([30.2, *first, 0, 0, 0, 1.0]),
        "second-impulse": np.array([61.3, *second, 0, 0, 0, 1.0]),
    }
    acting = model_of(sizes)
    moved = trajectory(
        times, np.array([1.0, 0, 0, 0]), np.array([0.1, 0.15, -0.08]), np.diag([0.8, 1.0, 1.2]), acting.active, acting.flat(True),
        EnvironmentModel(Environment()),
    )  # fmt: skip
    noise = 1e-3 * np.random.default_rng(0).standard_normal((len(times), 3))
    q = multiply(moved.q, from_rotation_vector(noise))
    series = AttitudeSeries(np.round(times * 1e9).astype(np.int64), q, np.full(len(times), 1e-3))
    record = record_of_attitudes(series, Environment())
    assert "second-impulse" not in {m.NAME for m in usable_effects(record)[0]}
    base, unknown = without_effects(record)
    found = pairs(record, unknown, [base], [effects()["impulse"]])[0]
    assert set(found.names) == set(sizes) and rms(found.residual) < 1.05
    knocks = sorted(
        (dict(t.held)["time"] + 0.5 * dict(t.held).get("duration", 0.0), found.values[t.name])
        for t in found.hypothesis.terms
    )
    for (middle, kick), truth, when in zip(knocks, (first, second), (30.7, 61.8), strict=True):
        assert middle == pytest.approx(when, abs=0.3)
        np.testing.assert_allclose(kick, truth, atol=1e-3)


def test_sigmas_grow_where_neighbours_are_alike() -> None:
    rng = np.random.default_rng(0)
    white = rng.standard_normal((400, 3))
    assert widening(white) < 1.1
    smooth = white.copy()
    for k in range(1, 400):
        smooth[k] += 0.9 * smooth[k - 1]
    assert widening(smooth) == pytest.approx(np.sqrt(1.9 / 0.1), rel=0.2)
    # that is by how much the mean of such rows scatters more than that of independent ones
    runs = rng.standard_normal((300, 400))
    for k in range(1, 400):
        runs[:, k] += 0.9 * runs[:, k - 1]
    scatter = runs.mean(axis=1).std() / (runs.std() / np.sqrt(400))
    assert scatter == pytest.approx(widening(runs.T), rel=0.25)


def test_a_small_effect_that_leaves_the_stated_noise_may_be_named() -> None:
    small = record_of_rates(tumble(lambda t, w: -0.05 * DRAG * w, rate=100.0))
    base, unknown = without_effects(small)
    fit = alone(small, "drag-by-axis")
    assert unknown is not base and 1.1 < rms(base.residual) < 2.0 * rms(fit.residual), (
        "more than half of the misfit is noise"
    )
    assert may_be_named(Candidate(alone=fit), base, unknown)
    idle = alone(record_of_rates(tumble(rate=100.0)), "drag-by-axis")
    assert not may_be_named(Candidate(alone=idle), base, unknown)


def test_what_is_not_told_from_an_unknown_torque_is_listed_beside_it() -> None:
    small = record_of_rates(tumble(lambda t, w: -0.05 * DRAG * w, rate=100.0))
    base, unknown = without_effects(small)
    fit = alone(small, "drag-by-axis")
    assert within_noise(fit)

    def verdict(lead: float) -> str:
        ahead = Candidate(alone=replace(fit, evidence=unknown.evidence + lead))
        return verdict_of(base, (unknown,), [ahead])[0]

    assert [verdict(lead) for lead in (-6.0, -3.0, 3.0, 20.0)] == ["unexplained", "ambiguous", "ambiguous", "named"]


def test_an_effect_pays_for_the_moments_that_it_was_looked_for_at(record: Record) -> None:
    effect = effects()["impulse"]
    looked = len(scan(effect, record.times, record.path.w[record.rows.at]))
    start = conserved(record.path, record.rows.at)
    knock = Hypothesis(terms=(term_of(effect, {"time": float(record.times[20])}),), latent=False)
    fit = fit_hypothesis(record, knock, start)
    assert paid(fit) < fit.verified - np.log(looked)
    # a spring's frequency is an unknown, which pays by its prior
    swing = scan(effects()["spring-mass-damper"], record.times, record.path.w[record.rows.at])[0]
    assert len(swing.held) == 10 and looked_at(swing, record.times, record.path.w[record.rows.at]) == 1
    free = alone(record, "drag-by-axis")
    assert paid(free) == free.verified


@pytest.mark.parametrize(("left", "named"), [(1.15, True), (1.22, False)])
def test_no_effect_is_asked_to_take_half_of_the_noise(record: Record, left: float, named: bool) -> None:
    """Of a misfit of 1.6 times a stated noise, 1.25 stand beyond it: 1.15 leaves .57 of these, 1.22 leaves .70."""
    fit = replace(alone(record, "drag-by-axis"), settled=True)
    ones = np.ones_like(fit.residual)
    base = replace(fit, residual=1.6 * ones, evidence=fit.evidence - 100.0)
    own = Candidate(alone=replace(fit, residual=left * ones))
    assert record.stated and not within_noise(own.alone)
    assert may_be_named(own, base, replace(base, evidence=fit.evidence - 50.0)) is named


def test_what_a_fit_only_claims_beside_an_unknown_torque_does_not_count(record: Record) -> None:
    fit = replace(alone(record, "drag-by-axis"), settled=True)
    assert not within_noise(fit)
    astray = replace(fit, evidence=fit.evidence + 20.0, unverified=50.0, settled=False)
    assert Candidate(alone=fit, with_latent=astray).likeliest is fit
    assert Candidate(alone=fit, with_latent=replace(astray, settled=True)).evidence == fit.evidence + 20.0


def test_a_wheel_of_any_history_is_found_beside_a_torque_that_bends_it() -> None:
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded("constant-body-torque+internal-rotor", 51)
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    wheel = wheel_of_any_history(record)
    _, unknown = without_effects(record)
    torque = [m for m in usable_effects(record)[0] if m.NAME == "constant-body-torque"]
    every = pairs(record, unknown, [wheel.alone], torque)
    found = every[0]
    # both starts of a fit beside the wheel lead to it, and it is no rival of itself
    assert len({f.names for f in every}) == len(every)
    assert rms(wheel.alone.residual) > 5.0 and rms(found.residual) < 1.05
    assert found.hypothesis.wheel and set(found.names) == {"internal-rotor", "constant-body-torque"}


def test_a_strong_wheel_is_not_taken_for_noise_of_a_needle() -> None:
    """Fits used to lead to a needle about the wheel's axis, whose steps explain noise: 6 of the noise was left, and sunlight
    beside a steady wheel was named."""
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded("internal-rotor", 43)
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, unknown = without_effects(record)
    wheel = wheel_of_any_history(unknown.record)
    assert rms(base.residual) > 100.0 and 0.97 < rms(wheel.alone.residual) < 1.03
    # what the last pass would still gain is hardly more than what tells two effects apart
    assert wheel.alone.unverified < 10.0 and wheel.alone.evidence > unknown.evidence + 100.0
    assert wheel.alone.axis is not None
    assert abs(wheel.alone.axis @ (0.93845, 0.31775, 0.13542)) > np.cos(np.radians(0.5))
    # of a body that is nearly a ball; what is said of the moment about the axis is little, but no needle's 0.005 to 0.03
    assert np.linalg.eigvalsh(wheel.alone.inertia)[0] > 0.2


def test_what_two_effects_share_of_the_noise_is_not_left_to_one() -> None:
    """A constant torque within the noise, beside which an unknown torque is likelier, asks for a second."""
    pytest.importorskip("mujoco")
    from diagnosis.pair_worlds import drawn

    found = drawn(106, rejected=1)
    assert found.sequence.attitude is not None and set(found.names) == {"constant-body-torque", "viscous-damping"}
    record = record_of_attitudes(found.sequence.attitude, found.sequence.environment)
    base, unknown = without_effects(record)
    start = again(unknown)
    terms = (Term(effect=effects()["constant-body-torque"]),)
    torque = fit_hypothesis(record, Hypothesis(terms=terms, latent=False), start)
    tried = Candidate(alone=torque, with_latent=fit_hypothesis(record, Hypothesis(terms=terms), again(torque)))
    assert within_noise(torque) and may_be_named(tried, base, unknown)
    assert asks_for_two([tried], base, unknown)


def test_a_firing_beside_a_wheel_is_found_where_the_least_momentum_is_left() -> None:
    """An unknown torque takes up all of a strong firing, so nothing is gained beside it at any moment."""
    pytest.importorskip("mujoco")
    from diagnosis.pair_worlds import drawn

    sequence = drawn(202, rejected=1).sequence
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, unknown = without_effects(record)
    names = ("impulse", "internal-rotor")
    found = pairs(record, unknown, [base], [effects()[n] for n in names])[0]
    # the jet fires for 4 s from 240.6 s on
    held = dict(found.hypothesis.term("impulse").held)
    assert set(found.names) == set(names) and rms(found.residual) < 1.05
    assert held["time"] + 0.5 * held["duration"] == pytest.approx(242.6, abs=1.0)
