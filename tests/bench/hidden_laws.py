"""Free bodies in MuJoCo under a torque law drawn from a grammar; none of its laws is an effect of the catalogue.

The law is written here in numpy, MuJoCo moves the body, and what is recorded are its attitudes with noise. The grammar: one
or two terms, each a modulation times one or two body axes. Modulations: light on a face, its square, products of two
components of the Sun's direction, light times a rate, a torque that begins at a moment and lasts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from massprops.sequence.data import AttitudeSeries, Environment, Sequence

FRAMES, STEP_S, SIGMA = 300, 1.0, 1e-3
"""Attitudes [s], [rad]."""
SUBSTEP_S = 0.02
XYZ = "xyz"


@dataclass(frozen=True)
class Term:
    """label: as the library calls it, without its axis; `t >` stands for any moment. strength: of the modulation, of time,
    Sun and rate in body axes."""

    label: str
    strength: Callable[[float, np.ndarray, np.ndarray], float]
    axes: tuple[int, ...]
    sizes: tuple[float, ...]


@dataclass(frozen=True)
class HiddenLaw:
    """A record and what moved it."""

    sequence: Sequence
    terms: tuple[Term, ...]
    inertia: np.ndarray
    moments: tuple[float, ...]

    @property
    def labels(self) -> set[str]:
        """Terms with their axes."""
        return {f"{t.label} along {XYZ[a]}" for t in self.terms for a in t.axes}


def draw(seed: int) -> HiddenLaw:
    """The record of one seed."""
    rng = np.random.default_rng([seed, 7])
    moments = np.sort(rng.uniform(0.7, 1.3, 3))
    while moments[0] + moments[1] < 1.05 * moments[2] or np.diff(moments).min() < 0.08:
        moments = np.sort(rng.uniform(0.7, 1.3, 3))
    moments = 3.0 * moments / moments.sum()
    w = rng.normal(size=3)
    w *= np.radians(rng.uniform(3.0, 6.0)) / np.linalg.norm(w)
    sun = rng.normal(size=3)
    sun /= np.linalg.norm(sun)
    span = FRAMES * STEP_S
    speed, free = float(np.linalg.norm(w)), _moved(moments, w, sun, ())
    terms: tuple[Term, ...] = ()
    count = int(rng.integers(1, 3))
    while len(terms) < count:
        term = _term(rng, span, speed)
        if _acts(term, *free, sun) and term.label not in {t.label for t in terms}:
            terms = (*terms, term)
    times, q = _moved(moments, w, sun, terms)
    noisy = _noisy(q, rng)
    stamp = np.round(times * 1e9).astype(np.int64)
    series = AttitudeSeries(stamp, noisy, np.full(len(times), SIGMA))
    sequence = Sequence(attitude=series, environment=Environment(sun_direction=sun))
    return HiddenLaw(sequence, terms, np.diag(moments), tuple(t for t in (_moment(term) for term in terms) if t))


def _term(rng: np.random.Generator, span: float, speed: float) -> Term:
    i, j = (int(k) for k in rng.integers(0, 3, 2))
    sign = "" if rng.random() < 0.5 else "-"
    s = -1.0 if sign else 1.0
    at = float(rng.uniform(0.2, 0.8) * span)
    kinds: list[tuple[str, Callable[[float, np.ndarray, np.ndarray], float], float]] = [
        (f"max(0, {sign}s_{XYZ[i]})", lambda t, sun, w: max(0.0, s * sun[i]), 1.0),
        (f"max(0, {sign}s_{XYZ[i]})^2", lambda t, sun, w: max(0.0, s * sun[i]) ** 2, 1.0),
        (f"s_{XYZ[min(i, j)]} s_{XYZ[max(i, j)]}", lambda t, sun, w: sun[i] * sun[j], 1.0),
        (f"max(0, {sign}s_{XYZ[i]}) w_{XYZ[j]}", lambda t, sun, w: max(0.0, s * sun[i]) * w[j], 1.0 / speed),
        ("(t>", lambda t, sun, w: float(t > at), 1.0),
    ]
    label, strength, scale = kinds[int(rng.integers(0, len(kinds)))]
    axes = tuple(sorted(int(a) for a in rng.choice(3, int(rng.integers(1, 3)), replace=False)))
    sizes = tuple(float(scale * rng.choice([-1, 1]) * rng.uniform(4e-5, 1e-4)) for _ in axes)
    return Term(label, strength, axes, sizes)


def _acts(term: Term, times: np.ndarray, q: np.ndarray, sun: np.ndarray) -> bool:
    """Whether the modulation changes along the free motion: a face that never sees the Sun has no law to find."""
    from massprops.dynamics.quaternion import conjugate, multiply, rotate, rotation_vector

    rate = rotation_vector(multiply(conjugate(q[:-1]), q[1:])) / np.diff(times)[:, None]
    lit = rotate(conjugate(q[:-1]), sun)
    values = np.array([term.strength(t, s, w) for t, s, w in zip(times[:-1], lit, rate, strict=True)])
    return bool(values.std() > 0.2 * np.abs(values).max() > 0.0)


def _moment(term: Term) -> float:
    """When a term begins that begins at a moment; 0 for others."""
    zero = np.zeros(3)
    if term.label != "(t>":
        return 0.0
    times = np.arange(0.0, FRAMES * STEP_S, 0.1)
    return float(times[int(np.argmax([term.strength(t, zero, zero) for t in times]))])


def _moved(
    moments: np.ndarray, w: np.ndarray, sun: np.ndarray, terms: tuple[Term, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and attitudes (n, 4) of MuJoCo's body."""
    import mujoco

    text = " ".join(f"{m:.12g}" for m in moments)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0" timestep="{SUBSTEP_S}" integrator="RK4"/><worldbody><body><freejoint/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{text}"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[3:6] = w
    out = []
    for frame in range(FRAMES):
        out.append(data.qpos[3:7].copy())
        for _ in range(round(STEP_S / SUBSTEP_S)):
            R = np.zeros(9)
            mujoco.mju_quat2Mat(R, data.qpos[3:7])
            body_sun, rate = R.reshape(3, 3).T @ sun, data.qvel[3:6]
            torque = np.zeros(3)
            for term in terms:
                f = term.strength(data.time, body_sun, rate)
                for a, size in zip(term.axes, term.sizes, strict=True):
                    torque[a] += size * f
            # a free joint's angular velocity and torque are in body axes
            data.qfrc_applied[3:6] = torque
            mujoco.mj_step(model, data)
        del frame
    return STEP_S * np.arange(FRAMES), np.array(out)


def _noisy(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    from massprops.dynamics.quaternion import from_rotation_vector, multiply, normalise

    return normalise(multiply(q, from_rotation_vector(SIGMA * rng.normal(size=(len(q), 3)))))
