"""Sequences with a hidden effect: the sequence goes to one folder, the answer to another that no diagnosis is given."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from diagnose.half_turns import off

from massprops.effects import Parameter, effects
from massprops.errors import NotPossible
from massprops.sequence import write_sequence
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

SINGLES = tuple(
    n for n, e in effects().items() if n not in ("range-bias", "baseline-error") and getattr(e, "SEARCHED", True)
)
"""Effects that show in the tracks whatever else is measured."""


def outside_torque(rng: np.random.Generator, speed: float, span: float) -> SimpleNamespace:
    """A torque that is not in the catalogue: periodic in inertial or body axes, with a period of its own."""
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    period = span * rng.uniform(0.15, 0.35)
    phase = rng.uniform(0, 6.28)
    size = speed / span

    def torque(t, q, w, p, inertia, environment):
        s = p[0] * np.sin(2 * np.pi * t / period + phase)
        return s * axis[0], s * axis[1], s * axis[2]

    return SimpleNamespace(
        NAME="outside",
        SENTENCE="a periodic torque",
        PARAMETERS=(Parameter("size", "rad s^-2", 1.0),),
        NEEDS=(),
        torque=torque,
        SIMULATED=[size * rng.uniform(0.1, 0.3)],
    )


def stranger(seed: int, scenario: TrackScenario) -> tuple[SimpleNamespace, ...]:
    """A torque outside the catalogue that moves the tracks by 2.5 to 20 px rms."""
    rng = np.random.default_rng([seed, 78])
    speed = np.radians(scenario.rate_deg) * scenario.rate_hz
    effect = outside_torque(rng, speed, scenario.frames / scenario.rate_hz)
    pixels = np.exp(rng.uniform(np.log(2.5), np.log(20.0)))
    for _ in range(4):
        moved = simulate_tracks(scenario, (effect,)).pixels["rms"]
        effect.SIMULATED[0] *= pixels / moved
    return (effect,)


def draw(seed: int, frames: int = 480, kind: str | None = None) -> tuple[TrackScenario, tuple[str, ...], str]:
    """A scenario, the names of its effects, and its kind: none, one, two or outside."""
    rng = np.random.default_rng([seed, 77])
    kind = kind or str(rng.choice(["none", "one", "one", "one", "one", "two", "outside"]))
    count = {"none": 0, "one": 1, "two": 2, "outside": 0}[kind]
    names = tuple(str(n) for n in rng.choice(SINGLES, count, replace=False))
    pixels = np.exp(rng.uniform(np.log(2.5), np.log(20.0), count))
    scenario = TrackScenario(
        frames=frames,
        features=int(rng.integers(10, 21)),
        outliers=0.005 if rng.random() < 0.5 else 0.0,
        rate_deg=float(rng.uniform(2.0, 4.0)) * 480 / max(frames, 240),
        range_sigma_m=0.02 if rng.random() < 0.7 else 0.0,
        assumed_sigma=float(rng.choice([0.002, 0.005])),
        effects=tuple(f"{n}:{p:.3f}" for n, p in zip(names, pixels, strict=True)),
        seed=seed,
    )
    if {"rolling-shutter", "stereo-time-offset", "lens-distortion"} & set(names):
        # a late picture or a bent one shows where the body fills the picture
        scenario = replace(scenario, distance_m=3.4, baseline_m=0.4)
    if "gravity-gradient-torque" in names:
        # the pull of the planet is what it is: the record is as slow as shows it
        natural = tuple(e for e in scenario.effects if not e.startswith("gravity"))
        scenario = replace(
            scenario, rate_hz=natural_rate(scenario), effects=("gravity-gradient-torque:strength=1", *natural)
        )
    return scenario, names, kind


def natural_rate(scenario: TrackScenario) -> float:
    """The frame rate at which the gravity gradient of strength 1 is about as large as was asked for."""
    strength = simulate_tracks(scenario).truth["effects"]["gravity-gradient-torque"]["strength"]
    return float(scenario.rate_hz / np.sqrt(strength))


def hide(seed: int, sequence: Path, answer: Path, frames: int = 480, kind: str | None = None) -> None:
    """Writes a sequence without its truth, and the answer elsewhere."""
    scenario, names, kind = draw(seed, frames, kind)
    outside = stranger(seed, scenario) if kind == "outside" else ()
    try:
        made = simulate_tracks(scenario, outside)
        last = float(made.sequence.tracks.timestamp_ns.max() - made.truth["timestamp_ns"][0]) / 1e9
        plausible = all(_plausible(n, p, last) for n, p in made.truth["effects"].items() if n in names)
    except NotPossible:
        plausible = False
    if not plausible:
        hide(seed + 100_000, sequence, answer, frames, kind)
        return
    write_sequence(sequence, made.sequence)
    answer.mkdir(parents=True, exist_ok=True)
    content = {"kind": kind, "names": names, "parameters": made.truth["effects"], "pixels": made.pixels["rms"]}
    content["inertia"] = made.truth["inertia"]
    (answer / "answer.json").write_text(json.dumps(content))


def _plausible(name: str, parameters: dict, last: float) -> bool:
    """Whether an effect of that size is one that the catalogue holds for possible, and acts before the body is last seen,
    at `last` [s]."""
    return parameters.get("time", 0.0) < last and all(
        (q.limit is None or abs(parameters[q.name]) < q.limit) and (q.least is None or parameters[q.name] > q.least)
        for q in effects()[name].PARAMETERS
    )


def judge(document: dict, answer: dict) -> dict:
    """How a diagnosis did: right, listed, parameters within 3 sigma, gap after."""
    found = [e["name"] for e in document["effects"]]
    verdict, names = document["verdict"], list(answer["names"])
    right = {
        "none": verdict == "none",
        "one": verdict == "named" and found == names,
        "two": verdict == "named" and sorted(found) == sorted(names),
        "outside": verdict in ("unexplained", "ambiguous"),
    }[answer["kind"]]
    listed = right or (bool(names) and (found[:1] == names or verdict == "ambiguous" and set(names) <= set(found)))
    z = []
    if right and names:
        z = [abs(v) for _, v in off(document["effects"], answer["parameters"], np.array(answer["inertia"]))]
    gap = document["gap"]
    return {
        "kind": answer["kind"],
        "truth": " + ".join(names) or answer["kind"],
        "said": verdict if verdict in ("none", "unexplained") else " + ".join(found),
        "verdict": verdict,
        "right": right,
        "listed": bool(listed),
        "worst_z": max(z) if z else None,
        "before": gap["fitted"]["before"],
        "after": gap["held_out"]["after"],
    }
