"""A law that is in no catalogue: its terms, its numbers, its effect file; and nothing where nothing acts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massprops.diagnosis.candidate import Candidate, Selection
from massprops.diagnosis.discovery.beside_catalogue import against_name, against_selection
from massprops.diagnosis.discovery.effect_source import effect_of, source_of
from massprops.diagnosis.discovery.law import Against, discover
from massprops.diagnosis.discovery.library import columns_of, library, own_frequencies, told_apart
from massprops.diagnosis.discovery.regression import Found, Regression, distinct, probabilities, regression_of, search
from massprops.diagnosis.discovery.sequence_law import files_of_law
from massprops.diagnosis.effect_search import best_fit
from massprops.diagnosis.motion_path import MotionPath, path_from_rates
from massprops.diagnosis.sequence_record import record_of_sequence
from massprops.diagnosis.unnamed import without_effects
from massprops.dynamics.environment import EnvironmentState
from massprops.effect_contract import faults, superposes
from massprops.effect_file import with_effects
from massprops.effects import effects
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

EVERYTHING = {"sun direction", "magnetic field", "orbit"}
JET = """
from massprops.dynamics.kernels import to_body
from massprops.effects import Parameter
NAME = "sunlit-jet"
SENTENCE = "A jet fires while the face z sees the Sun."
PARAMETERS = tuple(Parameter(f"jet_{a}", "rad s^-2", 1e-4) for a in "xyz")
NEEDS = ("sun direction",)


def torque(t, q, w, p, inertia, environment):
    x, y, z = to_body(*q, *environment.sun)
    lit = z * (z.real > 0)
    return p[0] * lit, p[1] * lit, p[2] * lit
"""


@pytest.fixture
def path() -> MotionPath:
    t = np.arange(0.0, 20.0, 0.5)
    return path_from_rates(t, np.stack([0.2 + 0.1 * np.sin(t), 0.1 * np.cos(t), 0.3 + 0.0 * t], axis=1))


def sky(path: MotionPath) -> EnvironmentState:
    n = len(path.t)
    return EnvironmentState((np.full(n, 7e6), np.zeros(n), 1e5 + path.t), (0.6, 0.0, 0.8), (2e-5, 1e-5, -3e-5), 4e14)


def test_every_term_is_the_same_in_its_effect_file(path: MotionPath) -> None:
    groups = library(EVERYTHING, 20.0, (0.5,), (3.0, 7.0), 0.1)
    terms = [term for group in groups for term in group.terms]
    assert len({t.label for t in terms}) == len(terms) > 200
    columns = columns_of(terms, path, path.w, sky(path))
    for k in range(0, len(terms), 7):
        effect = effect_of(source_of((terms[k],), [1e-3]))
        assert faults(effect) == "" and superposes(effect), terms[k].label
        torque = effect.torque(path.t, tuple(path.q.T), tuple(path.w.T), [1.0], None, sky(path))
        torque = np.stack([np.broadcast_to(x, path.t.shape) for x in torque], axis=1)
        assert np.allclose(torque, columns[:, :, k], atol=1e-14), terms[k].label


def test_the_regression_finds_the_columns_that_act() -> None:
    rng = np.random.default_rng(0)
    fixed, columns = rng.normal(size=(600, 5)), rng.normal(size=(600, 30))
    y = fixed @ rng.normal(size=5) + 0.5 * columns[:, 4] - 0.5 * columns[:, 13] + rng.normal(size=600)
    groups = tuple((3 * k, 3 * k + 1, 3 * k + 2) for k in range(10))
    r = regression_of(fixed, np.full(5, 10.0), columns, y, 100.0, groups, (False,) * 10, tuple(range(10)))
    models = search(r)
    chance = probabilities(r, models)
    assert models[0].columns == (4, 13) and min(chance[4], chance[13]) > 0.9
    assert max(p for c, p in chance.items() if c not in (4, 13)) < 0.3
    noise = regression_of(
        fixed, np.full(5, 10.0), columns, rng.normal(size=600), 100.0, groups, (False,) * 10, tuple(range(10))
    )
    assert search(noise)[0].columns == ()
    held = regression_of(
        fixed, np.full(5, 10.0), columns, y, 100.0, groups, (False,) * 4 + (True,) + (False,) * 5, tuple(range(10))
    )
    assert 13 not in search(held)[0].columns, "a coefficient that must not be negative is"


def test_terms_that_are_equal_along_a_path_are_one(path: MotionPath) -> None:
    above = EnvironmentState(tuple(np.zeros((3, len(path.t)))), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 4e14)
    turning = path_from_rates(path.t, np.tile([0.0, 0.0, 0.3], (len(path.t), 1)) + 0.02 * np.sin(path.t)[:, None])
    groups = library({"sun direction"}, 20.0, (0.5,), (3.0,), 0.1)
    terms = [term for group in groups for term in group.terms]
    kept, torques = told_apart(groups, columns_of(terms, turning, turning.w, above))
    own = {term.label: term for group in kept for term in group.terms}
    assert torques.shape[2] == len(own) < len(terms)
    assert own["max(0, s_z) along x"].same == ("s_z along x",) and "s_z along x" not in own
    assert "s_z s_z along y" in own["max(0, s_z)^2 along y"].same
    assert "max(0, -s_z) along x" not in own, "no light falls on that face"
    assert own["s_x along y"].same == () and "max(0, s_x) along y" in own, "that face turns in and out of the light"
    below = EnvironmentState(above.position, (0.0, 0.0, -1.0), above.field, above.mu)
    kept, _ = told_apart(groups, columns_of(terms, turning, turning.w, below))
    own = {term.label: term for group in kept for term in group.terms}
    assert own["max(0, -s_z) along x"].same == ("-s_z along x",)


def _two_alike(rng: np.random.Generator) -> Regression:
    """Rows that one of two columns moves which differ by little, with one of its own that both models need."""
    first, own = rng.normal(size=(2, 600))
    near = first + 0.05 * rng.normal(size=600)
    y = 2.0 * first + own + rng.normal(size=600)
    columns, groups = np.stack([first, near, own], axis=1), ((0,), (1,), (2,))
    return regression_of(rng.normal(size=(600, 2)), np.ones(2), columns, y, 100.0, groups, (False,) * 3, (0, 0, 1))


def test_a_term_at_two_moments_counts_once() -> None:
    models = [Found((0, 2), 0.0), Found((1, 2), -0.1), Found((2, 3), -0.5), Found((2,), -9.0)]
    assert distinct(models, {0: 0, 1: 0}) == {frozenset({0, 2}): 0.0, frozenset({2, 3}): -0.5, frozenset({2}): -9.0}
    r = _two_alike(np.random.default_rng(1))
    found = search(r)
    apart, alike = probabilities(r, found), probabilities(r, found, {0: 0, 1: 0})
    assert apart[0] + apart[1] < 1.01 and alike[0] == alike[1] > 0.9 and apart[2] > 0.9


def test_two_terms_that_hold_each_other_up_leave_together() -> None:
    rng = np.random.default_rng(2)
    first, second, between = np.linalg.qr(rng.normal(size=(600, 3)))[0].T * np.sqrt(600.0)
    noise = rng.normal(size=600)
    # the difference of two terms is worth 5 in log evidence, either alone nothing, and each costs 3.2
    noise += between * (np.sqrt(10.0 / 600) - between @ noise / 600)
    columns = np.stack([first, second, second + 0.01 * between], axis=1)
    nothing = np.zeros((600, 1))
    r = regression_of(nothing, np.ones(1), columns, first + noise, 1e6, ((0, 1, 2),), (False,), (0,))
    assert search(r)[0].columns == (0,)


def test_the_bodys_own_frequencies() -> None:
    t = np.arange(0.0, 100.0, 0.25)
    rate = np.stack([np.sin(0.8 * t), np.cos(0.8 * t), 0.3 * np.sin(2.1 * t)], axis=1)
    found = own_frequencies(t, rate)
    assert min(abs(f - 0.8) for f in found) < 0.02 and min(abs(f - 2.1) for f in found) < 0.02


def test_a_jet_in_sunlight_is_found_and_its_file_works(tmp_path: Path) -> None:
    hidden = tmp_path / "jet.py"
    hidden.write_text(JET)
    sensor = {"features": 0, "attitude_sigma": 1e-3, "range_sigma_m": 0.0, "frames": 200, "rate_deg": 4.0}
    with with_effects([hidden]):
        made = simulate_tracks(TrackScenario(**sensor, seed=3, effects=("sunlit-jet:jet_x=8e-5,jet_y=0,jet_z=4e-5",)))
    record = record_of_sequence(made.sequence)
    law = discover(record, *without_effects(record))
    assert law is not None and not law.objection
    against = against_name(law, "constant-body-torque")
    assert against is not None and against.ahead > 5.0 and against_name(law, "lens-distortion") is None
    objection = replace(law, catalogue=Against(names=("impulse",), ahead=-3.0)).objection
    assert objection == "impulse of the catalogue is likelier, by 3.0 in log evidence"
    document, files = files_of_law(replace(law, catalogue=against))
    assert document["stated"] and document["catalogue"]["effects"] == ["constant-body-torque"]
    found = {t["term"]: t for t in document["terms"]}
    assert set(found) == {"max(0, s_z) along x", "max(0, s_z) along z"}, document["formula"]
    for name, true in (("max(0, s_z) along x", 8e-5), ("max(0, s_z) along z", 4e-5)):
        assert abs(found[name]["coefficient"] - true) < 4 * found[name]["sigma"] < true / 2
        assert found[name]["probability"] > 0.5 and found[name]["unit"] == "rad s^-2"
    assert document["held_out"]["after"] < 1.15 < document["held_out"]["before"]
    for name, content in files.items():
        (tmp_path / name).write_text(content)  # type: ignore[arg-type]
    with with_effects([tmp_path / "law.py"]):
        again = simulate_tracks(TrackScenario(**sensor, seed=3, model=str(tmp_path / "law.yaml")))
    free = simulate_tracks(TrackScenario(**sensor, seed=3))
    left = np.abs(again.truth["w"] - made.truth["w"]).max()
    assert left < 0.2 * np.abs(free.truth["w"] - made.truth["w"]).max(), "the law moves the body as the jet did"


def test_a_constant_torque_is_the_catalogues() -> None:
    """Both forms say the same; the library holds more of them."""
    sensor = {"features": 0, "attitude_sigma": 1e-3, "range_sigma_m": 0.0, "frames": 150, "rate_deg": 4.0}
    torque = "constant-body-torque:torque_x=8e-5,torque_y=0,torque_z=4e-5"
    record = record_of_sequence(simulate_tracks(TrackScenario(**sensor, seed=3, effects=(torque,))).sequence)
    base, unknown = without_effects(record)
    law = discover(record, base, unknown)
    fit = best_fit(record, effects()["constant-body-torque"], base)
    assert law is not None and fit is not None
    named = Selection(
        base=base, unknown=unknown, tried=(Candidate(alone=fit),), verdict="named", named=(Candidate(alone=fit),)
    )
    against = against_selection(law, named)
    assert against is not None and -12.0 < against.ahead < 0.0


def test_free_motion_has_no_law() -> None:
    sensor = {"features": 0, "attitude_sigma": 1e-3, "range_sigma_m": 0.0, "frames": 100, "rate_deg": 4.0}
    record = record_of_sequence(simulate_tracks(TrackScenario(**sensor, seed=1)).sequence)
    base, unknown = without_effects(record)
    assert unknown is base, "the stated noise explains all that is left"
    base, unknown = without_effects(replace(record, noise_rows=1.0))
    assert unknown is not base and discover(record, base, unknown) is None
