"""Free bodies with something hidden, moved by Basilisk's physics, and a record of their attitudes with noise.

No equation of `massprops.dynamics` has a part in the motion. Inertial axes are Basilisk's; the chaser's axes are theirs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import from_rotation_vector, multiply, normalise, rotation_matrix
from massprops.sequence.data import AttitudeSeries, Environment, Orbit, Sequence

STEP_S = 0.5
MU, RADIUS = 3.986004415e14, 6.9e6
AU = 149597870700.0
SUN = np.array([0.48, -0.6, 0.64])
SIGMA = np.radians(0.05)
PLANET_M = 6371.2e3
FIELD_T = 3.12e-5
"""Of the Earth's dipole, at the magnetic equator of its surface."""
DIPOLE_T_M3 = FIELD_T * PLANET_M**3 * np.array([0.8, -0.36, 0.48])
"""As strong as the Earth's and not across the orbit, so that the field turns along it."""


def _nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)


def moved(kind: str, seed: int, seconds: float = 900.0, period: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and attitudes (n, 4), body to inertial, of a body with some of `KINDS`, `SWINGING`, `WHEELS` or `STRANGERS`, joined by +, acting."""
    from Basilisk.simulation import spacecraft
    from Basilisk.utilities import SimulationBaseClass

    rng = np.random.default_rng([seed, 77])
    world = SimulationBaseClass.SimBaseClass()
    process = world.CreateNewProcess("p")
    process.addTask(world.CreateNewTask("t", _nanoseconds(STEP_S)))
    hub = spacecraft.Spacecraft()
    hub.ModelTag = "body"
    x = rng.standard_normal((3, 3))
    turn = np.linalg.qr(x)[0]
    second = rng.uniform(4.0, 16.0, 3)
    inertia = turn @ np.diag(second.sum() - second) @ turn.T
    hub.hub.mHub = 80.0
    hub.hub.IHubPntBc_B = inertia.tolist()
    sigma = rng.uniform(-0.4, 0.4, 3)
    w = rng.standard_normal(3)
    w *= np.radians(rng.uniform(1.0, 3.0)) / np.linalg.norm(w)
    hub.hub.r_CN_NInit = [[RADIUS], [0.0], [0.0]]
    hub.hub.v_CN_NInit = [[0.0], [np.sqrt(MU / RADIUS)], [0.0]]
    hub.hub.sigma_BNInit = [[v] for v in sigma]
    hub.hub.omega_BN_BInit = [[v] for v in w]
    world.AddModelToTask("t", hub)
    kept = [{**KINDS, **STRANGERS, **SWINGING, **WHEELS}[k](world, hub, rng, inertia, w) for k in kind.split("+")]
    recorder = hub.scStateOutMsg.recorder(_nanoseconds(period))
    world.AddModelToTask("t", recorder)
    world.InitializeSimulation()
    for until, act in sorted((act for k in kept for act in k.get("acts", [])), key=lambda a: a[0]):
        world.ConfigureStopTime(_nanoseconds(until))
        world.ExecuteSimulation()
        act()
    world.ConfigureStopTime(_nanoseconds(seconds))
    world.ExecuteSimulation()
    return np.array(recorder.times()) * 1e-9, _quaternions(np.array(recorder.sigma_BN))


def _quaternions(sigma: np.ndarray) -> np.ndarray:
    """(n, 4) body to inertial of modified Rodrigues parameters (n, 3) of the body against inertial axes."""
    square = np.sum(sigma**2, axis=1, keepdims=True)
    return normalise(np.concatenate([(1 - square) / (1 + square), 2 * sigma / (1 + square)], axis=1))


def _nothing(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    return {}


def _planet(world: Any, hub: Any) -> Any:
    from Basilisk.utilities import simIncludeGravBody

    factory = simIncludeGravBody.gravBodyFactory()
    earth = factory.createEarth()
    earth.isCentralBody = True
    factory.addBodiesTo(hub)
    return factory


def _gravity(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    from Basilisk.simulation import GravityGradientEffector

    factory = _planet(world, hub)
    effector = GravityGradientEffector.GravityGradientEffector()
    effector.addPlanetName("earth_planet_data")
    hub.addDynamicEffector(effector)
    world.AddModelToTask("t", effector)
    return {"kept": (factory, effector)}


def _magnet(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    """A torque bar that is stuck, along anything, in a field that changes along the orbit."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import MtbEffector, magneticFieldCenteredDipole

    factory = _planet(world, hub)
    field = magneticFieldCenteredDipole.MagneticFieldCenteredDipole()
    field.planetRadius = PLANET_M
    field.g11, field.h11, field.g10 = (float(v) for v in DIPOLE_T_M3 / PLANET_M**3)
    field.addSpacecraftToModel(hub.scStateOutMsg)
    world.AddModelToTask("t", field)
    way = _direction(rng)
    size = 1.6e-4 * float(np.linalg.norm(inertia @ w)) / FIELD_T
    bars = messaging.MTBArrayConfigMsgPayload()
    bars.numMTB, bars.GtMatrix_B, bars.maxMtbDipoles = 1, way.tolist(), [1e6]
    command = messaging.MTBCmdMsgPayload()
    command.mtbDipoleCmds = [size]
    messages = messaging.MTBArrayConfigMsg().write(bars), messaging.MTBCmdMsg().write(command)
    effector = MtbEffector.MtbEffector()
    effector.mtbParamsInMsg.subscribeTo(messages[0])
    effector.mtbCmdInMsg.subscribeTo(messages[1])
    effector.magInMsg.subscribeTo(field.envOutMsgs[0])
    hub.addDynamicEffector(effector)
    world.AddModelToTask("t", effector)
    return {"kept": (factory, field, effector, messages), "dipole": size * way}


def _sunlight(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    """A box with a wing: absorption, specular and diffuse reflection on every lit face."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import facetSRPDynamicEffector

    effector = facetSRPDynamicEffector.FacetSRPDynamicEffector()
    shift = rng.uniform(-0.25, 0.25, 3)
    faces = [
        (s * np.eye(3)[k], 1.5, 0.2 + 0.3 * rng.random(), 0.3, s * 0.6 * np.eye(3)[k])
        for k in range(3)
        for s in (1, -1)
    ]
    wing = np.array([0.3, -0.2, 0.93])
    wing /= np.linalg.norm(wing)
    faces += [(s * wing, 6.0, 0.2, 0.1, np.array([0.2, 1.6, 0.1])) for s in (1, -1)]
    effector.setNumFacets(len(faces))
    for normal, area, specular, diffuse, place in faces:
        effector.addFacet(
            area, np.eye(3).tolist(), normal.tolist(), [0, 0, 1], (place + shift).tolist(), diffuse, specular
        )
    sun = messaging.SpicePlanetStateMsgPayload()
    sun.PositionVector = (AU * SUN / np.linalg.norm(SUN)).tolist()
    message = messaging.SpicePlanetStateMsg().write(sun)
    effector.sunInMsg.subscribeTo(message)
    hub.addDynamicEffector(effector)
    world.AddModelToTask("t", effector)
    return {"kept": (effector, message)}


def _pushed(hub: Any, world: Any, torque: np.ndarray) -> Any:
    from Basilisk.simulation import extForceTorque

    effector = extForceTorque.ExtForceTorque()
    effector.extTorquePntB_B = [[v] for v in torque]
    hub.addDynamicEffector(effector)
    world.AddModelToTask("t", effector)
    return effector


def _leak(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    way = rng.standard_normal(3)
    return {"kept": _pushed(hub, world, 8e-5 * way / np.linalg.norm(way) * np.linalg.norm(inertia @ w) / 0.5)}


def _firing(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    effector = _pushed(hub, world, np.zeros(3))
    way = rng.standard_normal(3)
    torque = 0.15 * np.linalg.norm(inertia @ w) / FIRING_S * way / np.linalg.norm(way)
    begins = 2.0 * round(rng.uniform(150.0, 350.0))

    def set_to(value: np.ndarray) -> Callable[[], None]:
        def act() -> None:
            effector.extTorquePntB_B = [[v] for v in value]

        return act

    return {"kept": effector, "acts": [(begins, set_to(torque)), (begins + FIRING_S, set_to(np.zeros(3)))]}


FIRING_S = 15.0


def _wheel(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    """A reaction wheel at a speed of its own, which a motor changes evenly for a third of the record."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import reactionWheelStateEffector
    from Basilisk.utilities import simIncludeRW

    factory = simIncludeRW.rwFactory()
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    size = 0.15 * np.linalg.norm(inertia @ w)
    speed = 100.0
    factory.create("custom", axis.tolist(), Omega=speed * 60 / (2 * np.pi), Js=size / speed, Jt=0.5 * size / speed, Jg=0.5 * size / speed,
                   Omega_max=1e5, u_max=1.0, useRWfriction=False)  # fmt: skip
    effector = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory.addToSpacecraft("wheels", effector, hub)
    command = messaging.ArrayMotorTorqueMsgPayload()
    command.motorTorque = [0.0] * 36
    message = messaging.ArrayMotorTorqueMsg().write(command)
    effector.rwMotorCmdInMsg.subscribeTo(message)
    world.AddModelToTask("t", effector)

    def torque(value: float) -> Callable[[], None]:
        def act() -> None:
            new = messaging.ArrayMotorTorqueMsgPayload()
            new.motorTorque = [value] + [0.0] * 35
            message.write(new, world.TotalSim.CurrentNanos)

        return act

    return {"kept": (factory, effector, message), "acts": [(300.0, torque(1.5 * size / 300.0)), (600.0, torque(0.0))]}


def _coasting(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    """A reaction wheel out of balance that friction brings to rest, most of it in the first half of the record.

    It turns by a fraction of a radian in a step of the integrator, so that its imbalance is followed.
    """
    from Basilisk.architecture import messaging
    from Basilisk.simulation import reactionWheelStateEffector
    from Basilisk.utilities import simIncludeRW

    factory = simIncludeRW.rwFactory()
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    size = 0.3 * np.linalg.norm(inertia @ w)
    speed = 0.6
    spin = size / speed
    factory.create("custom", axis.tolist(), Omega=speed * 60 / (2 * np.pi), Js=spin, Jt=0.5 * spin, Jg=0.5 * spin, mass=2.0,
                   RWModel=messaging.JitterFullyCoupled, U_s=0.02, U_d=0.01 * spin, Omega_max=1e5, u_max=1.0,
                   rWB_B=(0.2 * rng.standard_normal(3)).tolist(), useRWfriction=True, betaStatic=-1.0,
                   fCoulomb=float(size / 2000.0), fStatic=0.0, cViscous=float(spin / 250.0))  # fmt: skip
    effector = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory.addToSpacecraft("wheels", effector, hub)
    world.AddModelToTask("t", effector)
    return {"kept": (factory, effector)}


def _steered(hub: Any, world: Any, torque: Callable[[float, np.ndarray], np.ndarray]) -> dict:
    """A torque of time and attitude (body to inertial), body axes, held for ACT_S at a time."""
    effector = _pushed(hub, world, np.zeros(3))

    def at(t: float) -> Callable[[], None]:
        def act() -> None:
            q = _quaternions(np.array(hub.scStateOutMsg.read().sigma_BN)[None])[0]
            effector.extTorquePntB_B = [[v] for v in torque(t, rotation_matrix(q))]

        return act

    return {"kept": effector, "acts": [(t, at(t)) for t in np.arange(ACT_S, 900.0, ACT_S)]}


ACT_S = 2.0


def _jet_in_sunlight(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    """Gas leaves a patch that the Sun has warmed."""
    way, patch = rng.standard_normal((2, 3))
    torque = 4e-4 * np.linalg.norm(inertia @ w) * way / np.linalg.norm(way)
    patch, sun = patch / np.linalg.norm(patch), SUN / np.linalg.norm(SUN)
    return _steered(hub, world, lambda t, R: torque * (patch @ (R.T @ sun) > 0.3))


def _unsteady(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    """A torque that wanders in the body: a sum of slow waves about each axis."""
    size = 2e-4 * np.linalg.norm(inertia @ w)
    rate, phase = rng.uniform(0.01, 0.05, (3, 4)), rng.uniform(0.0, 6.3, (3, 4))
    return _steered(hub, world, lambda t, R: size * np.sin(rate * t + phase).sum(axis=1))


def _direction(rng: np.random.Generator) -> np.ndarray:
    x = rng.standard_normal(3)
    return np.asarray(x / np.linalg.norm(x))


def _panel(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    """A thin panel on a hinge with a spring and a damper, bent a little at the start."""
    from Basilisk.simulation import hingedRigidBodyStateEffector

    panel = hingedRigidBodyStateEffector.HingedRigidBodyStateEffector()
    mass, half, across = rng.uniform(1.5, 3.0), rng.uniform(0.5, 0.8), rng.uniform(0.5, 1.0)
    frequency, ratio = np.linalg.norm(w) * rng.uniform(2.0, 6.0), rng.uniform(0.02, 0.2)
    panel.mass, panel.d = mass, half
    # thin: its second moment across its plane is nothing
    moments = mass / 3.0 * np.array([across**2, half**2, across**2 + half**2])
    panel.IPntS_S = np.diag(moments).tolist()
    about_hinge = moments[1] + mass * half**2
    panel.k, panel.c = about_hinge * frequency**2, 2.0 * ratio * about_hinge * frequency
    panel.r_HB_B = [[v] for v in 0.4 * _direction(rng)]
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    panel.dcm_HB = (turn * np.sign(np.linalg.det(turn))).tolist()
    panel.thetaInit = rng.uniform(-0.05, 0.05)
    hub.addStateEffector(panel)
    world.AddModelToTask("t", panel)
    return {"kept": panel}


def _slosh(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
    """Fuel that sloshes, as a mass on a line with a spring and a damper."""
    from Basilisk.simulation import linearSpringMassDamper

    fuel = linearSpringMassDamper.LinearSpringMassDamper()
    mass, frequency = rng.uniform(1.5, 4.0), np.linalg.norm(w) * rng.uniform(1.3, 4.0)
    fuel.massInit, fuel.k = mass, mass * frequency**2
    fuel.c = 2.0 * rng.uniform(0.02, 0.3) * mass * frequency
    fuel.r_PB_B = [[v] for v in rng.uniform(0.3, 0.8) * _direction(rng)]
    fuel.pHat_B = [[v] for v in _direction(rng)]
    fuel.rhoInit, fuel.rhoDotInit = rng.uniform(-0.02, 0.02), 0.0
    hub.addStateEffector(fuel)
    world.AddModelToTask("t", fuel)
    return {"kept": fuel}


SWINGING: dict[str, Callable[..., dict]] = {"panel": _panel, "slosh": _slosh}
"""What the catalogue calls spring-mass-damper."""
WHEELS: dict[str, Callable[..., dict]] = {"wheel-that-coasts": _coasting}
"""What the catalogue calls internal-rotor."""
STRANGERS: dict[str, Callable[..., dict]] = {"jet-in-sunlight": _jet_in_sunlight, "unsteady": _unsteady}
"""What no effect of the catalogue is."""
KINDS: dict[str, Callable[..., dict]] = {
    "none": _nothing, "gravity-gradient-torque": _gravity, "sunlight": _sunlight, "constant-body-torque": _leak,
    "impulse": _firing, "internal-rotor": _wheel, "magnetic-dipole-torque": _magnet,
}  # fmt: skip

PAIRS = (
    "constant-body-torque+internal-rotor", "constant-body-torque+impulse", "sunlight+constant-body-torque",
    "internal-rotor+impulse", "sunlight+internal-rotor", "sunlight+impulse",
)  # fmt: skip
"""Two at once. Gravity has no part: at these rates its gradient hardly shows by itself."""


def recorded(kind: str, seed: int, sigma: float = SIGMA, seconds: float = 900.0, period: float = 2.0) -> Sequence:
    """Attitudes with noise, and what a caller knows of the surroundings: never what acts."""
    times, q = moved(kind, seed, seconds, period)
    rng = np.random.default_rng([seed, 78])
    noisy = normalise(multiply(q, from_rotation_vector(sigma * rng.standard_normal((len(q), 3)))))
    # the orbit lies in the x-y plane, the body begins on +x
    orbit = Orbit(MU, RADIUS, 0.0, 0.0)
    # records from before there was a torque bar have a field that nothing asks for
    magnet = "magnetic" in kind
    around = Environment(
        orbit=orbit, sun_direction=SUN / np.linalg.norm(SUN),
        magnetic_field_T=None if magnet else np.array([2e-5, -1e-5, 3e-5]), magnetic_dipole_T_m3=DIPOLE_T_M3 if magnet else None,
    )  # fmt: skip
    series = AttitudeSeries(np.round(times * 1e9).astype(np.int64), noisy, np.full(len(times), sigma))
    return Sequence(attitude=series, environment=around)


def seen_by_cameras(kind: str, seed: int, seconds: float = 900.0, period: float = 3.0) -> Sequence:
    """What two cameras at rest see of the body: tracks and ranges with noise, and the Sun's direction."""
    from dataclasses import replace

    from diagnose.mujoco_bodies import DISTANCE_M, Motion, seen

    times, q = moved(kind, seed, seconds, period)
    at = np.tile([0.0, 0.0, DISTANCE_M], (len(times), 1))
    tracks = seen(Motion(times, rotation_matrix(q), at, at, 0.0 * at, 0.0 * times, 0.0 * times), seed)
    return replace(tracks, environment=Environment(sun_direction=SUN / np.linalg.norm(SUN)))
