"""Knocks and contacts in a record of attitudes: their time, their length, what they do to the rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis import tossed_bodies
from diagnosis.tossed_bodies import RATE, SIGMA, Toss

from massprops.core.robust import rms
from massprops.diagnosis import effect_search, hypothesis_fit, selection
from massprops.diagnosis.candidate import Candidate, Selection
from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.diagnose import decides, diagnose_by_balance
from massprops.diagnosis.document import document_of_selection, parameters, rate_change
from massprops.diagnosis.effect_columns import Term, forcing_of
from massprops.diagnosis.effect_search import again, best_fit, moved_to_best
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import PASSES, HypothesisFit, fit_hypothesis
from massprops.diagnosis.motion_path import path_from_rates
from massprops.diagnosis.record import record_of_attitudes, record_of_rates
from massprops.diagnosis.scanned_values import FINER, LARGEST_STEP, _finer, _halfway, with_scanned
from massprops.diagnosis.screen import screened
from massprops.diagnosis.unnamed import without_effects
from massprops.effects import effects
from massprops.sequence.data import AttitudeSeries, Environment, RateSeries, Sequence

INERTIA = np.diag([0.8, 1.0, 1.2])
BEGINS, LASTS = 0.1153, 0.02
SEVERAL_TURNS = 2.0
PUSH = np.array([150.0, -250.0, 100.0])
BALL = Start(inertia=np.eye(3), left=1.0)


def tossed(push: np.ndarray, seconds: float = 0.22, noise: float = SIGMA) -> tuple[AttitudeSeries, np.ndarray]:
    """Attitudes of a body that a torque pushes from BEGINS on for LASTS, and the change of its rate."""
    rate = np.array([4.0, -2.0, 1.0])
    toss = Toss(inertia=INERTIA, rate=rate, push=push, begins=BEGINS, lasts=LASTS, seconds=seconds)
    return tossed_bodies.tossed(toss, 4, noise)


def pushed(seed: int, passes: int = PASSES) -> tuple[HypothesisFit, Toss]:
    """A push in a short toss fitted from a ball with its time and length given, and the truth."""
    toss = tossed_bodies.drawn(seed)
    record = record_of_attitudes(tossed_bodies.tossed(toss, seed)[0], Environment())
    held = (("duration", toss.lasts), ("parts", 1), ("time", toss.begins))
    h = Hypothesis(terms=(Term(effect=effects()["impulse"], held=held),), latent=False)
    return fit_hypothesis(record, h, BALL, passes), toss


def test_a_contact_is_found_at_its_time_with_its_length_and_what_it_does() -> None:
    series, change = tossed(PUSH)
    record = record_of_attitudes(series, Environment())
    held = (("duration", 0.013), ("parts", 1), ("time", 0.12))
    h = Hypothesis(terms=(Term(effect=effects()["impulse"], held=held),), latent=False)
    found = moved_to_best(fit_hypothesis(record, h, BALL), 1 / RATE)
    settled = dict(found.hypothesis.terms[0].held)
    assert settled["time"] == pytest.approx(BEGINS, abs=1.5e-3)
    assert settled["duration"] == pytest.approx(LASTS, abs=3e-3)
    assert np.linalg.norm(rate_change(found) - change) < 0.05 * np.linalg.norm(change)
    assert rms(found.residual) < 1.1


def test_a_contact_says_how_well_its_time_and_length_are_known() -> None:
    sequence = Sequence(attitude=tossed(PUSH)[0])
    found = diagnose_by_balance(sequence)
    named = found.document["effects"][0]
    assert named["name"] == "impulse"
    value, sigma = named["parameters"], named["sigma"]
    for name, truth in (("time", BEGINS), ("duration", LASTS)):
        assert 0.0 < sigma[name] < 2e-3 and abs(value[name] - truth) < 3.0 * sigma[name]
    # attitudes tell nothing of the push through the centre of mass
    assert value["velocity_x"] is None and sigma["velocity_x"] is None
    best = found.selection.named[0].best
    own = fit_hypothesis(best.record, best.hypothesis, again(best)).covariance["impulse"]
    assert np.trace(best.covariance["impulse"]) > 1.01 * np.trace(own)


def test_a_push_that_is_begun_as_a_short_one_is_told_at_its_length() -> None:
    """Shorter than a step of the path it is spread over one, so the search moves nothing."""
    record, gap = record_of_attitudes(tossed(PUSH)[0], Environment()), 1 / RATE
    held = (("duration", 0.1 * gap), ("parts", 1), ("time", BEGINS + 0.5 * LASTS))
    h = Hypothesis(terms=(Term(effect=effects()["impulse"], held=held),), latent=False)
    found = with_scanned(fit_hypothesis(record, h, BALL), gap)
    settled, sigma = dict(found.hypothesis.terms[0].held), found.held_sd["impulse"]
    for name, truth in (("time", BEGINS), ("duration", LASTS)):
        assert 0.0 < sigma[name] < 2e-3 and abs(settled[name] - truth) < 3.0 * sigma[name]


def test_a_push_too_short_for_its_length_has_a_time_with_its_sigma() -> None:
    gap = 1 / RATE
    toss = Toss(
        inertia=INERTIA, rate=np.array([4.0, -2.0, 1.0]), push=10.0 * PUSH, begins=BEGINS, lasts=0.1 * gap, seconds=0.22
    )
    record = record_of_attitudes(tossed_bodies.tossed(toss, 4, SIGMA)[0], Environment())
    held = (("duration", 0.2 * gap), ("parts", 1), ("time", BEGINS))
    h = Hypothesis(terms=(Term(effect=effects()["impulse"], held=held),), latent=False)
    found = with_scanned(moved_to_best(fit_hypothesis(record, h, BALL), gap), gap)
    value, sigma = parameters(found, "impulse")
    assert (
        0.0 < sigma["time"] < gap
        and abs(value["time"] + 0.5 * value["duration"] - BEGINS - 0.05 * gap) < 4.0 * sigma["time"]
    )
    # not shown: within two sigmas of nothing
    assert value["duration"] < 2.0 * sigma["duration"]


@pytest.mark.parametrize("seed", [4, 5])
def test_a_push_of_any_length_begins_anywhere_within_it(seed: int) -> None:
    """A push that is shorter than a gap, from attitudes that would do with one of three gaps as well: its middle is known, its begin is not."""
    gap = 1 / RATE
    toss = Toss(
        inertia=INERTIA, rate=np.array([4.0, -2.0, 1.0]), push=2.0 * PUSH, begins=BEGINS, lasts=0.1 * gap, seconds=0.22
    )
    record = record_of_attitudes(tossed_bodies.tossed(toss, seed, SIGMA)[0], Environment())
    held = (("duration", 3.0 * gap), ("parts", 1), ("time", BEGINS - 1.4 * gap))
    h = Hypothesis(terms=(Term(effect=effects()["impulse"], held=held),), latent=False)
    value, sigma = parameters(with_scanned(fit_hypothesis(record, h, BALL), gap), "impulse")
    assert sigma["time"] < 1.5 * gap and abs(value["time"] - BEGINS) < 2.0 * sigma["time"]
    assert value["duration"] - 0.1 * gap < 2.0 * sigma["duration"]


def test_one_even_push_is_preferred_to_parts_that_do_the_same() -> None:
    record = record_of_attitudes(tossed(PUSH)[0], Environment())
    base = fit_hypothesis(record, Hypothesis(latent=False), BALL)
    found = best_fit(record, effects()["impulse"], base)
    assert found is not None and dict(found.hypothesis.terms[0].held)["parts"] == 1


def test_the_law_of_a_contact_is_that_of_its_likelihood() -> None:
    """Drawn along the length with the middle held, the evidence falls by a half about a sigma away."""
    record = record_of_attitudes(tossed(PUSH)[0], Environment())
    held = (("duration", LASTS), ("parts", 1), ("time", BEGINS))
    h = Hypothesis(terms=(Term(effect=effects()["impulse"], held=held),), latent=False)
    found = with_scanned(fit_hypothesis(record, h, BALL), 1 / RATE)
    values = dict(found.hypothesis.terms[0].held)
    lengths = values["duration"] + np.linspace(-2.5, 2.5, 11) * found.held_sd["impulse"]["duration"]
    middle = values["time"] + 0.5 * values["duration"]
    evidence = []
    for length in lengths:
        held = (("duration", float(length)), ("parts", 1), ("time", float(middle - 0.5 * length)))
        term = Term(effect=effects()["impulse"], held=held)
        evidence.append(fit_hypothesis(found.record, replace(h, terms=(term,)), again(found)).evidence)
    curvature = -2.0 * np.polyfit(lengths, evidence, 2)[0]
    assert 1.0 / np.sqrt(curvature) == pytest.approx(found.held_sd["impulse"]["duration"], rel=0.35)


def test_a_knock_in_parts_adds_what_its_parts_add() -> None:
    path = path_from_rates(np.linspace(0, 1, 60), np.tile([1.0, 2.0, -1.0], (60, 1)))
    effect = effects()["impulse"]
    held = (("duration", 0.3), ("time", 0.4))
    whole = forcing_of(Term(effect=effect, held=held), path, path.w, np.eye(3))
    parts = forcing_of(Term(effect=effect, held=(*held, ("parts", 3))), path, path.w, np.eye(3))
    assert whole.momentum is not None and parts.momentum is not None and parts.count == 9
    together = parts.momentum.reshape(len(path.t), 3, 3, 3).mean(axis=2)
    assert together == pytest.approx(whole.momentum, abs=2e-3)
    assert Term(effect=effect, held=(*held, ("parts", 3))).values(np.arange(9.0), np.eye(9))[0] == pytest.approx(
        [9, 12, 15]
    )


def test_the_screen_leaves_out_rows_that_look_across_an_event() -> None:
    series, _ = tossed(PUSH)
    record = record_of_attitudes(series, Environment())
    assert record.screen is not None and record.screen.reach > 0
    right, wrong = (
        screened(record.screen, (Term(effect=effects()["impulse"], held=(("time", t),)),), BALL) for t in (0.125, 0.04)
    )
    assert right is not None and wrong is not None and right.left < 1.5 and right.score > wrong.score + 20


def test_attitudes_of_free_flight_within_their_noise_are_given_nothing() -> None:
    series, _ = tossed(0.0 * PUSH)
    sequence = Sequence(attitude=series)
    assert decides(sequence)
    document = diagnose_by_balance(sequence).document
    assert document["verdict"] == "none" and "attitude0" in document["axes"]


def test_the_path_of_a_named_effect_is_finer_than_the_one_it_was_found_along() -> None:
    """Its longer steps are halved, those of a gyroscope's own rates are not, and an event has points between measurements."""
    series, _ = tossed(PUSH, seconds=SEVERAL_TURNS)
    record = record_of_attitudes(series, Environment())
    held = (("duration", LASTS), ("parts", 1), ("time", BEGINS))
    h = Hypothesis(terms=(Term(effect=effects()["impulse"], held=held),), latent=False)
    coarse = fit_hypothesis(record, h, BALL)

    def turns(fit: HypothesisFit) -> np.ndarray:
        path = fit.record.path
        return np.linalg.norm(path.steps, axis=1) * np.diff(path.t)

    long = turns(coarse) > LARGEST_STEP
    assert long.sum() > 20 and len(_halfway(coarse)) == long.sum()
    fine = _finer(coarse, 1 / RATE)
    t, was = fine.record.path.t, coarse.record.path.t
    assert turns(fine).max() < 1.05 * max(LARGEST_STEP, 0.5 * turns(coarse).max())
    # none of the points it had is lost, and rows are where they were
    assert np.abs(t[np.searchsorted(t, was - 1e-9)] - was).max() < 1e-9
    assert t[fine.record.rows.at] == pytest.approx(record.times, abs=1e-9)
    about = (t > BEGINS) & (t < BEGINS + LASTS)
    assert np.diff(t[about]).max() < 1.05 / RATE / FINER
    rates = RateSeries(series.timestamp_ns, coarse.rate[coarse.record.rows.at], 0.01)
    free = fit_hypothesis(record_of_rates(rates), Hypothesis(latent=False), BALL)
    assert not len(_halfway(free))


def test_a_halved_path_tells_a_kick_better() -> None:
    """Of attitudes without noise, from which nothing but the path's steps can move it."""
    series, change = tossed(PUSH, seconds=SEVERAL_TURNS, noise=0.0)
    record = record_of_attitudes(series, Environment())
    held = (("duration", LASTS), ("parts", 1), ("time", BEGINS))
    h = Hypothesis(terms=(Term(effect=effects()["impulse"], held=held),), latent=False)
    coarse = fit_hypothesis(record, h, BALL)
    fine = _finer(coarse, 1 / RATE)
    before, after = (np.linalg.norm(rate_change(f) - change) / np.linalg.norm(change) for f in (coarse, fine))
    assert before > 0.01 and after < 0.3 * before


@pytest.mark.parametrize("seed", [10, 22, 29])
def test_a_push_settles_where_the_record_hardly_shows_the_inertia(seed: int) -> None:
    """Full steps lead to a needle and on, with a kick that is off by 15 to 52 sigmas."""
    fit, toss = pushed(seed)
    assert fit.settled and np.linalg.eigvalsh(fit.inertia)[0] > 0.2
    off = (fit.values["impulse"] - toss.kick) / np.sqrt(np.diag(fit.covariance["impulse"]))
    assert np.abs(off).max() < 3.5


def test_a_kick_goes_with_the_inertia_that_a_pass_reaches() -> None:
    """A pass that takes a part of its step has the kick of that part: the measurements fit as well as they can with it."""
    record = record_of_attitudes(tossed_bodies.tossed(tossed_bodies.drawn(10), 10)[0], Environment())
    toss = tossed_bodies.drawn(10)
    held = (("duration", toss.lasts), ("parts", 1), ("time", toss.begins))
    h = Hypothesis(terms=(Term(effect=effects()["impulse"], held=held),), latent=False)
    own = hypothesis_fit.solved_about(record, h, hypothesis_fit._first_guess(record, h, BALL))
    half, _ = hypothesis_fit._reached(own, 0.5)
    assert half.shape == pytest.approx(own.guess.shape + 0.5 * own.step)
    # solved for anew with that inertia given: no step of it, the same noise and sizes
    post, y = own.posterior, own.y - own.blocks[0].columns[:, :5] @ half.shape
    columns = np.concatenate([own.blocks[0].columns[:, 5:], *(b.columns for b in own.blocks[1:])], axis=1)
    sd = np.concatenate([post.sd[b.name] for b in own.blocks])[5:]
    A = columns.T @ columns / post.noise[0] ** 2 + np.diag(1.0 / sd**2)
    again_ = np.linalg.solve(A, columns.T @ y / post.noise[0] ** 2)
    assert half.posterior.mean["impulse"] == pytest.approx(again_[-3:], rel=1e-2)
    assert np.abs(half.posterior.mean["impulse"] - post.mean["impulse"]).max() > 0.1


def test_a_fit_that_does_not_settle_widens_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    short, _ = pushed(10, passes=2)
    assert not short.settled
    monkeypatch.setattr(hypothesis_fit, "PASSES", 2)
    wide, _ = pushed(10, passes=2)
    more = wide.covariance["impulse"] - short.covariance["impulse"]
    assert np.linalg.eigvalsh(more) == pytest.approx([0.0, 0.0, np.trace(more)], abs=1e-6) and np.trace(more) > 0.1
    candidate = Candidate(alone=wide)
    named = Selection(base=wide, unknown=wide, tried=(candidate,), verdict="named", named=(candidate,))
    warned = document_of_selection(named, [])["warnings"]
    assert len(warned) == 1 and "impulse did not settle" in warned[0]
    rested = replace(candidate, alone=replace(wide, settled=True))
    assert not document_of_selection(replace(named, named=(rested,)), [])["warnings"]


def test_what_one_effect_rules_out_is_not_followed_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A push explains a toss to its noise: what explains less than half of it is not moved to its best, nor is the lag of a wheel looked
    for that comes short of what is asked."""
    record = record_of_attitudes(tossed(PUSH)[0], Environment())
    followed, wheels = [], []
    monkeypatch.setattr(effect_search, "moved_to_best", lambda f, gap: followed.append(f.names[0]) or f)
    monkeypatch.setattr(selection, "wheel_followed", lambda record, look: wheels.append(look) or look)
    base, unknown = without_effects(record)
    usable = [effects()[name] for name in ("energy-dissipation", "impulse", "spring-mass-damper")]
    tried = selection._by_themselves(record, base, (unknown,), usable, lambda *_: None)
    assert set(followed) == {"impulse"}
    assert {c.name for c in tried} >= {"impulse", "internal-rotor"}
    for least in (-np.inf, 1e9):
        followed.clear()
        wheels.clear()
        monkeypatch.setattr(selection, "_least", lambda *_, least=least: least)
        selection._by_themselves(record, base, (unknown,), usable, lambda *_: None)
        assert (len(set(followed)) > 1) == bool(wheels) == (least < 0.0)
