"""A dipole fixed in a body in the field of a planet, moved by Basilisk's torque bar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprops.diagnosis.effect_search import best_fit
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.unnamed import without_effects
from massprops.dynamics.environment import EnvironmentModel
from massprops.effects import effects
from massprops.sequence.data import Sequence

NAME = "magnetic-dipole-torque"


def _fit(sequence: Sequence) -> HypothesisFit:
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    found = best_fit(record, effects()[NAME], without_effects(record)[0])
    assert found is not None
    return found


def test_the_dipole_is_found_in_a_field_that_turns_along_the_orbit(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("Basilisk")
    from diagnosis import basilisk_worlds as worlds

    own, truth = worlds.KINDS[NAME], {}

    def kept(world, hub, rng, inertia, w):
        found = own(world, hub, rng, inertia, w)
        truth["dipole"] = found["dipole"] / (np.trace(inertia) / 3.0)
        return found

    monkeypatch.setitem(worlds.KINDS, NAME, kept)
    sequence = worlds.recorded(NAME, 2)
    fit = _fit(sequence)
    off = fit.values[NAME] - truth["dipole"]
    assert off @ np.linalg.solve(fit.covariance[NAME], off) < 16.0
    assert np.sqrt(np.mean(fit.residual**2)) < 1.05
    around = EnvironmentModel(sequence.environment)
    middle = np.array(around.field_at(450.0))
    still = replace(sequence.environment, magnetic_dipole_T_m3=None, magnetic_field_T=middle)
    assert np.sqrt(np.mean(_fit(replace(sequence, environment=still)).residual ** 2)) > 1.5
