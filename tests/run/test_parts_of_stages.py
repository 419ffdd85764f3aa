"""What a stage had finished when it was killed is not made again: features of an image, silhouettes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from test_masks import run_of

from massprops.core.parts import Parts
from massprops.run import drawn_silhouettes
from massprops.run.job import Job
from massprops.run.stages import silhouettes
from massprops.sfm import features
from massprops.sfm.footage import CameraRecord, FootageRecord, FrameRecord
from massprops.views import Views


class Killed(BaseException):
    """Stands for the end of the process."""


def counting(function: Callable[..., Any], calls: list[int], most: int) -> Callable[..., Any]:
    """The function, which dies when it is called more than `most` times."""

    def counted(*given: Any, **named: Any) -> Any:
        if len(calls) == most:
            raise Killed
        calls.append(1)
        return function(*given, **named)

    return counted


def finished(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def placed(tmp_path: Path) -> tuple[Path, int]:
    """A run that stands before its silhouettes, with the first shape of one placement; images in it."""
    _, run = run_of(tmp_path)
    names = Views.load(run / "work" / "sfm" / "views.npz").names
    body = trimesh.creation.icosphere(2, 0.6)
    rng = np.random.default_rng(1)
    np.savez(run / "work" / "sfm" / "points.npz", xyz=body.vertices, obs_point=np.arange(len(body.vertices)))
    shape = run / "work" / "shape"
    folder = shape / "placement0"
    folder.mkdir(parents=True)
    (shape / "shape.json").write_text(json.dumps({"placements": [{"images": names, "method": "measured"}], "lost": []}))
    np.savez(folder / "shape.npz", vertices=body.vertices, faces=body.faces)
    for name, colour, xyz in (("object", "colour", body.vertices), ("other", "other_colour", body.vertices * 2)):
        np.savez(folder / f"{name}.npz", xyz=xyz)
        np.save(folder / f"{colour}.npy", rng.integers(0, 255, xyz.shape, dtype=np.uint8))
    return run, len(names)


def test_silhouettes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, count = placed(tmp_path)
    refine = drawn_silhouettes.refine
    results = []
    for out, place, most in (("whole", None, 99), ("killed", "parts", 3), ("again", "parts", 99)):
        calls: list[int] = []
        monkeypatch.setattr(drawn_silhouettes, "refine", counting(refine, calls, most))
        job = Job(run=run, options=Any, out=tmp_path / out, parts=Parts(place and tmp_path / place))  # type: ignore[arg-type]
        (tmp_path / out).mkdir()
        try:
            silhouettes.run(job)
            results.append(finished(tmp_path / out))
        except Killed:
            assert out == "killed"
        assert len(calls) == {"whole": count, "killed": 3, "again": count - 3}[out]
    assert results[0] == results[1]


def test_features(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = tuple(FrameRecord(f"cam0/{i}.png", 0, i, i) for i in range(4))
    footage = FootageRecord(tmp_path, "", "images", "static", "other", False, (CameraRecord(0, (160, 120)),), frames)
    rng = np.random.default_rng(0)
    for frame in frames:
        footage.image(frame.name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(footage.image(frame.name)), rng.integers(0, 255, (120, 160), dtype=np.uint8))
    extract, results = features.extract, []
    for place, most, made in ((None, 99, 4), ("parts", 2, 2), ("parts", 99, 2)):
        calls: list[int] = []
        monkeypatch.setattr(features, "extract", counting(extract, calls, most))
        parts = Parts(place and tmp_path / place)
        try:
            results.append(features.extract_all(footage, features.FeatureOptions(), False, 1, parts=parts)[0])
        except Killed:
            assert most == 2
        assert len(calls) == made
    assert list(results[0]) == list(results[1]) and all(len(k) > 30 for k, _ in results[0].values())
    assert all(np.array_equal(a, b) for n in results[0] for a, b in zip(results[0][n], results[1][n], strict=True))
