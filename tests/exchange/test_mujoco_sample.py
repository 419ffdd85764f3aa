"""`samples/mujoco_tumble.py`, all of it but the reconstruction: the simulated body tumbles as the footage does."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
import trimesh
from estimators.made_sequence import AXES, TRUE_K, make_sequence, simple_method

import massprops
from massprops.estimators import methods as registry
from massprops.mass.document import document
from massprops.mass.properties import mass_properties
from massprops.run.reconstruct import Run

SAMPLE = Path(__file__).resolve().parents[2] / "samples" / "mujoco_tumble.py"


def test_simulation_follows_the_footage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    pytest.importorskip("mujoco", reason="test extra 'consumers' is not installed")
    assert len(SAMPLE.read_text().splitlines()) < 30
    run = tmp_path / "runs" / "demo"
    make_sequence(run / "sequence", stereo=False, attitude=True)
    a, b, c = np.exp([TRUE_K.sum(), TRUE_K[1], 0.0])
    mesh = trimesh.creation.box(extents=np.sqrt(6 * np.array([b + c - a, a + c - b, a + b - c])))
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = AXES * [1, 1, np.linalg.det(AXES)], [0.3, -0.2, 0.5]
    mesh.apply_transform(turned)
    mesh.export(run / "mesh.ply")
    scale = {"source": "given", "metres_per_unit": 1.0, "relative_sigma": 0.0}
    (run / "massprops.json").write_text(json.dumps(document(mass_properties(mesh), {}, scale, {}, [])))
    monkeypatch.setattr(registry, "methods", lambda: {"simple": simple_method()})
    monkeypatch.setattr("massprops.run.reconstruct.reconstruct", lambda *a, **k: Run(run))
    monkeypatch.setattr("sys.argv", ["mujoco_tumble.py"])
    monkeypatch.chdir(tmp_path)
    assert massprops.reconstruct is not None
    runpy.run_path(str(SAMPLE))
    lines = capsys.readouterr().out.splitlines()
    off = [float(re.findall(r"([\d.]+) deg", line)[0]) for line in lines]
    assert len(off) == 120 and max(off) < 5.0  # 12 s, 640 deg: what the start's rate and the attitudes' noise allow
