"""The compiled kernel and the plain integration are the same equations: which of the two is used changes no number."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.dynamics import rotation
from massprops.dynamics.compiled_integration import integrated
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.quaternion import normalise
from massprops.effects import effects
from massprops.model import model_of
from massprops.sequence.data import Environment, Orbit

INERTIA = np.array([[0.8, 0.05, -0.1], [0.05, 1.0, 0.02], [-0.1, 0.02, 1.2]])


@pytest.mark.parametrize("name", ["", "viscous-damping", "energy-dissipation", "spring-mass-damper"])
def test_kernel_and_plain_integration_agree(name: str) -> None:
    rng = np.random.default_rng(4)
    values = (
        {name: np.array([0.01, 0.1, 0.3, 0.2, 0.4, 0.1, 0.2, 0.02, 0.05, 0.01][: len(effects()[name].PARAMETERS)])}
        if name
        else {}
    )
    model = model_of(values)
    active, p = model.active, list(model.flat(True))
    environment = EnvironmentModel(Environment())
    six = tuple(float(v) for v in rotation.six_of(INERTIA))
    y = rotation.start_state(list(normalise(rng.standard_normal(4))), [0.1, -0.2, 0.15], six, active, p)
    start, size = np.arange(40) * 0.3, np.full(40, 0.3)
    plain = rotation._integrated_plainly(y, start, size, six, p, active, environment)
    assert np.abs(plain[-1] - plain[0]).max() > 0.1
    assert np.allclose(integrated(y, start, size, six, p, active, environment), plain, rtol=0, atol=1e-15)


def test_a_field_that_changes_along_the_orbit_is_the_same_in_both() -> None:
    model = model_of({"magnetic-dipole-torque": np.array([300.0, -200.0, 500.0])})
    active, p = model.active, list(model.flat(True))
    around = Environment(orbit=Orbit(3.986e14, 7e6, 0.1, 0.3), magnetic_dipole_T_m3=np.array([4e15, 0.0, -7e15]))
    environment = EnvironmentModel(around)
    six = tuple(float(v) for v in rotation.six_of(INERTIA))
    y = rotation.start_state([1.0, 0.0, 0.0, 0.0], [0.01, -0.02, 0.015], six, active, p)
    start, size = np.arange(400) * 2.0, np.full(400, 2.0)
    plain = rotation._integrated_plainly(y, start, size, six, p, active, environment)
    # the plain one asks a little inside of each step
    assert np.allclose(integrated(y, start, size, six, p, active, environment), plain, rtol=0, atol=1e-8)
    still = EnvironmentModel(Environment(magnetic_field_T=np.array(environment.field_at(0.0))))
    assert np.abs(integrated(y, start, size, six, p, active, still) - plain).max() > 0.1


@pytest.mark.parametrize("compiled", [False, True])
def test_what_was_imported_does_not_choose_the_integrator(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    went = []
    for name in ("_integrated_compiled", "_integrated_plainly"):
        own = getattr(rotation, name)
        monkeypatch.setattr(rotation, name, lambda *given, own=own, name=name: went.append(name) or own(*given))
    model = model_of({})
    environment = EnvironmentModel(Environment(), compiled=compiled)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    rotation.trajectory(np.arange(3.0), q, np.array([0.1, 0.2, 0.3]), INERTIA, model.active, np.zeros(0), environment)
    assert went == ["_integrated_compiled" if compiled else "_integrated_plainly"]
