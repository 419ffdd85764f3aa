"""Free bodies with two of the catalogue's effects, drawn at random, moved by Basilisk's or MuJoCo's physics.

No equation of `massprops.dynamics` has a part in the motion: mechanisms are MuJoCo's bodies and joints or Basilisk's effectors,
torques are written here in numpy and held for a step of MuJoCo's. A record holds attitudes with noise and what a caller knows
of the surroundings: the Sun, the magnetic field, the orbit. Each effect shows by itself (`shows`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from massprops.dynamics.quaternion import from_rotation_vector, multiply, normalise
from massprops.sequence.data import AttitudeSeries, Environment, Orbit, Sequence

SECONDS, PERIOD_S, STEP_S = 900.0, 2.0, 0.04
SIGMA = np.radians(0.05)
MASS_KG = 40.0
MU, RADIUS_M = 3.986004415e14, 6.9e6
ORBITING = np.sqrt(MU / RADIUS_M**3)
FIELD_T = np.array([2e-5, -1e-5, 3e-5])
LEAST_SHOWN = 1.15
CALLED = {"sunlight": "solar-pressure-on-facets"}
Torque = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
"""Of time, attitude (3, 3) body to inertial and rate in body axes; body axes [N m]."""


@dataclass(frozen=True, kw_only=True)
class World:
    """What is common to all effects of one record. momentum: of the body at the start [N m s]."""

    inertia: np.ndarray
    start: np.ndarray
    rate: np.ndarray
    sun: np.ndarray

    @property
    def momentum(self) -> float:
        return float(np.linalg.norm(self.inertia @ self.rate))


@dataclass(frozen=True, kw_only=True)
class Acting:
    """One effect: a torque, or MJCF of what is inside with speeds of its joints at the start and a servo's target over time.

    held: what a diagnosis scans of it, as it is; axis, history: of a wheel, its momentum over time [N m s].
    """

    torque: Torque | None = None
    inside: str = ""
    actuator: str = ""
    speeds: tuple[float, ...] = ()
    target: Callable[[float], float] | None = None
    held: dict[str, float] = field(default_factory=dict)
    axis: np.ndarray | None = None
    history: Callable[[np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True)
class Pair:
    """A record and what acts in it, by the catalogue's names."""

    sequence: Sequence
    names: tuple[str, str]
    engine: str


def _way(rng: np.random.Generator) -> np.ndarray:
    x = rng.standard_normal(3)
    return np.asarray(x / np.linalg.norm(x))


def _leak(rng: np.random.Generator, world: World) -> Acting:
    torque = _way(rng) * world.momentum * rng.uniform(0.08, 0.25) / SECONDS
    return Acting(torque=lambda t, R, w: torque)


def _dipole(rng: np.random.Generator, world: World) -> Acting:
    moment = _way(rng) * world.momentum * rng.uniform(0.3, 1.0) / SECONDS / np.linalg.norm(FIELD_T)
    return Acting(torque=lambda t, R, w: np.cross(moment, R.T @ FIELD_T))


def _sunlight(rng: np.random.Generator, world: World) -> Acting:
    """A box with a wing: every lit face absorbs, and reflects a part like a mirror."""
    shift = rng.uniform(-0.25, 0.25, 3)
    faces = [(s * np.eye(3)[k], 1.0, s * 0.6 * np.eye(3)[k]) for k in range(3) for s in (1.0, -1.0)]
    wing = _way(rng)
    faces += [(s * wing, 4.0, 1.6 * _way(rng)) for s in (1.0,)]
    faces += [(-faces[-1][0], 4.0, faces[-1][2])]
    normals, areas, places = (np.array([f[k] for f in faces]) for k in range(3))
    shine = rng.uniform(0.1, 0.5, len(faces))

    def unit(sun: np.ndarray) -> np.ndarray:
        lit = np.maximum(normals @ sun, 0.0)
        force = -(areas * lit)[:, None] * ((1 - shine)[:, None] * sun + 2 * (shine * lit)[:, None] * normals)
        return np.asarray(np.cross(places + shift, force).sum(axis=0))

    typical = np.sqrt(np.mean([np.sum(unit(_way(rng)) ** 2) for _ in range(200)]))
    size = world.momentum * rng.uniform(0.3, 1.0) / SECONDS / typical
    return Acting(torque=lambda t, R, w: size * unit(R.T @ world.sun))


def _viscous(rng: np.random.Generator, world: World) -> Acting:
    damping = rng.uniform(0.08, 0.3) / SECONDS * np.trace(world.inertia) / 3
    return Acting(torque=lambda t, R, w: -damping * w)


def _drag(rng: np.random.Generator, world: World) -> Acting:
    damping = rng.uniform(0.03, 0.5, 3) / SECONDS * np.trace(world.inertia) / 3
    return Acting(torque=lambda t, R, w: -damping * w)


def _eddies(rng: np.random.Generator, world: World) -> Acting:
    conductance = rng.uniform(0.1, 0.4) / SECONDS * np.trace(world.inertia) / 3 / (FIELD_T @ FIELD_T)

    def torque(t: float, R: np.ndarray, w: np.ndarray) -> np.ndarray:
        b = R.T @ FIELD_T
        return conductance * np.cross(np.cross(w, b), b)

    return Acting(torque=torque)


def _gravity(rng: np.random.Generator, world: World) -> Acting:
    def torque(t: float, R: np.ndarray, w: np.ndarray) -> np.ndarray:
        up = R.T @ np.array([np.cos(ORBITING * t), np.sin(ORBITING * t), 0.0])
        return np.asarray(3 * ORBITING**2 * np.cross(up, world.inertia @ up))

    return Acting(torque=torque)


def _firing(rng: np.random.Generator, world: World) -> Acting:
    begins, length = rng.uniform(0.2, 0.8) * SECONDS, rng.choice([0.5, 4.0, 15.0])
    torque = _way(rng) * world.momentum * rng.uniform(0.05, 0.25) / length
    held = {"time": float(begins), "duration": float(length), "parts": 1}
    return Acting(torque=lambda t, R, w: torque * (begins <= t < begins + length), held=held)


def _wheel(rng: np.random.Generator, world: World) -> Acting:
    """A wheel on a motor, at one speed or brought to another one evenly over a part of the record."""
    size = world.momentum * rng.uniform(0.08, 0.2)
    moment, speed = size / 4.0, 4.0
    begins, length = rng.uniform(0.2, 0.5) * SECONDS, rng.uniform(0.1, 0.4) * SECONDS
    other = speed * rng.choice([1.0, -0.5, 2.5])
    x, y, z = axis = _way(rng)
    inside = (
        f'<body pos="0.2 -0.1 0.15"><joint name="axle" type="hinge" axis="{x} {y} {z}"/>'
        f'<inertial pos="0 0 0" mass="2" diaginertia="{moment} {moment} {moment}"/></body>'
    )
    return Acting(
        inside=inside, actuator=f'<velocity joint="axle" kv="{10 * moment}"/>', speeds=(speed,),
        target=lambda t: float(speed + (other - speed) * np.clip((t - begins) / length, 0.0, 1.0)), axis=axis,
        history=lambda t: moment * (speed + (other - speed) * np.clip((t - begins) / length, 0.0, 1.0)),
    )  # fmt: skip


def _sphere(rng: np.random.Generator, world: World) -> Acting:
    """A ball on a damped joint."""
    moment = rng.uniform(0.05, 0.15) * np.trace(world.inertia) / 3
    damping = moment * np.linalg.norm(world.rate) * rng.uniform(0.3, 2.0)
    inside = (
        f'<body pos="0.1 0.1 -0.2"><joint type="ball" damping="{damping}"/>'
        f'<inertial pos="0 0 0" mass="3" diaginertia="{moment} {moment} {moment}"/></body>'
    )
    return Acting(inside=inside, speeds=(0.0, 0.0, 0.0), held={"coupling": float(damping / moment)})


def _boom(rng: np.random.Generator, world: World) -> Acting:
    """A mass is driven along a rail: there within a second."""
    x, y, z = _way(rng)
    kilos, metres, begins = rng.uniform(0.8, 2.0), rng.uniform(0.4, 0.8), rng.uniform(0.25, 0.75) * SECONDS
    inside = (
        f'<body pos="{0.5 * x} {0.5 * y} {0.5 * z}"><joint name="rail" type="slide" axis="{x} {y} {z}" damping="{20 * kilos}"/>'
        f'<inertial pos="0 0 0" mass="{kilos}" diaginertia="0.01 0.01 0.01"/></body>'
    )
    return Acting(
        inside=inside, actuator=f'<position joint="rail" kp="{100 * kilos}"/>', speeds=(0.0,),
        target=lambda t: metres if t >= begins else 0.0, held={"time": float(begins)},
    )  # fmt: skip


def sliding(rng: np.random.Generator, world: World) -> tuple[Acting, dict[str, np.ndarray]]:
    """A mass on a rail with a spring and a damper, and the parameters of `spring-mass-damper` that it is."""
    way, at, kilos = _way(rng), rng.uniform(0.3, 0.8) * _way(rng), rng.uniform(1.0, 3.0)
    frequency, ratio = np.linalg.norm(world.rate) * rng.uniform(1.2, 6.0), rng.uniform(0.02, 0.5)
    stiff, damping = kilos * frequency**2, 2.0 * ratio * frequency * kilos
    x, y, z = at
    inside = (
        f'<body pos="{x} {y} {z}"><joint type="slide" axis="{way[0]} {way[1]} {way[2]}" stiffness="{stiff}" damping="{damping}"/>'
        f'<inertial pos="0 0 0" mass="{kilos}" diaginertia="0.01 0.01 0.01"/></body>'
    )
    reduced = kilos * MASS_KG / (kilos + MASS_KG)
    inertia = world.inertia + reduced * (at @ at * np.eye(3) - np.outer(at, at)) + 0.01 * np.eye(3)
    truth = {
        "inertia": 3.0 * inertia / np.trace(inertia),
        "arm": np.sqrt(3.0 * reduced / np.trace(inertia)) * at,
        "along": way,
        "frequency": np.sqrt(stiff / reduced),
        "damping": damping / reduced,
    }
    held = {f"{part}_{a}": float(x) for part in ("arm", "along") for a, x in zip("xyz", truth[part], strict=True)}
    held |= {"displacement": 0.0, "velocity": 0.0} | {n: float(truth[n]) for n in ("frequency", "damping")}
    return Acting(inside=inside, speeds=(0.0,), held=held), truth


def slid(seed: int) -> tuple[Sequence, World, dict[str, np.ndarray]]:
    """The record of a body with a sliding mass, and what it is."""
    rng = np.random.default_rng([seed, 101])
    world = _world(rng)
    acting, truth = sliding(rng, world)
    return _sequence(*moved(world, [acting]), world.sun, np.random.default_rng([seed, 102])), world, truth


MUJOCO: dict[str, Callable[[np.random.Generator, World], Acting]] = {
    "constant-body-torque": _leak, "magnetic-dipole-torque": _dipole, "sunlight": _sunlight, "viscous-damping": _viscous,
    "drag-by-axis": _drag, "eddy-current-torque": _eddies, "gravity-gradient-torque": _gravity, "impulse": _firing,
    "internal-rotor": _wheel, "energy-dissipation": _sphere, "inertia-change": _boom,
}  # fmt: skip
BASILISK = ("gravity-gradient-torque", "sunlight", "constant-body-torque", "impulse", "internal-rotor")
LIKE = ({"viscous-damping", "drag-by-axis"}, {"internal-rotor", "energy-dissipation"})
"""Never together: one holds the other, or both are one hinge's matter in `moved`."""


def moved(world: World, acting: list[Acting]) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and attitudes (n, 4), body to inertial, of MuJoCo's body."""
    import mujoco

    moments, axes = np.linalg.eigh(world.inertia)
    axes = axes if np.linalg.det(axes) > 0 else -axes
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, axes.ravel())
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0" timestep="{STEP_S}" integrator="RK4"/><worldbody><body name="main"><freejoint/>'
        f'<inertial pos="0 0 0" mass="{MASS_KG}" diaginertia="{" ".join(f"{m:.12g}" for m in moments)}"'
        f' quat="{" ".join(f"{v:.12g}" for v in quat)}"/>{"".join(a.inside for a in acting)}</body></worldbody>'
        f"<actuator>{''.join(a.actuator for a in acting)}</actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[3:7] = world.start
    speeds = [v for a in acting for v in a.speeds]
    data.qvel[3:6], data.qvel[6 : 6 + len(speeds)] = world.rate, speeds
    torques = [a.torque for a in acting if a.torque is not None]
    targets = [a.target for a in acting if a.target is not None]
    times, out, R = [], [], np.zeros(9)
    for _ in range(int(SECONDS / PERIOD_S)):
        times.append(data.time)
        out.append(data.qpos[3:7].copy())
        for _ in range(round(PERIOD_S / STEP_S)):
            mujoco.mju_quat2Mat(R, data.qpos[3:7])
            # a free joint's rate and torque are in body axes
            data.qfrc_applied[3:6] = sum((f(data.time, R.reshape(3, 3), data.qvel[3:6]) for f in torques), np.zeros(3))
            data.ctrl[:] = [f(data.time) for f in targets]
            mujoco.mj_step(model, data)
    return np.array(times), np.array(out)


def _world(rng: np.random.Generator) -> World:
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    second = rng.uniform(4.0, 16.0, 3)
    inertia = turn @ np.diag(second.sum() - second) @ turn.T
    start = rng.standard_normal(4)
    rate = _way(rng) * np.radians(rng.uniform(1.0, 3.0))
    return World(inertia=inertia, start=start / np.linalg.norm(start), rate=rate, sun=_way(rng))


def _sequence(times: np.ndarray, q: np.ndarray, sun: np.ndarray, rng: np.random.Generator) -> Sequence:
    noisy = normalise(multiply(q, from_rotation_vector(SIGMA * rng.standard_normal((len(q), 3)))))
    around = Environment(orbit=Orbit(MU, RADIUS_M, 0.0, 0.0), sun_direction=sun, magnetic_field_T=FIELD_T)
    series = AttitudeSeries(np.round(times * 1e9).astype(np.int64), noisy, np.full(len(times), SIGMA))
    return Sequence(attitude=series, environment=around)


def shows(sequence: Sequence) -> bool:
    """Whether a free rigid body leaves more than `LEAST_SHOWN` of the noise."""
    from massprops.core.robust import rms
    from massprops.diagnosis.record import record_of_attitudes
    from massprops.diagnosis.unnamed import without_effects

    assert sequence.attitude is not None
    base, _ = without_effects(record_of_attitudes(sequence.attitude, sequence.environment))
    return rms(base.residual) > LEAST_SHOWN


def _of_mujoco(rng: np.random.Generator, seed: int, rejected: int | None) -> tuple[Sequence, tuple[str, str]]:
    hidden = 0
    while True:
        world = _world(rng)
        a, b = (str(k) for k in rng.choice(list(MUJOCO), 2, replace=False))
        acting = [MUJOCO[a](rng, world), MUJOCO[b](rng, world)]
        if {a, b} in LIKE:
            continue
        alone = (_sequence(*moved(world, [x]), world.sun, np.random.default_rng([seed, 79])) for x in acting)
        if hidden == rejected if rejected is not None else all(shows(s) for s in alone):
            return _sequence(*moved(world, acting), world.sun, np.random.default_rng([seed, 78])), (a, b)
        hidden += 1


def _of_basilisk(rng: np.random.Generator) -> tuple[Sequence, tuple[str, str]]:
    from diagnosis.basilisk_worlds import recorded

    while True:
        a, b = (str(k) for k in rng.choice(BASILISK, 2, replace=False))
        seed = int(rng.integers(1000, 1000000))
        if all(shows(recorded(k, seed)) for k in (a, b)):
            return recorded(f"{a}+{b}", seed), (a, b)


def drawn(seed: int, rejected: int | None = None) -> Pair:
    """The record of one seed: MuJoCo's for two seeds of three, whose kinds are more.

    Args:
        rejected: how many pairs of MuJoCo's are drawn before it of which an effect does not show, where that is known: finding
            out takes longer than the record.
    """
    rng = np.random.default_rng([seed, 97])
    engine = "basilisk" if seed % 3 == 0 else "mujoco"
    sequence, (a, b) = _of_basilisk(rng) if engine == "basilisk" else _of_mujoco(rng, seed, rejected)
    return Pair(sequence, (CALLED.get(a, a), CALLED.get(b, b)), engine)
