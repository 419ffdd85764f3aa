"""Scenes from which no single object comes: one line each that says what to do, and what was computed stays."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import trimesh

sys.path.insert(0, str(Path(__file__).parents[1] / "capture"))
sys.path.insert(0, str(Path(__file__).parents[1] / "mass"))

from some_evidence import evidence
from test_object_on_support import box, rectangle
from test_readings import GREY, RED, SIZE, VIEWS, ground, made, on_stand, pixel_of, two_boxes

from massprops.capture.frame_edge import cut_off
from massprops.capture.scene import Scene
from massprops.errors import InputError, NotPossible
from massprops.geometry.rasterise import silhouette
from massprops.mass.confidence import confidence
from massprops.run.job import Job, ReconstructOptions
from massprops.run.stages import shape, silhouettes
from massprops.run.stages.mass import readings_of
from massprops.sfm.points import SparsePoints
from massprops.surface.cloud import Cloud


def run_of(tmp_path: Path, motion: str = "static", images: list[np.ndarray] | None = None) -> Path:
    """`work/` as capture and sfm leave it; the images are noise unless given."""
    run, rng = tmp_path / "run", np.random.default_rng(0)
    for part in ("capture/frames/cam0", "sfm", "shape", "silhouettes"):
        (run / "work" / part).mkdir(parents=True)
    frames = []
    for i, name in enumerate(VIEWS.names):
        own = name.split("/")[1]
        size = {"width": SIZE[0], "height": SIZE[1]}
        frames.append({"name": name, "source_name": own, "timestamp_ns": -1, "camera": 0, "turn": 0, **size})
        image = rng.integers(0, 255, (SIZE[1], SIZE[0], 3), dtype=np.uint8) if images is None else images[i]
        cv2.imwrite(str(run / "work" / "capture" / "frames" / name), image)
    footage = {
        "frames": frames,
        "cameras": [{"id": 0, "source_size": list(SIZE)}],
        "motion": motion,
        "background": "black" if motion == "tumbling" else "moving",
        "masks_given": False,
    }
    (run / "work" / "capture" / "footage.json").write_text(json.dumps(footage))
    VIEWS.save(run / "work" / "sfm" / "views.npz")
    none = np.zeros(0, int)
    SparsePoints(
        none, np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0), none, none, np.zeros((0, 2))
    ).save(run / "work" / "sfm" / "points.npz")  # fmt: skip
    return run


def shaped(monkeypatch: pytest.MonkeyPatch, run: Path, points: Scene, **options: object) -> tuple[dict, Job]:
    """The shape stage on dense points that are given."""
    n = len(points.xyz)
    cloud = Cloud(points.xyz, points.normal, np.full(n, 0.003), np.arange(n + 1), np.zeros(n, int))
    monkeypatch.setattr(shape, "_dense", lambda *_: (cloud, points.rgb))
    ball = trimesh.creation.icosphere(radius=0.1)
    made_of = SimpleNamespace(vertices=np.asarray(ball.vertices), faces=np.asarray(ball.faces))
    monkeypatch.setattr("massprops.surface.reconstruct.reconstruct_surface", lambda *_, **__: made_of)
    job = Job(run=run, options=ReconstructOptions(**options), out=run / "work" / "shape")  # type: ignore[arg-type]
    shape.run(job)
    return json.loads((job.out / "shape.json").read_text()), job


def empty_table() -> Scene:
    return made((rectangle(np.random.default_rng(0), 40_000, 1.0, 1.0, 0.0), GREY))


def test_a_scene_in_which_nothing_stands_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(NotPossible, match=r"nothing rises from the plane.*middle of the images.*--masks"):
        shaped(monkeypatch, run_of(tmp_path), empty_table())


def test_glass_and_mirrors_are_no_object(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A glass shows the table behind it; a mirror shows the room below the table. Neither stands on it."""
    rng = np.random.default_rng(1)
    table = rectangle(rng, 40_000, 1.0, 1.0, 0.0)
    mirrored = box(rng, 1200, np.array([0.1, 0.1, 0.1]), np.array([0, 0, -0.2]))
    points = made((table, GREY), ((mirrored[0], -mirrored[1]), RED))
    with pytest.raises(NotPossible, match="texture or side light"):
        shaped(monkeypatch, run_of(tmp_path), points)
    found = confidence(evidence(0.04, 0.7, 0.0, 30, 30))
    assert found["level"] == "low" and "mirrors, glass" in found["because"][0] and "dull them" in found["because"][0]


def test_two_things_of_like_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = run_of(tmp_path)
    points, *_ = two_boxes()
    facts, job = shaped(monkeypatch, run, points)
    readings = facts["placements"][0]["readings"]
    assert len(readings) == 2
    drawn = [cv2.imread(str(job.out / r["picture"])) for r in readings]
    assert all(d is not None for d in drawn) and (drawn[0] != drawn[1]).any(), "a picture of each"
    said = readings_of(facts, 2.0)
    assert [r["used"] for r in said] == [True, False] and "picture" not in said[0]
    assert np.allclose(said[0]["extent"], 2.0 * np.array(readings[0]["extent"]))
    found = confidence(evidence(0.03, 0, 0, 30, 30, readings=tuple(f"{r['reading']} ({r['option']})" for r in said)))
    assert found["level"] == "low" and "--object X,Y" in found["because"][0]
    settled, _ = shaped(
        monkeypatch, run_of(tmp_path / "b"), points, object=("{:.0f},{:.0f}".format(*pixel_of((-0.2, 0, 0.24)).uv[0]),)
    )
    assert settled["placements"][0]["readings"] == [] and readings_of(settled, 1.0) == []


def test_a_stand_is_settled_by_an_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    facts, _ = shaped(monkeypatch, run_of(tmp_path), on_stand())
    assert [r["option"] for r in facts["placements"][0]["readings"]][1] == "--keep-support"
    kept, _ = shaped(monkeypatch, run_of(tmp_path / "b"), on_stand(), keep_support=True)
    assert kept["placements"][0]["readings"] == []
    assert kept["placements"][0]["object_points"] > 1.5 * facts["placements"][0]["object_points"]


def test_object_on_the_background(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points, *_ = two_boxes()
    x, y = pixel_of((0, -0.7, 0)).uv[0]
    with pytest.raises(NotPossible, match=r"--object .* of 00.jpg shows the background.*--box"):
        shaped(monkeypatch, run_of(tmp_path), points, object=(f"{x:.0f},{y:.0f}",))
    with pytest.raises(InputError, match="outside the image 00.jpg, which is 320x240"):
        shaped(monkeypatch, run_of(tmp_path / "b"), points, object=("400,10",))
    with pytest.raises(InputError, match="are for an object that stands on something"):
        shaped(monkeypatch, run_of(tmp_path / "c", "tumbling"), points, object=("10,10",))


# ---- silhouettes


def pictures(hand_in: int, shift: float = 0.0) -> tuple[trimesh.Trimesh, list[np.ndarray]]:
    """A red box on a grey table from all sides, a hand before half of it in the first images."""
    body = trimesh.creation.box(extents=(0.5, 0.4, 0.4))
    body.apply_translation([shift, 0, 0.2])
    rng, out = np.random.default_rng(2), []
    for i in range(len(VIEWS)):
        seen = silhouette(np.asarray(body.vertices), np.asarray(body.faces), VIEWS.K[i], VIEWS.R[i], VIEWS.t[i], SIZE)
        image = np.full((SIZE[1], SIZE[0], 3), GREY, np.uint8)
        image[seen] = RED[::-1]
        if i < hand_in:
            rows, columns = np.nonzero(seen)
            top, left = int(rows.mean()), int(columns.mean())
            image[top : top + 40, left:] = (140, 170, 220)  # an arm from the right
        out.append((image + rng.normal(0, 4, image.shape)).clip(0, 255).astype(np.uint8))
    return body, out


def outlined(run: Path, body: trimesh.Trimesh) -> tuple[dict, Job]:
    """The silhouettes stage on a shape that is given, with the points of its table."""
    place = run / "work" / "shape" / "placement0"
    place.mkdir()
    np.savez(place / "shape.npz", vertices=np.asarray(body.vertices), faces=np.asarray(body.faces))
    table, normal = ground(np.random.default_rng(3), 0.3)
    n = len(table)
    Cloud(table, normal, np.full(n, 0.003), np.arange(n + 1), np.zeros(n, int)).save(place / "other.npz")
    np.save(place / "other_colour.npy", np.tile(np.array(GREY, np.uint8), (n, 1)))
    some, sides = trimesh.sample.sample_surface(body, 6000, seed=0)
    Cloud(some, body.face_normals[sides], np.full(6000, 0.003), np.arange(6001), np.zeros(6000, int)).save(
        place / "object.npz"
    )
    np.save(place / "colour.npy", np.tile(np.array(RED, np.uint8), (6000, 1)))
    facts = {"placements": [{"method": "measured", "images": list(VIEWS.names)}], "lost": []}
    (run / "work" / "shape" / "shape.json").write_text(json.dumps(facts))
    job = Job(run=run, options=ReconstructOptions(), out=run / "work" / "silhouettes")
    silhouettes.run(job)
    return json.loads((job.out / "silhouettes.json").read_text()), job


@pytest.mark.parametrize("hand_in", [0, 4])
def test_a_hand_before_the_object_is_said(tmp_path: Path, hand_in: int) -> None:
    body, images = pictures(hand_in)
    facts, job = outlined(run_of(tmp_path, images=images), body)
    said = [note for note in job.notes if "such as a hand" in note]
    assert len(said) == bool(hand_in) and facts["cut_off"] == []
    if hand_in:
        assert (
            "in front of it in 4 images (cam0/00.jpg, cam0/01.jpg, cam0/02.jpg, ...)" in said[0]
            and "massprops masks" in said[0]
        )


def test_an_object_in_a_hand_reaches_the_frame(tmp_path: Path) -> None:
    """A still camera, an object turned in a hand: what moves is the object with the arm."""
    run = run_of(tmp_path, "tumbling")
    (run / "work" / "capture" / "masks" / "cam0").mkdir(parents=True)
    for i, name in enumerate(VIEWS.names):
        mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
        cv2.circle(mask, (160, 110), 50, 255, -1)
        mask[130:, 140 + i : 180 + i] = 255
        cv2.imwrite(str(run / "work" / "capture" / "masks" / f"{name}.png"), mask)
    np.savez(run / "work" / "sfm" / "points.npz", xyz=np.zeros((0, 3)), obs_point=np.zeros(0, int))
    (run / "work" / "shape" / "shape.json").write_text('{"placements": [], "lost": []}')
    job = Job(run=run, options=ReconstructOptions(), out=run / "work" / "silhouettes")
    silhouettes.run(job)
    facts = json.loads((job.out / "silhouettes.json").read_text())
    assert len(facts["cut_off"]) == len(VIEWS) and any("keep hands and arms out" in note for note in job.notes)
    assert confidence(evidence(0.04, 0, 0, 24, 24, cut=24))["level"] == "low"


def test_an_object_cut_off_by_the_frame_is_said(tmp_path: Path) -> None:
    near = trimesh.creation.box(extents=(1.9, 1.9, 0.5))
    images = []
    for i in range(len(VIEWS)):
        seen = silhouette(np.asarray(near.vertices), np.asarray(near.faces), VIEWS.K[i], VIEWS.R[i], VIEWS.t[i], SIZE)
        images.append(np.where(seen[..., None], np.array(RED[::-1]), np.array(GREY)).astype(np.uint8))
    facts, job = outlined(run_of(tmp_path, images=images), near)
    assert len(facts["cut_off"]) > 0.5 * len(VIEWS)
    assert any("edge of the frame" in note and "step back" in note for note in job.notes)
    found = confidence(evidence(0.04, 0, 0, 24, 24, cut=len(facts["cut_off"])))
    assert found["level"] == "low" and "step back, keep hands and arms out" in found["because"][0]


@pytest.mark.parametrize(("reach", "cut"), [(0, True), (20, False)])
def test_the_edge_of_the_frame(reach: int, cut: bool) -> None:
    mask = np.zeros((240, 320), np.uint8)
    mask[60:180, reach : reach + 100] = 255
    assert cut_off(mask) == cut
    assert not cut_off(np.full((240, 320), 128, np.uint8)), "what cannot be told is no object"
    touching = np.zeros((240, 320), np.uint8)
    touching[100:104, 0:60], touching[60:180, 40:140] = 255, 255
    assert not cut_off(touching), "a thin tip may touch it"


# ---- photographs of other things


def test_photographs_of_two_different_objects_are_low() -> None:
    found = confidence(evidence(0.03, 0, 0, 40, 22, unjoined=1, misfit=18))
    assert found["level"] == "low" and "18 images show what may be another object" in found["because"][0]
    assert confidence(evidence(0.03, 0, 0, 40, 38, unjoined=1, misfit=2))["level"] == "medium"


def test_a_video_whose_middle_is_another_scene_is_low() -> None:
    found = confidence(evidence(0.03, 0, 0, 60, 36, scenes=(36, 22)))
    assert found["level"] == "low" and "scenes that do not connect (36, 22 images)" in found["because"][0]
    assert "as a separate INPUT" in found["because"][0]
    assert confidence(evidence(0.03, 0, 0, 32, 27, scenes=(27, 5)))["level"] == "medium"
    assert confidence(evidence(0.03, 0, 0, 60, 60, scenes=(60,)))["level"] == "high"
