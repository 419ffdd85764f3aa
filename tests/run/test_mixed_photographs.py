"""Photographs as people have them, from files to cameras: odd names, images on their side, reduced copies."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from massprops.core.outputs import locked
from massprops.dynamics.quaternion import rotation_matrix
from massprops.run.reconstruct import checked_options
from massprops.run.runner import run_stages
from massprops.sequence.truth import read_truth
from massprops.sfm.points import SparsePoints, residuals
from massprops.simulation import simulate
from massprops.views import Views

SIDEWAYS, COPIES = {2: 6, 5: 8, 9: 3}, (3, 7, 11)
"""EXIF orientations by image, and the images that came as copies of three quarters of the size, without EXIF."""


def mixed(sequence: Path, folder: Path) -> Path:
    """The frames of a sequence as a phone and a messenger would leave them."""
    folder.mkdir()
    for i, file in enumerate(sorted((sequence / "cam0" / "data").glob("*.png"))):
        image = cv2.imread(str(file))[..., ::-1]
        exif = Image.Exif()
        if i in COPIES:
            image = cv2.resize(image, (240, 180), interpolation=cv2.INTER_AREA)
        else:
            exif[0x010F], exif[0x0110], exif[0x0112] = "Maker", "Phone", SIDEWAYS.get(i, 1)
        # the camera was held another way: what EXIF says turns the picture that was taken
        Image.fromarray(image).save(folder / f"Фото {i:02d} (a).png", exif=exif)
    (folder / "Фото broken.jpg").write_bytes(b"nothing")
    return folder


def test_mixed_photographs_become_cameras(tmp_path: Path) -> None:
    sequence = simulate("asteroid", tmp_path / "seq", frames=12, size=(320, 240), rate_deg=5.0, seed=111)
    run = tmp_path / "run"
    with locked(run):
        options = checked_options(mixed(sequence, tmp_path / "my photos"), {"threads": 1})
        outcome = run_stages(run, options, {"photos": "one"}, order=("capture", "sfm"))
    assert outcome.exit_code == 0, outcome.reason
    assert any(w.startswith("1 image was left out: Фото broken.jpg") for w in outcome.warnings)
    footage = json.loads((run / "work/capture/footage.json").read_text())
    sfm = json.loads((run / "work/sfm/sfm.json").read_text())
    assert footage["kind"] == "images" and sfm["registered"] == 12 and sfm["scale_metres_per_unit"] is None
    assert [(c["images"], c["given"]) for c in sfm["cameras"]] == [(9, 9), (3, 3)]
    first, copies = (c["focal_px"][0] for c in sfm["cameras"])
    assert copies / first == pytest.approx(0.75, rel=0.01)

    views = Views.load(run / "work/sfm/views.npz")
    number = {f["name"]: int(f["source_name"][5:7]) for f in footage["frames"]}
    place = np.array([number[n] for n in views.names])
    sizes = {
        i: (240, 320) if SIDEWAYS.get(i) in (6, 8) else (240, 180) if i in COPIES else (320, 240) for i in range(12)
    }
    assert [tuple(s) for s in views.size.tolist()] == [sizes[i] for i in place]
    points = SparsePoints.load(run / "work/sfm/points.npz")
    assert np.sqrt(np.mean(residuals(views, points) ** 2)) < 0.5, "views and points as stored fit the images as shown"

    truth = read_truth(sequence)
    assert truth is not None
    shown = {6: 1, 3: 2, 8: 3}
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turns = [np.linalg.matrix_power(quarter, shown[SIDEWAYS[i]] if i in SIDEWAYS else 0) for i in place]
    true = np.stack([q @ rotation_matrix(truth.q[i]) for q, i in zip(turns, place, strict=True)])
    common = np.einsum("nji,njk->ik", true, views.R)
    U, _, V = np.linalg.svd(common)
    apart = np.einsum("nij,nkj->nik", true @ (U @ np.diag([1, 1, np.linalg.det(U @ V)]) @ V), views.R)
    angle = np.rad2deg(np.arccos(np.clip((np.trace(apart, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert angle.max() < 1.0, "each view is turned as its image is shown"
