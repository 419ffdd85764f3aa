"""A run's silhouettes written over the user's images, mended, and given back."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from massprops.capture.from_shape import overlap, to_stored
from massprops.capture.given import load_mask, to_original
from massprops.capture.images import QUARTER_TURNS, turn, turned_back
from massprops.errors import InputError
from massprops.run.job import Job, ReconstructOptions
from massprops.run.masks import masks
from massprops.run.stages import capture
from massprops.views import AMBIGUOUS, Views, undistort

K = np.array([[150.0, 0, 79.5], [0, 150.0, 59.5], [0, 0, 1]])
LENS = np.array([-0.2, 0.05, 0.0, 0.0])
HOSTILE = "<script>window.hit=1<&.png"


@pytest.mark.parametrize("orientation", QUARTER_TURNS)
def test_turned_back_undoes_a_turn(orientation: int) -> None:
    stored = np.arange(12).reshape(3, 4)
    assert np.array_equal(turned_back(turn(stored, orientation), orientation), stored)


def photographs(folder: Path) -> Path:
    """Eight images twice as large as they are used, one on its side, one upside down, one of a hostile name."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    names = ["Photo 0.jpg", "b 1.jpg", "é2.jpg", HOSTILE, *(f"{i}.jpg" for i in range(4, 8))]
    for i, name in enumerate(names):
        exif = Image.Exif()
        size = (480, 640) if i == 1 else (640, 480)
        if i in (1, 2):
            exif[0x0112] = {1: 6, 2: 3}[i]
        small = rng.integers(0, 255, (size[1] // 8, size[0] // 8, 3), dtype=np.uint8)
        Image.fromarray(cv2.resize(small, size, interpolation=cv2.INTER_NEAREST)).save(folder / name, exif=exif)
    return folder


def run_of(tmp_path: Path, left_out: int = 5, unplaced: int = 6) -> tuple[Path, Path]:
    """A run folder as the stages leave it, up to its silhouettes; without a mesh."""
    source, run = photographs(tmp_path / "in"), tmp_path / "run"
    out = run / "work" / "capture"
    out.mkdir(parents=True)
    capture.run(Job(run=run, options=ReconstructOptions(source=str(source), max_size=320, motion="static"), out=out))
    footage = json.loads((out / "footage.json").read_text())
    frames = [f for i, f in enumerate(footage["frames"]) if i != unplaced]
    n = len(frames)
    size = np.array([[f["width"], f["height"]] for f in frames])
    Ks = np.array([[[150.0, 0, (w - 1) / 2], [0, 150.0, (h - 1) / 2], [0, 0, 1]] for w, h in size])
    views = Views(
        tuple(f["name"] for f in frames), np.full(n, -1), size, Ks, np.tile(LENS, (n, 1)), np.tile(np.eye(3), (n, 1, 1)),
        np.tile([0.0, 0, 4], (n, 1)),
    )  # fmt: skip
    (run / "work" / "sfm").mkdir()
    views.save(run / "work" / "sfm" / "views.npz")
    for i, name in enumerate(views.names):
        flat = np.zeros(size[i][::-1], bool)
        flat[30 + 4 * i : 150, 60:220] = True
        mask = to_stored(flat, Ks[i], LENS)
        mask[100:110, 60:70] = AMBIGUOUS
        file = run / "work" / "silhouettes" / "masks" / f"{name}.png"
        file.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(file), np.full_like(mask, AMBIGUOUS) if i == left_out else mask)
    facts = {"left_out": [views.names[left_out]], "method": "drawn"}
    (run / "work" / "silhouettes" / "silhouettes.json").write_text(json.dumps(facts))
    return source, run


def test_what_masks_writes_is_what_reconstruct_takes_back(tmp_path: Path) -> None:
    source, run = run_of(tmp_path)
    sheet = masks(run, tmp_path / "masks")
    assert len(sheet.images) == 8 and sum(bool(s.left_out) for s in sheet.images) == 2
    for s in sheet.images:
        image, mask = Image.open(source / s.name), Image.open(sheet.folder / s.file)
        assert s.file == f"{s.name}.png" and mask.size == image.size, "over the pixels as they are stored"
        assert np.isin(np.unique(np.asarray(mask)), (0, AMBIGUOUS, 255)).all()
    again = tmp_path / "again"
    again.mkdir()
    job = Job(
        run=tmp_path / "r",
        options=ReconstructOptions(source=str(source), max_size=320, motion="static", masks=str(sheet.folder)),
        out=again,
    )
    capture.run(job)
    assert any("2 masks are all black" in note for note in job.notes)
    near = np.ones((3, 3), np.uint8)
    for s in sheet.images:
        back = cv2.imread(str(again / "masks" / f"{s.stored}.png"), 0)
        if s.left_out:
            assert not back.any()
            continue
        mask = cv2.imread(str(run / "work" / "silhouettes" / "masks" / f"{s.stored}.png"), 0)
        for value in (255, AMBIGUOUS):
            had, got = (np.where(m == value, 255, 0).astype(np.uint8) for m in (mask, back))
            assert not (cv2.erode(had, near) & ~got).any() and not (got & ~cv2.dilate(had, near)).any(), (
                "within a pixel"
            )


def test_the_page_shows_every_image_and_why_it_was_left_out(tmp_path: Path) -> None:
    _, run = run_of(tmp_path)
    page = masks(run, tmp_path / "m").page.read_text()
    assert page.count("<figure") == 8 and page.count("<img") == 8
    assert "Content-Security-Policy" in page and "window.hit=1<&" not in page and "&lt;script&gt;" in page
    assert "could not be placed" in page and "in another place" in page
    assert "no mesh to compare them with" in page and "http" not in page.replace("http-equiv", "")


def test_agreement_with_the_mesh(tmp_path: Path) -> None:
    """A square of known size before pinhole cameras with distortion: the silhouettes were drawn from it."""
    _, run = run_of(tmp_path)
    (run / "work" / "join").mkdir()
    (run / "work" / "surface").mkdir()
    views = Views.load(run / "work" / "sfm" / "views.npz")
    views.save(run / "work" / "join" / "views.npz")
    corner = np.array([[60, 30], [219, 30], [219, 149], [60, 149]], float)
    vertices = np.column_stack([(corner - [159.5, 119.5]) / 150.0 * 4, np.zeros(4)])
    np.savez(run / "work" / "surface" / "surface.npz", vertices=vertices, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    sheet = masks(run, tmp_path / "m")
    of = {s.name: s.iou for s in sheet.images}
    assert sum(value is not None for value in of.values()) == 6, "one was left out and one not placed"
    assert of["Photo 0.jpg"] is None, "it was left out"
    upright = [s for s in sheet.images if s.stored in views.names and views.size[views.names.index(s.stored)][0] == 320]
    first = next(s for s in upright if views.names.index(s.stored) == 0)
    flat = undistort(
        cv2.imread(str(run / "work" / "silhouettes" / "masks" / f"{first.stored}.png"), 0), K, np.zeros(4), True
    )
    assert flat.any() and first.iou is not None and first.iou > 0.97
    other = [s.iou for s in upright if s.iou is not None and s.stored != first.stored]
    assert other and max(other) < first.iou, "their squares begin lower than the mesh"
    assert f"agreement {first.iou:.3f}" in sheet.page.read_text()


def test_mended_masks_are_not_lost(tmp_path: Path) -> None:
    _, run = run_of(tmp_path)
    sheet = masks(run)
    assert sheet.folder == tmp_path / "run-masks"
    masks(run)
    file = sheet.folder / sheet.images[0].file
    cv2.imwrite(str(file), np.full((480, 640), 255, np.uint8))
    with pytest.raises(InputError, match="was changed since it was written"):
        masks(run)
    masks(run, force=True)
    assert (cv2.imread(str(file), 0) == 0).any()
    with pytest.raises(InputError, match="lies in the run folder"):
        masks(run, run / "masks")
    with pytest.raises(InputError, match="no silhouettes in this folder"):
        masks(tmp_path)


def test_doubt_survives_only_where_masks_wrote_it(tmp_path: Path) -> None:
    mask = np.zeros((60, 80), np.uint8)
    mask[10:40, 10:40], mask[10:40, 40:60] = 255, AMBIGUOUS
    big = to_original(mask, (160, 120))
    cv2.imwrite(str(tmp_path / "a.png"), big)
    assert overlap(load_mask(tmp_path / "a.png", (160, 120), (80, 60)) == AMBIGUOUS, mask == AMBIGUOUS) > 0.9
    painted = big.copy()
    painted[0, 0] = 140  # by a soft brush: grey is an edge, not doubt
    cv2.imwrite(str(tmp_path / "b.png"), painted)
    assert not (load_mask(tmp_path / "b.png", (160, 120), (80, 60)) == AMBIGUOUS).any()
