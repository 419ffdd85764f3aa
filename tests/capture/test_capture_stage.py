"""The capture stage from end to end on tiny footage: what it writes, stereo pairs, and what bad folders get."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from massprops.capture.footage import same_instant
from massprops.capture.images import load
from massprops.errors import InputError
from massprops.run.job import Job, ReconstructOptions
from massprops.run.stages import capture


def turned(angle: float, shift: int = 0) -> np.ndarray:
    """A textured square that turns before a black sky."""
    rng = np.random.default_rng(0)
    patch = cv2.resize(rng.integers(60, 255, (14, 14, 3), dtype=np.uint8), (70, 70), interpolation=cv2.INTER_NEAREST)
    out = np.zeros((120, 160, 3), np.uint8)
    out[25:95, 45 + shift : 115 + shift] = patch
    return cv2.warpAffine(out, cv2.getRotationMatrix2D((80, 60), angle, 1.0), (160, 120))


def staged(tmp_path: Path, source: Path, **options: object) -> tuple[Path, dict, Job]:
    out = tmp_path / "out"
    out.mkdir()
    job = Job(run=tmp_path, options=ReconstructOptions(source=str(source), **options), out=out)  # type: ignore[arg-type]
    capture.run(job)
    return out, json.loads((out / "footage.json").read_text()), job


def photographs(folder: Path, images: list[np.ndarray], names: list[str] | None = None) -> Path:
    folder.mkdir(parents=True)
    for i, image in enumerate(images):
        cv2.imwrite(str(folder / (names[i] if names else f"p{i}.png")), image)
    return folder


def test_every_frame_has_a_silhouette_of_its_size(tmp_path: Path) -> None:
    source = photographs(tmp_path / "photos", [turned(7 * i) for i in range(8)])
    out, footage, _ = staged(tmp_path, source, max_size=120)
    assert (footage["motion"], footage["background"], footage["used"]) == ("tumbling", "black", 8)
    assert [f["name"] for f in footage["frames"]] == [f"cam0/p{i}.png" for i in range(8)]
    for frame in footage["frames"]:
        image = cv2.imread(str(out / "frames" / frame["name"]))
        mask = cv2.imread(str(out / "masks" / f"{frame['name']}.png"), cv2.IMREAD_UNCHANGED)
        assert image.shape[:2] == mask.shape == (90, 120)
        assert 0.15 < np.mean(mask == 255) < 0.35, "the square covers a quarter of the image"


def test_frames_in_the_shadow_are_left_out(tmp_path: Path) -> None:
    dark = np.full((120, 160, 3), 2, np.uint8)
    images = [dark if i % 3 else turned(7 * i) for i in range(42)]
    out, footage, _ = staged(tmp_path, photographs(tmp_path / "photos", images))
    assert footage["used"] == 14 and len(list((out / "masks" / "cam0").iterdir())) == 14
    assert sorted(f["name"] for f in footage["frames"]) == sorted(f"cam0/p{i}.png" for i in range(0, 42, 3))


def test_too_few_lit_frames_are_refused(tmp_path: Path) -> None:
    dark = np.full((120, 160, 3), 2, np.uint8)
    images = [dark if i % 5 else turned(7 * i) for i in range(40)]
    with pytest.raises(InputError, match="no object stands out from the background in 32 of 40"):
        staged(tmp_path, photographs(tmp_path / "photos", images))


def test_focal_length_follows_the_reduction(tmp_path: Path) -> None:
    source = photographs(tmp_path / "photos", [turned(7 * i) for i in range(6)])
    _, footage, _ = staged(tmp_path, source, max_size=80, focal=200.0)
    assert footage["cameras"][0]["focal_px"] == pytest.approx(100.0)


def test_motion_can_be_forced(tmp_path: Path) -> None:
    source = photographs(tmp_path / "photos", [turned(7 * i) for i in range(6)])
    _, footage, _ = staged(tmp_path, source, motion="static")
    assert footage["motion"] == "static" and "--motion" in footage["motion_reason"]


def test_given_masks_are_used_and_a_missing_one_is_named(tmp_path: Path) -> None:
    source = photographs(tmp_path / "photos", [turned(7 * i) for i in range(6)])
    masks = tmp_path / "given"
    masks.mkdir()
    for i in range(6):
        mask = np.zeros((120, 160), np.uint8)
        mask[30:90, 50:110] = 255
        cv2.imwrite(str(masks / f"p{i}.png.png"), mask)
    out, footage, _ = staged(tmp_path, source, masks=str(masks))
    assert footage["masks_given"]
    kept = cv2.imread(str(out / "masks" / "cam0" / "p3.png.png"), cv2.IMREAD_UNCHANGED)
    assert kept[31, 51] == 255 and kept[29, 49] == 0 and kept.sum() == 255 * 3600
    (masks / "p4.png.png").unlink()
    again = tmp_path / "again"
    again.mkdir()
    with pytest.raises(InputError, match=r"p4\.png"):
        staged(again, source, masks=str(masks))


def test_stereo_pairs_share_a_name_and_an_instant(tmp_path: Path) -> None:
    sequence = tmp_path / "seq"
    left = [10**9 + i * 10**8 for i in range(8)]
    right = [t + 2 * 10**6 for i, t in enumerate(left) if i != 3]
    for number, stamps in ((0, left), (1, right)):
        images = [turned(7 * left.index(min(left, key=lambda u: abs(u - t))), -4 * number) for t in stamps]  # noqa: B023
        photographs(sequence / f"cam{number}" / "data", images, [f"{t}.png" for t in stamps])
        rows = "".join(f"{t},{t}.png\n" for t in stamps)
        (sequence / f"cam{number}" / "data.csv").write_text("#timestamp [ns],filename\n" + rows)
        (sequence / f"cam{number}" / "sensor.yaml").write_text(
            "sensor_type: camera\nrate_hz: 10\nresolution: [160, 120]\ncamera_model: pinhole\n"
            "intrinsics: [200.0, 200.0, 79.5, 59.5]\ndistortion_model: radial-tangential\n"
            "distortion_coefficients: [0, 0, 0, 0]\n"
            f"T_BS: {{cols: 4, rows: 4, data: [1, 0, 0, {0.1 * number}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}}\n"
        )
    _, footage, _ = staged(tmp_path, sequence)
    assert footage["kind"] == "stereo"
    names = [sorted(f["name"][5:] for f in footage["frames"] if f["camera"] == c) for c in (0, 1)]
    assert names[0] == names[1] and len(names[0]) == 7 and f"{left[3]}.png" not in names[0]
    stamps = {(f["camera"], f["name"][5:]): f["timestamp_ns"] for f in footage["frames"]}
    assert all(stamps[1, n] - stamps[0, n] == 2 * 10**6 for n in names[0])
    assert footage["cameras"][1]["T_BS"][0][3] == pytest.approx(0.1)


@pytest.mark.parametrize("size", [(5000, 1), (1, 5000), (1, 1)])
def test_images_of_a_line_are_no_photographs(tmp_path: Path, size: tuple[int, int]) -> None:
    lines = [cv2.resize(turned(7 * i), size) for i in range(8)]
    with pytest.raises(InputError, match=rf"0 of 8 images can be used.*too small, {size[0]}x{size[1]} pixels"):
        staged(tmp_path, photographs(tmp_path / "photos", lines))


def test_the_two_cameras_of_a_rig_may_differ_in_size(tmp_path: Path) -> None:
    for number, size in enumerate([(160, 120), (120, 90)]):
        camera = tmp_path / "seq" / f"cam{number}"
        images = [cv2.resize(turned(7 * i, -4 * number), size) for i in range(6)]
        photographs(camera / "data", images, [f"{10**9 + 10**8 * i}.png" for i in range(6)])
        (camera / "sensor.yaml").write_text(
            f"resolution: [{size[0]}, {size[1]}]\n"
            f"intrinsics: [{1.25 * size[0]}, {1.25 * size[0]}, {size[0] / 2}, {size[1] / 2}]\n"
            f"T_BS: {{cols: 4, rows: 4, data: [1, 0, 0, {0.1 * number}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}}\n"
        )
    _, footage, _ = staged(tmp_path, tmp_path / "seq")
    cameras = [(c["width"], c["height"], c["focal_px"]) for c in footage["cameras"]]
    assert footage["kind"] == "stereo" and cameras == [(160, 120, 200.0), (120, 90, 150.0)]
    assert {(f["camera"], f["width"], f["height"]) for f in footage["frames"]} == {(0, 160, 120), (1, 120, 90)}


def test_intrinsics_of_another_size_are_refused(tmp_path: Path) -> None:
    """As of images that were reduced after they were calibrated: their focal length is not the one that is stated."""
    photographs(tmp_path / "seq" / "cam0" / "data", [turned(8.0 * i) for i in range(8)])
    sensor = tmp_path / "seq" / "cam0" / "sensor.yaml"
    sensor.write_text("resolution: [320, 240]\nintrinsics: [400.0, 400.0, 159.5, 119.5]\n")
    with pytest.raises(InputError, match=r"sensor.yaml: says 320x240 pixels, and its images have 160x120"):
        staged(tmp_path, tmp_path / "seq")
    sensor.write_text("intrinsics: [200.0, 200.0, 79.5, 59.5]\n")
    (tmp_path / "again").mkdir()
    assert staged(tmp_path / "again", tmp_path / "seq")[1]["cameras"][0]["focal_px"] == 200.0


def test_instants_without_clocks_go_by_place() -> None:
    none = np.full(5, -1, np.int64)
    mine, theirs = same_instant(np.arange(5), none, np.array([1, 3, 4, 7]), none[:4])
    assert mine.tolist() == [1, 3, 4] and theirs.tolist() == [0, 1, 2]


def test_several_objects_are_said(tmp_path: Path) -> None:
    def two(i: int) -> np.ndarray:
        small = cv2.resize(turned(7 * i), (80, 60))
        return np.hstack([np.vstack([small, small * 0]), np.vstack([small * 0, small])])

    source = photographs(tmp_path / "photos", [two(i) for i in range(8)])
    with pytest.raises(InputError, match="several objects"):
        staged(tmp_path, source)


def test_a_photograph_cut_short_is_named(tmp_path: Path) -> None:
    whole = tmp_path / "a.jpg"
    cv2.imwrite(str(whole), np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8))
    data = whole.read_bytes()
    whole.write_bytes(data + b"\xff\xda appended by a phone")
    assert load(whole).shape == (120, 160, 3)
    whole.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"a\.jpg"):
        load(whole)


def test_photographs_before_a_plain_backdrop(real_data: Path, tmp_path: Path) -> None:
    """The axe on white against the museum's own silhouettes, at a quarter of the size."""
    names = sorted(p.name for p in (real_data / "axe" / "images").glob("*.jpg"))[::3]
    photos = tmp_path / "photos"
    photos.mkdir()
    for name in names:
        (photos / name).symlink_to(real_data / "axe" / "images" / name)
    out, footage, _ = staged(tmp_path, photos, max_size=400)
    assert footage["motion"] == "static" and footage["mask_features"]
    overlap = []
    for name in names:
        found = cv2.imread(str(out / "masks" / "cam0" / f"{name}.png"), 0) > 127
        true = cv2.imread(str(real_data / "axe" / "masks" / f"{name}.png"), 0)
        true = cv2.resize(true, found.shape[::-1], interpolation=cv2.INTER_AREA) > 127
        overlap.append((found & true).sum() / (found | true).sum())
    assert np.median(overlap) > 0.94 and min(overlap) > 0.85, overlap


def test_more_images_than_the_memory_holds_are_refused_before_they_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = photographs(tmp_path / "in", [turned(8.0 * i) for i in range(8)])
    staged(tmp_path, source)
    (tmp_path / "again").mkdir()
    monkeypatch.setattr("massprops.memory.machine_bytes", lambda: 100_000)
    with pytest.raises(InputError, match=r"8 images of up to \d+ pixels would take .* GB of memory.*fewer --frames"):
        staged(tmp_path / "again", source)
    assert not list((tmp_path / "again").rglob("*.png"))
