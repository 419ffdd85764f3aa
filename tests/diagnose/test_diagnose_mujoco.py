"""Effects made by another engine's physics: diagnosis is not only tested against the equations it fits with."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from diagnose.mujoco_bodies import (
    BODIES,
    DEPLOY_S,
    DEPLOYED_KG,
    DEPLOYED_M,
    KNOCK_N,
    KNOCK_S,
    KNOCK_STEPS,
    MASS,
    RATE_HZ,
    SPHERE_DAMPING,
    SPHERE_MOMENT,
    SUBSTEPS,
    WHEEL_MOMENT,
    WHEEL_SPEED,
    Motion,
    moved,
    recorded,
)

from massprops.diagnosis.search.diagnose import diagnose_problem
from massprops.model.problem import problem_of

pytest.importorskip("mujoco", reason="test extra 'consumers' is not installed")

HIDDEN = [name for name in BODIES if name not in ("nothing", "contact", "tendon")]
"""What is looked for in tracks; the others are diagnosed from attitudes (`bench/test_bench_worlds.py`)."""
ALONE = ("wheel", "sphere", "boom", "side boom", "tendon")
"""No force from outside acts on these."""


@cache
def diagnosed(name: str, seed: int = 1) -> tuple[dict, Motion]:
    """`diagnosis.json` of what is seen of a body, and its motion, which the diagnosis is not given."""
    sequence, motion = recorded(name, seed)
    assert sequence.body is None and sequence.attitude is None and sequence.rates is None
    return diagnose_problem(problem_of(sequence)).document, motion


def found(document: dict) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters and their 1-sigma of the one effect named."""
    (effect,) = document["effects"]
    return effect["parameters"], effect["sigma"]


def off(document: dict, name: str, truth: float) -> float:
    """A parameter's error in sigmas."""
    values, sigma = found(document)
    return abs(values[name] - truth) / sigma[name]


def check(document: dict, effect: str) -> None:
    gap = document["gap"]
    line = f"{document['verdict']}: {[e['name'] for e in document['effects']]} {gap}"
    print(f"{effect}: {line}")
    assert gap["fitted"]["before"] > 1.15, line
    assert document["verdict"] == "named" and [e["name"] for e in document["effects"]] == [effect], line
    assert gap["held_out"]["after"] <= 1.1, line


@pytest.mark.parametrize("name", ALONE)
def test_what_moves_inside_keeps_the_momentum(name: str) -> None:
    motion, rigid = moved(BODIES[name], 1), moved(BODIES["nothing"], 1)
    size = np.linalg.norm(motion.momentum[0])
    assert np.abs(motion.momentum - motion.momentum[0]).max() < 1e-6 * size
    path = motion.centre - motion.centre[0]
    assert np.abs(path - path[-1] * (motion.times / motion.times[-1])[:, None]).max() < 2e-5, "0.002 px"
    assert np.abs(motion.R - rigid.R).max() > 0.02, "nothing of it shows"


def test_the_knock_is_the_force_over_its_time() -> None:
    motion = moved(BODIES["knock"], 1)
    v = np.diff(motion.centre, axis=0) * RATE_HZ
    pulse = np.array(KNOCK_N) * KNOCK_STEPS / (RATE_HZ * SUBSTEPS)
    assert np.allclose(v[-1] - v[0], pulse / MASS, rtol=1e-6)
    kick = np.linalg.norm(motion.momentum[-1] - motion.momentum[0])
    assert 0 < kick < np.linalg.norm(pulse) * 1.0
    after = motion.momentum[motion.times > KNOCK_S + 0.1]
    assert np.abs(after - after[0]).max() < 1e-6 * np.linalg.norm(after[0])


def test_a_rigid_body_lacks_nothing() -> None:
    document, _ = diagnosed("nothing")
    assert document["verdict"] == "none" and not document["effects"]


def test_a_spinning_wheel_is_named() -> None:
    document, motion = diagnosed("wheel")
    check(document, "internal-rotor")
    values, _ = found(document)
    size = np.linalg.norm([values[f"momentum_{a}"] for a in "xyz"])
    assert size == pytest.approx(WHEEL_MOMENT * WHEEL_SPEED / motion.moment[0], rel=0.1)


def test_a_damped_sphere_is_named() -> None:
    document, motion = diagnosed("sphere")
    check(document, "energy-dissipation")
    assert motion.energy[-1] < 0.99 * motion.energy[0]
    assert off(document, "share", SPHERE_MOMENT / (motion.moment[0] - SPHERE_MOMENT)) < 3
    assert off(document, "coupling", SPHERE_DAMPING / SPHERE_MOMENT) < 3


def test_a_knock_is_named() -> None:
    document, _ = diagnosed("knock")
    check(document, "impulse")
    seconds = KNOCK_STEPS / (RATE_HZ * SUBSTEPS)
    assert off(document, "time", KNOCK_S + 0.5 * seconds) < 3
    for axis, force in zip("xyz", KNOCK_N, strict=True):
        assert off(document, f"velocity_{axis}", force * seconds / MASS) < 3


@pytest.mark.parametrize("name", ["boom", "side boom"])
def test_a_deployed_mass_is_named(name: str) -> None:
    document, _ = diagnosed(name)
    check(document, "inertia-change")
    values, sigma = found(document)
    assert abs(values["time"] - DEPLOY_S) < max(3 * sigma["time"], 1 / RATE_HZ)
    centre = np.linalg.norm([values[f"centre_{a}"] or 0.0 for a in "xyz"])
    assert centre == pytest.approx(DEPLOYED_KG * DEPLOYED_M / (MASS + DEPLOYED_KG), rel=0.05)
    swing = np.linalg.norm([values[f"swing_{a}"] or 0.0 for a in "xyz"])
    assert (swing > 0.01) == (name == "side boom"), "the body answers a mass that travels beside its centre"


@pytest.mark.bench
def test_other_spins_and_features() -> None:
    """Every body with four other spins: named right in 95 %, the gap closed in 95 % of those."""
    named, closed = [], []
    for name in HIDDEN:
        for seed in range(2, 6):
            document, _ = diagnosed(name, seed)
            right = [e["name"] for e in document["effects"]] == [BODIES[name].effect]
            before, after = document["gap"]["fitted"]["before"], document["gap"]["held_out"]["after"]
            print(f"{name} {seed}: {document['verdict']}, {before:.2f} fitted before, {after:.3f} held out after")
            named.append(right and document["verdict"] == "named")
            closed.append(after <= 1.1)
    assert np.mean(named) >= 0.95
    assert np.mean(np.array(closed)[named]) >= 0.95
