"""A shift of whole images that nothing is known of: what a camera's mount does is not named as what acts on the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprops.diagnosis.latent_torque import factor, hats, matern
from massprops.diagnosis.search.case import Case, case_of
from massprops.diagnosis.search.diagnose import diagnose
from massprops.diagnosis.search.latent_shift import latent_shift
from massprops.diagnosis.search.refit import refit
from massprops.model.problem import problem_of
from massprops.sequence.data import Sequence
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks


def seen(seed: int, effects: tuple[str, ...] = ()) -> Sequence:
    return simulate_tracks(TrackScenario(frames=160, seed=seed, assumed=False, effects=effects)).sequence


def shifted(sequence: Sequence, pixels: float, seed: int, length: float = 0.4) -> Sequence:
    """The tracks with every frame of both cameras shifted by a smooth random path of some pixels."""
    assert sequence.tracks is not None
    times, at = np.unique(sequence.tracks.timestamp_ns, return_inverse=True)
    x, knots = np.linspace(0.0, 1.0, len(times)), np.linspace(0.0, 1.0, 40)
    rng = np.random.default_rng([seed, 7])
    path = pixels * hats(x, knots) @ factor(matern(knots, length)) @ rng.standard_normal((40, 2))
    return replace(sequence, tracks=replace(sequence.tracks, uv=sequence.tracks.uv + path[at]))


def case(sequence: Sequence) -> Case:
    return case_of(problem_of(sequence))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_camera_that_gives_way_is_not_named_as_what_acts_on_the_body(seed: int) -> None:
    found = diagnose(shifted(seen(seed), 0.6, seed))
    assert found.document["verdict"] == "unexplained"
    assert "shift of each camera's whole image" in found.document["reason"]
    shift = found.selection.shift  # type: ignore[union-attr]
    assert shift is not None and 0.1 < shift.rms_px < 1.2  # what a straight path takes up is not in it


def test_without_a_shift_none_is_likelier_than_the_body_at_rest_in_its_orbit() -> None:
    whole = case(seen(3))
    found = latent_shift(whole, refit(whole, whole.first.state, ()))
    assert found is not None and found.gain < 1.0 and found.rms_px < 0.05


def test_a_torque_is_likelier_than_a_shift() -> None:
    found = diagnose(seen(5, ("constant-body-torque:4",)))
    assert found.document["verdict"] == "named" and found.selection.shift is None  # type: ignore[union-attr]


def test_without_tracks_there_is_no_shift() -> None:
    sequence = simulate_tracks(TrackScenario(frames=80, seed=4, features=0, rate_sigma=1e-4)).sequence
    whole = case(sequence)
    assert latent_shift(whole, refit(whole, whole.first.state, ())) is None
