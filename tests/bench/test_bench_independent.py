"""Diagnosis of bodies that textbook formulas move: what is named, over sensors, sizes and scenes that nobody tuned for."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnose.half_turns import off
from diagnose.independent import drawn, expected, own_axes, sized, true_inertia, write

RUNS = int(os.environ.get("MASSPROPS_INDEPENDENT_RUNS", "36"))
FIRST = int(os.environ.get("MASSPROPS_INDEPENDENT_FIRST", "100"))
MOTION = (
    "constant-body-torque", "viscous-damping", "eddy-current-torque", "solar-radiation-torque", "magnetic-dipole-torque",
    "energy-dissipation", "internal-rotor", "impulse", "inertia-change", "nonuniform-density",
)  # fmt: skip
SEEN = ("focal-length-error", "lens-distortion", "rolling-shutter", "chaser-rotation-drift")
BY_SENSORS = {
    "stereo": (*MOTION, *SEEN, "stereo-time-offset", "baseline-error", "none"),
    "range": (*MOTION, *SEEN, "range-bias", "none"),
    "rates": (*MOTION, "chaser-rotation-drift", "none"),
}


@pytest.mark.bench
def test_textbook_bodies(tmp_path: Path, capsys) -> None:
    from massprops_cli.main import run

    shown, listed, within = [], [], []
    for seed in range(FIRST, FIRST + RUNS):
        rng = np.random.default_rng([seed, 504])
        sensors = str(rng.choice(["stereo", "stereo", "range", "rates"]))
        name = str(rng.choice(BY_SENSORS[sensors]))
        pixels = float(np.exp(rng.uniform(np.log(2.5), np.log(20.0))))
        world = drawn(seed, sensors)
        world = world if name == "none" else sized(world, name, pixels)
        folder, out = tmp_path / f"{seed}" / "seq", tmp_path / f"{seed}" / "out"
        noise, surroundings, body = (bool(rng.random() < 0.8) for _ in range(3))
        # without a word about the orbit the path is straight: free fall would be an effect that the catalogue has not
        world = world if surroundings else replace(world, falls=False)
        write(world, folder, noise, surroundings, body)
        begun = os.times()
        status = run(["diagnose", str(folder), "-o", str(out), "-q"])
        cpu = sum(os.times()[:2]) - sum(begun[:2])
        path = out / "diagnosis.json"
        document = (
            json.loads(path.read_text())
            if path.is_file()
            else {"verdict": f"exit {status}", "effects": [], "gap": None}
        )
        said = [e["name"] for e in document["effects"]]
        needs_body = name == "nonuniform-density" and not (folder / "body.yaml").is_file()
        needs_field = (
            name.split("-")[0] in ("eddy", "solar", "magnetic") and not (folder / "environment.yaml").is_file()
        )
        gap = document["gap"] or {"fitted": {"before": np.nan, "after": np.nan}, "held_out": {"after": np.nan}}
        right = document["verdict"] == "none" if name == "none" else document["verdict"] == "named" and said == [name]
        model = yaml.safe_load((out / "model.yaml").read_text()) if path.is_file() else {}
        axes = own_axes(world, folder, model["attitude"]) if model else None
        z = max((abs(v) for _, v in off([e for e in document["effects"] if e["name"] == name],
                 {name: expected(world, name) if name != "none" else {}}, true_inertia(world), axes)), default=0.0)  # fmt: skip
        counts = (name == "none" or not gap["fitted"]["before"] < 1.15) and not needs_body and not needs_field
        if counts:
            shown.append(right)
            listed.append(right or name in said)
            if right and name != "none":
                within.append(z <= 3)
        with capsys.disabled():
            print(
                f"{seed} {sensors:<7}{name:<24}{pixels:5.1f} px  {document['verdict']:<12}{' + '.join(said)[:44]:<45}"
                f"{gap['fitted']['before']:7.2f} -> {gap['held_out']['after'] or np.nan:6.3f}  z {z:4.1f}  {cpu:5.1f} s"
                f"{'' if counts else '  (not counted)'}",
                flush=True,
            )
    with capsys.disabled():
        print(f"\nnamed right {100 * np.mean(shown):.0f} %, named or listed {100 * np.mean(listed):.0f} % of {len(shown)} "
              f"that show (residual above 1.15, what they need known); parameters within 3 sigma "
              f"{100 * np.mean(within):.0f} % of {len(within)}")  # fmt: skip
    assert np.mean(listed) > 0.5
