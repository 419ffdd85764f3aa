"""Free bodies with something hidden inside, moved by MuJoCo's physics, and what stereo cameras see of them.

The bodies are described by masses, joints, servos and forces; no equation of `massprops.dynamics` has a part in their
motion. World axes are cam0's (right, down, forward); the body's axes are those of its main part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from massprops.sequence.data import Camera, RangeSeries, Sequence, Tracks

FRAMES, RATE_HZ, TURN_DEG = 240, 2.0, 3.0
FEATURES, SPAN_M, DISTANCE_M = 14, 2.0, 9.0
BASELINE_M, FOCAL_PX, SIZE = 1.0, 1000.0, (1280, 1024)
SIGMA_PX, SIGMA_RANGE_M = 0.3, 0.02
SUBSTEPS = 200
"""Steps of MuJoCo's fourth-order Runge-Kutta method in a frame: 2.5 ms."""
MASS, MOMENTS = 40.0, (8.0, 11.0, 14.0)
"""Main part [kg], [kg m^2]."""
WHEEL_MOMENT, WHEEL_SPEED = 0.05, 2.0
"""[kg m^2], [rad/s] against the body: 0.1 N m s beside the body's 1.2."""
SPHERE_MOMENT, SPHERE_DAMPING = 1.0, 0.1
"""[kg m^2], [N m s]: the sphere follows in 10 s, about a radian of the body's turning."""
KNOCK_S, KNOCK_STEPS, KNOCK_N = 61.3, 12, (2.5, -1.5, 2.0)
"""A force in world axes for 30 ms, at KNOCK_AT in the body."""
KNOCK_AT = (0.7, 0.5, -0.3)
BALL_KG, BALL_M_S, BALL_S = 2.0, 0.06, 60.0
"""A ball that arrives after a minute, from where nothing else acts on it."""
TENDON_KG, TENDON_RAD_S = 3.0, 0.3
"""Mass on a tendon and its frequency, three times the body's rate."""
DEPLOY_S, DEPLOYED_KG, DEPLOYED_M = 58.1, 1.5, 0.5
"""A mass is driven along a rail, and is there a third of a second later."""


@dataclass(frozen=True)
class Motion:
    """What MuJoCo's body did at n frames.

    Attributes:
        times (n,) [s]; R (n, 3, 3) main part's axes to world; origin, centre (n, 3) of the main part and of all mass [m].
        momentum (n, 3) angular, about the centre of all mass, world axes [N m s]; energy (n,) kinetic [J].
        moment (n,) mean of the three moments of inertia of all mass about its centre [kg m^2].
        strikes: how many times what comes by touches the body.
    """

    times: np.ndarray
    R: np.ndarray
    origin: np.ndarray
    centre: np.ndarray
    momentum: np.ndarray
    energy: np.ndarray
    moment: np.ndarray
    strikes: int = 0


@dataclass(frozen=True)
class Body:
    """inside, actuator, tendon: MJCF of what is hidden; beside: of other bodies; speeds: joint speeds at the start [rad/s or m/s];
    push: told of time and given what to act on; run_in: seconds that pass before the record."""

    effect: str
    inside: str = ""
    actuator: str = ""
    speeds: tuple[float, ...] = ()
    push: Callable[[Any, Any, Any, float], None] = lambda mujoco, model, data, t: None
    run_in: float = 0.0
    beside: str = ""
    tendon: str = ""


def _knock(mujoco: Any, model: Any, data: Any, t: float) -> None:
    data.qfrc_applied[:] = 0.0
    step = model.opt.timestep
    if KNOCK_S - 0.5 * step <= t < KNOCK_S + (KNOCK_STEPS - 0.5) * step:
        point = data.xpos[1] + data.xmat[1].reshape(3, 3) @ np.array(KNOCK_AT)
        mujoco.mj_applyFT(model, data, np.array(KNOCK_N), np.zeros(3), point, 1, data.qfrc_applied)


def _deploy(mujoco: Any, model: Any, data: Any, t: float) -> None:
    data.ctrl[0] = DEPLOYED_M if t >= DEPLOY_S - 0.5 * model.opt.timestep else 0.0


def _sliding(at: str, axis: str) -> tuple[str, str]:
    # a servo that is critically damped at 40 rad/s: there within a third of a second, and no swinging after
    stiff, damp = DEPLOYED_KG * 40.0**2, 2 * DEPLOYED_KG * 40.0
    return (
        f'<body pos="{at}"><joint name="rail" type="slide" axis="{axis}" damping="{damp}"/>'
        f'<inertial pos="0 0 0" mass="{DEPLOYED_KG}" diaginertia="0.01 0.01 0.01"/></body>',
        f'<position joint="rail" kp="{stiff}"/>',
    )


def _struck() -> Body:
    """A ball that comes by and bounces off a soft side: MuJoCo's own contact, for a second or two."""
    soft = 'condim="1" friction="0 0 0" solref="1.6 0.3"'
    x, y, z = 0.3 + BALL_M_S * BALL_S + 0.9, -0.2 + 0.3, DISTANCE_M + 0.25
    return Body(
        "impulse", f'<geom type="box" size="0.8 0.7 0.6" mass="0" {soft}/>', speeds=(-BALL_M_S, 0.0, 0.0),
        beside=f'<body pos="{x} {y} {z}"><freejoint/><geom type="sphere" size="0.15" mass="{BALL_KG}" {soft}/></body>',
    )  # fmt: skip


def _on_a_tendon() -> Body:
    """A mass on a rail that only a tendon's spring and damping hold."""
    stiff, damp = TENDON_KG * TENDON_RAD_S**2, 2.0 * TENDON_KG * TENDON_RAD_S * 0.15
    return Body(
        "spring-mass-damper",
        '<site name="post" pos="0.5 -0.3 -0.3"/><body pos="0.5 0.4 0.1"><joint type="slide" axis="0 0.7 0.4"/><site name="bob"/>'
        f'<inertial pos="0 0 0" mass="{TENDON_KG}" diaginertia="0.01 0.01 0.01"/></body>',
        speeds=(0.0,),
        tendon=f'<spatial stiffness="{stiff}" damping="{damp}"><site site="post"/><site site="bob"/></spatial>',
    )


BODIES = {
    "nothing": Body("none"),
    "wheel": Body(
        "internal-rotor",
        '<body pos="0.2 -0.1 0.15"><joint name="axle" type="hinge" axis="0.5 0.3 0.8"/>'
        f'<inertial pos="0 0 0" mass="2" diaginertia="{WHEEL_MOMENT} {WHEEL_MOMENT} {WHEEL_MOMENT}"/></body>',
        '<velocity joint="axle" kv="0.5"/>',
        (WHEEL_SPEED,),
        lambda mujoco, model, data, t: data.ctrl.fill(WHEEL_SPEED),
    ),
    "sphere": Body(
        "energy-dissipation",
        f'<body pos="0.1 0.1 -0.2"><joint type="ball" damping="{SPHERE_DAMPING}"/>'
        f'<inertial pos="0 0 0" mass="5" diaginertia="{SPHERE_MOMENT} {SPHERE_MOMENT} {SPHERE_MOMENT}"/></body>',
    ),
    "knock": Body("impulse", push=_knock),
    "boom": Body("inertia-change", *_sliding("0.5 0.2 0.1", "0.9 0.36 0.18"), push=_deploy),
    "side boom": Body("inertia-change", *_sliding("0.5 0.4 0.1", "0 -0.3 1"), push=_deploy),
    "contact": _struck(),
    "tendon": _on_a_tendon(),
}
"""By name. The rail of `boom` passes through the main part's centre; that of `side boom` does not, so that the body
turns a little the other way while the mass travels."""


@cache
def moved(body: Body, seed: int) -> Motion:
    """MuJoCo's motion of a body, its first attitude and spin drawn from the seed."""
    import mujoco

    rng = np.random.default_rng([seed, 21])
    q, spin = rng.standard_normal(4), rng.standard_normal(3) + [0.3, 0.9, 0.3]
    moments = " ".join(str(v) for v in MOMENTS)
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option gravity="0 0 0" integrator="RK4" timestep="{1 / RATE_HZ / SUBSTEPS}" density="0" viscosity="0"/>
      <worldbody><body name="main" pos="0.3 -0.2 {DISTANCE_M}"><freejoint/>
        <inertial pos="0 0 0" mass="{MASS}" diaginertia="{moments}" quat="0.9 0.3 -0.2 0.25"/>
        {body.inside}
      </body>{body.beside}</worldbody><tendon>{body.tendon}</tendon>
      <actuator>{body.actuator}</actuator></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[3:7] = q / np.linalg.norm(q)
    data.qvel[3:6] = spin / np.linalg.norm(spin) * np.radians(TURN_DEG) * RATE_HZ
    data.qvel[6 : 6 + len(body.speeds)] = body.speeds
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    data.qvel[:3] += [0.001, -0.0015, 0.001] - data.subtree_linvel[1]
    for _ in range(round(body.run_in / model.opt.timestep)):
        mujoco.mj_step(model, data)
    data.time = 0.0
    rows, touching = [], [-np.inf]
    for _ in range(FRAMES):
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        mujoco.mj_energyVel(model, data)
        R = data.xmat[1].reshape(3, 3).copy()
        centre, momentum = data.subtree_com[1].copy(), data.subtree_angmom[1].copy()
        moment = float(data.crb[1][:3].mean())
        rows.append((data.time, R, data.xpos[1].copy(), centre, momentum, float(data.energy[1]), moment))
        for _ in range(SUBSTEPS):
            body.push(mujoco, model, data, data.time)
            mujoco.mj_step(model, data)
            touching += [data.time] if data.ncon else []
    strikes = int(np.sum(np.diff(touching) > 2.0 * model.opt.timestep))
    return Motion(*(np.array(column) for column in zip(*rows, strict=True)), strikes=strikes)


def cameras() -> dict[int, Camera]:
    """Two cameras side by side, as `massprops.simulation.tracks` has them."""
    intrinsics = np.array([FOCAL_PX, FOCAL_PX, SIZE[0] / 2, SIZE[1] / 2])
    beside = np.eye(4)
    beside[0, 3] = BASELINE_M
    return {
        0: Camera(SIZE, intrinsics, sigma_px=SIGMA_PX, rate_hz=RATE_HZ),
        1: Camera(SIZE, intrinsics, T_BS=beside, sigma_px=SIGMA_PX, rate_hz=RATE_HZ),
    }


def features(seed: int) -> np.ndarray:
    """(FEATURES, 3) points of the main part, its axes [m]."""
    rng = np.random.default_rng([seed, 22])
    points = rng.standard_normal((FEATURES, 3))
    size = 0.5 * SPAN_M * rng.uniform(0.6, 1.0, (FEATURES, 1))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * size


def seen(motion: Motion, seed: int) -> Sequence:
    """Tracks with noise of the points that face the cameras, and noisy ranges: nothing else, and no truth."""
    rng = np.random.default_rng([seed, 23])
    stamp = np.round(motion.times * 1e9).astype(np.int64)
    points = features(seed)
    outward = np.einsum("nij,mj->nmi", motion.R, points)
    X = outward + motion.origin[:, None]
    sight = X / np.linalg.norm(X, axis=2, keepdims=True)
    facing = np.sum(outward * sight, axis=2) < 0.15 * np.linalg.norm(points, axis=1)
    columns: list[tuple[np.ndarray, ...]] = []
    for camera, across in ((0, 0.0), (1, BASELINE_M)):
        uv = FOCAL_PX * (X[..., :2] - [across, 0.0]) / X[..., 2:] + np.array(SIZE) / 2
        inside = ((uv >= 0) & (uv < SIZE)).all(axis=2)
        frame, feature = np.nonzero(facing & inside)
        noisy = uv[frame, feature] + SIGMA_PX * rng.standard_normal((len(frame), 2))
        columns.append((stamp[frame], np.full(len(frame), camera), feature, noisy))
    stacked = [np.concatenate(c) for c in zip(*columns, strict=True)]
    order = np.lexsort((stacked[2], stacked[1], stacked[0]))
    distance = np.linalg.norm(motion.centre, axis=1) + SIGMA_RANGE_M * rng.standard_normal(len(stamp))
    return Sequence(cameras(), Tracks(*(c[order] for c in stacked)), RangeSeries(stamp, distance, SIGMA_RANGE_M))


def recorded(name: str, seed: int = 1) -> tuple[Sequence, Motion]:
    """What is seen of one of `BODIES`, and how MuJoCo moved it."""
    motion = moved(BODIES[name], seed)
    return seen(motion, seed), motion
