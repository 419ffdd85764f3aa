"""Every effect: its name, its derivatives against differences, and that it does something."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import DIRECTIONS as BASIS
from massprops.dynamics.quaternion import conjugate, from_rotation_vector, multiply, normalise, rotation_vector
from massprops.dynamics.rigid_body import propagate
from massprops.dynamics.rotation import ActiveEffects, trajectory
from massprops.dynamics.sensitivities import sensitivities
from massprops.dynamics.translation import path
from massprops.effects import changes_motion, effects, of_record
from massprops.errors import InputError
from massprops.geometry.vectors import sphere
from massprops.model import document_of, load_model, model_of
from massprops.model.state import inertia_directions, inertia_of, moved_inertia, second_moment
from massprops.sequence.data import Environment, Orbit

NAMES = {
    "gravity-gradient-torque", "constant-body-torque", "viscous-damping", "eddy-current-torque",
    "solar-radiation-torque", "magnetic-dipole-torque", "energy-dissipation", "internal-rotor", "impulse",
    "inertia-change", "nonuniform-density", "drag-by-axis", "spring-mass-damper", "solar-pressure-on-facets", "drag-by-rate-squared", "second-impulse",
    "solar-pressure-on-mesh", "air-drag-on-mesh", "lens-distortion", "focal-length-error", "baseline-error",
    "stereo-time-offset", "chaser-rotation-drift", "rolling-shutter", "range-bias",
}  # fmt: skip
AROUND = EnvironmentModel(
    Environment(
        orbit=Orbit(3.986e14, 7e6, 0.01, 0.3),
        sun_direction=np.array([0.6, 0, 0.8]),
        magnetic_field_T=np.array([2e-5, 1e-5, 3e-5]),
    )
)
TIMES = np.arange(60) * 0.5
RNG = np.random.default_rng(5)
INERTIA = inertia_of(np.diag([0.3, 0.5, 0.7]) + 0.05 * (np.ones((3, 3)) - np.eye(3)))
W0, Q0 = np.array([0.1, 0.12, -0.05]), normalise(np.array([0.3, 0.5, -0.2, 0.7]))
FACES = [[*n, a, *r] for n, a, r in zip(sphere(12), np.full(12, 1 / 12), 0.2 * sphere(12)[::-1] + 0.05, strict=True)]
OF_RECORD = {
    "wheel of a measured rate": of_record(
        effects()["internal-rotor"], {"times_s": [0.0, 9.0, 12.0, 29.5], "rate_rad_s": [0.0, 10.0, 40.0, 30.0]}
    ),
    **{
        n: of_record(effects()[n], {"faces": FACES, "orbit_normal": [0, 0, 1]})
        for n in ("solar-pressure-on-mesh", "air-drag-on-mesh")
    },
}
MOTION = [*OF_RECORD, *(n for n, e in effects().items() if changes_motion(e) and n not in OF_RECORD)]


def active(name: str, duration: float = 0.0) -> tuple[ActiveEffects, np.ndarray]:
    effect = OF_RECORD.get(name, effects().get(name))
    assert effect is not None
    rng = np.random.default_rng(3)
    values = []
    for q in effect.PARAMETERS:
        size = {"gravity-gradient-torque": 50.0}.get(name, q.size)
        values.append({"time": 14.7, "span": 29.5, "duration": duration}.get(q.kind, size * rng.uniform(0.3, 1.0)))
    return ActiveEffects((effect,), (slice(0, len(values)),)), np.array(values)


def test_the_catalogue_holds_the_names_of_the_interface() -> None:
    assert set(effects()) >= NAMES, "users ask for them by name"
    for effect in effects().values():
        assert effect.SENTENCE.endswith(".") and effect.PARAMETERS


def test_free_rotation_agrees_with_the_fine_integration() -> None:
    got = trajectory(TIMES, Q0, W0, INERTIA, ActiveEffects((), ()), np.zeros(0), AROUND)
    q, w = propagate(Q0, W0, INERTIA, TIMES, largest_turn=0.005)
    assert np.abs(rotation_vector(multiply(conjugate(q), got.q))).max() < 1e-6
    assert np.abs(w - got.w).max() < 1e-7


@pytest.mark.parametrize(("name", "duration"), [*((n, 0.0) for n in MOTION), ("impulse", 3.1)])
def test_derivatives_agree_with_differences(name: str, duration: float) -> None:
    a, p = active(name, duration)
    ways = inertia_directions(INERTIA)
    got = trajectory(TIMES, Q0, W0, INERTIA, a, p, AROUND)
    turn, rate = sensitivities(TIMES, got, Q0, W0, INERTIA, ways, a, p, AROUND)
    free = trajectory(TIMES, Q0, W0, INERTIA, ActiveEffects((), ()), np.zeros(0), AROUND)
    assert np.abs(got.w - free.w).max() > 1e-9, "the effect does nothing"
    for j in range(11 + len(p)):
        step = 1e-5 if j < 11 else 1e-5 * max(1.0, abs(p[j - 11]))
        ends = []
        for sign in (1, -1):
            q, w, inertia, values = Q0, W0.copy(), INERTIA, p.copy()
            if j < 3:
                q = multiply(Q0, from_rotation_vector(sign * step * np.eye(3)[j]))
            elif j < 6:
                w[j - 3] += sign * step
            elif j < 11:
                inertia = INERTIA + sign * step * ways[j - 6]
            elif a.effects[0].PARAMETERS[j - 11].kind in ("number", "time"):
                values[j - 11] += sign * step
            ends.append(trajectory(TIMES, q, w, inertia, a, values, AROUND))
        if j >= 11 and a.effects[0].PARAMETERS[j - 11].kind not in ("number", "time"):
            continue
        by_turn = rotation_vector(multiply(conjugate(ends[1].q), ends[0].q)) / (2 * step)
        by_rate = (ends[0].w - ends[1].w) / (2 * step)
        assert np.abs(by_turn - turn[:, :, j]).max() <= 2e-3 * np.abs(turn[:, :, j]).max() + 1e-6
        assert np.abs(by_rate - rate[:, :, j]).max() <= 2e-3 * np.abs(rate[:, :, j]).max() + 1e-6


@pytest.mark.parametrize(("frequency", "damping"), [(1.2, 0.1), (0.6, 8.0)])
def test_a_spring_faster_than_the_body_has_its_derivatives(frequency: float, damping: float) -> None:
    """Steps that follow the body's turning alone are unstable, and wrong by the size of a derivative."""
    effect = effects()["spring-mass-damper"]
    a = ActiveEffects((effect,), (slice(0, len(effect.PARAMETERS)),))
    p = np.array([0.1, 0.15, -0.2, 0.6, 0.0, 0.8, frequency, damping, 0.01, 0.0])
    times = np.arange(150) * 2.0
    directions = np.zeros((0, 3, 3))
    turn, _ = sensitivities(
        times, trajectory(times, Q0, W0, INERTIA, a, p, AROUND), Q0, W0, INERTIA, directions, a, p, AROUND
    )
    for j in (6, 7):
        step = 1e-5 * p[j] * np.eye(len(p))[j]
        down, up = (trajectory(times, Q0, W0, INERTIA, a, v, AROUND) for v in (p - step, p + step))
        moved = rotation_vector(multiply(conjugate(down.q), up.q)) / (2.0 * step[j])
        assert np.abs(moved - turn[:, :, 6 + j]).max() < 0.05 * np.abs(moved).max()


def test_a_sphere_inside_keeps_momentum_and_loses_energy() -> None:
    effect = effects()["energy-dissipation"]
    a = ActiveEffects((effect,), (slice(0, 2),))
    times = np.arange(2000) * 0.5
    got = trajectory(times, Q0, W0, INERTIA, a, np.array([0.2, 0.1]), AROUND)
    total = np.linalg.norm(got.y[:, 4:7], axis=1)
    assert np.ptp(total) < 1e-5 * total[0]
    energy = np.einsum("ni,ij,nj->n", got.w, INERTIA, got.w)
    assert energy[-1] < 0.99 * energy[0]


def test_the_path_about_a_planet_has_its_derivatives() -> None:
    r0, v0 = np.array([3.0, -2.0, 12.0]), np.array([0.01, 0.02, -0.01])
    times = np.linspace(0, 900, 40)
    nothing = ActiveEffects((), ())
    r, v, dr, dv = path(times, r0, v0, nothing, np.zeros(0), AROUND)
    assert np.abs(np.gradient(r, times, axis=0)[5:-5] - v[5:-5]).max() < 1e-4
    for j in range(6):
        move = 1e-2 * np.eye(6)[j] * (1 if j < 3 else 1e-2)
        up = path(times, r0 + move[:3], v0 + move[3:], nothing, np.zeros(0), AROUND)
        down = path(times, r0 - move[:3], v0 - move[3:], nothing, np.zeros(0), AROUND)
        size = 2 * np.abs(move).max()
        assert np.allclose((up[0] - down[0]) / size, dr[:, :, j], atol=1e-4 * np.abs(dr[:, :, j]).max() + 1e-9)
        assert np.allclose((up[1] - down[1]) / size, dv[:, :, j], atol=1e-4 * np.abs(dv[:, :, j]).max() + 1e-9)


def test_inertia_steps_stay_physical_and_have_the_stated_slope() -> None:
    for d in (np.zeros(5), np.array([3.0, -2, 1, 4, -3])):
        moved = moved_inertia(INERTIA, d)
        assert np.linalg.eigvalsh(second_moment(moved)).min() > 0
        assert np.trace(moved) == pytest.approx(3.0)
    for k, way in enumerate(inertia_directions(INERTIA)):
        step = 1e-6 * np.eye(len(BASIS))[k]
        assert np.allclose((moved_inertia(INERTIA, step) - moved_inertia(INERTIA, -step)) / 2e-6, way, atol=1e-6)


def test_a_model_comes_back_from_its_file(tmp_path) -> None:
    import yaml

    model = model_of({"viscous-damping": np.array([1e-3]), "lens-distortion": np.array([0.02, -0.01])}, INERTIA)
    path_ = tmp_path / "model.yaml"
    path_.write_text(yaml.safe_dump(document_of(model)))
    back = load_model(path_)
    assert back.names == ("viscous-damping", "lens-distortion")
    assert np.allclose(back.value("lens-distortion"), [0.02, -0.01]) and np.allclose(back.inertia, INERTIA)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("format: massprops-model/1\neffects: [{name: warp-drive, parameters: {}}]", "warp-drive"),
        ("format: massprops-model/1\neffects: [{name: viscous-damping, parameters: {}}]", "damping"),
        ("format: other", "format"),
        ("format: massprops-model/1\ninertia: [[1,0,0],[0,1,0],[0,0,3]]", "triangle"),
    ],
)
def test_a_wrong_model_file_is_one_line(tmp_path, text: str, said: str) -> None:
    (tmp_path / "m.yaml").write_text(text)
    with pytest.raises(InputError, match=said):
        load_model(tmp_path / "m.yaml")


def test_an_effect_outside_the_catalogue_acts_as_one_in_it() -> None:
    a, p = active("viscous-damping")
    copy = SimpleNamespace(**{k: v for k, v in vars(a.effects[0]).items() if not k.startswith("__")})
    inside = trajectory(TIMES, Q0, W0, INERTIA, a, p, AROUND)
    outside = trajectory(TIMES, Q0, W0, INERTIA, ActiveEffects((copy,), a.places), p, AROUND)
    assert np.abs(inside.w - outside.w).max() < 1e-12 and np.abs(inside.q - outside.q).max() < 1e-12
