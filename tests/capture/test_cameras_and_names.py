"""Folders as people have them: several cameras and zooms, images on their side, reduced copies, any file name."""

from __future__ import annotations

import json
import os
import unicodedata
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from massprops.capture.footage import judge_frames, open_sources
from massprops.capture.given import GivenMasks
from massprops.capture.images import inspect, load
from massprops.capture.names import stored_names
from massprops.errors import InputError
from massprops.run.job import Job, ReconstructOptions
from massprops.run.stages import capture


def picture(seed: int, size: tuple[int, int] = (320, 240)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 255, (size[1] // 4, size[0] // 4, 3), dtype=np.uint8)
    return cv2.resize(small, size, interpolation=cv2.INTER_NEAREST)


def photograph(
    path: Path,
    size: tuple[int, int] = (320, 240),
    orientation: int | None = None,
    film: int | None = None,
    model: str | None = None,
    seed: int = 0,
) -> Path:
    """An image stored with `size` and EXIF; `film`: the focal length's 35 mm equivalent [mm]."""
    exif = Image.Exif()
    if orientation:
        exif[0x0112] = orientation
    if model:
        exif[0x010F], exif[0x0110] = "Maker", model
        exif.get_ifd(0x8769)[0x920A] = 4.25
    if film:
        exif.get_ifd(0x8769)[0xA405] = film
    exif.load(exif.tobytes())
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture(seed, size)).save(path, exif=exif)
    return path


def staged(tmp_path: Path, source: Path, **options: object) -> tuple[Path, dict, Job]:
    out = tmp_path / "out"
    out.mkdir()
    job = Job(run=tmp_path, options=ReconstructOptions(source=str(source), **options), out=out)  # type: ignore[arg-type]
    capture.run(job)
    return out, json.loads((out / "footage.json").read_text()), job


def test_names_that_every_tool_can_read() -> None:
    names = [
        "Photo 001.jpg",
        "Photo_001.jpg",
        "photo_001.JPG",
        "照片.jpg",
        "图.jpg",
        "a.heic",
        "#x.png",
        "Zoë.png",
        "d\udcff.jpg",
    ]
    stored = stored_names(names)
    assert stored[:2] == ["Photo_001-2.jpg", "Photo_001.jpg"], "a name that is fit as it is stays"
    assert stored[5:8] == ["a.heic.png", "x.png", "Zoe.png"]
    assert all(n.isascii() and set(n) <= set("-._") | {c for c in n if c.isalnum()} for n in stored)
    assert len({n.lower() for n in stored}) == len(names), "different also where upper and lower case are one"
    assert max(len(n) for n in stored_names(["é" * 120 + ".jpg", "é" * 120 + "x.tif"])) < 120


def test_any_file_name_reaches_the_run(tmp_path: Path) -> None:
    names = ["Photo 1 (копия).jpg", "Photo 1.jpg", "Zoe\u0308 2.jpg", "x\ny.png"]
    for i, name in enumerate(names):
        photograph(tmp_path / "in" / name, seed=i)
        mask = np.zeros((240, 320), np.uint8)
        mask[10 * i : 200, 60:250] = 255
        (tmp_path / "masks").mkdir(exist_ok=True)
        # as a program that stores accents in one piece writes it
        composed = unicodedata.normalize("NFC", name)
        cv2.imwrite(str(tmp_path / "masks" / f"{composed}.png"), mask)
    out, footage, _ = staged(tmp_path, tmp_path / "in", masks=str(tmp_path / "masks"))
    by_source = {f["source_name"]: f["name"] for f in footage["frames"]}
    assert sorted(by_source) == sorted(names)
    for i, name in enumerate(names):
        stored = by_source[name]
        assert stored.isascii() and " " not in stored and "\n" not in stored
        seen = cv2.imread(str(out / "masks" / f"{stored}.png"), 0)
        assert np.flatnonzero(seen.any(1))[0] == 10 * i, "each image has its own mask"
        assert (out / "frames" / stored).is_file()
    again = GivenMasks(out / "masks")
    assert again.check([(by_source[n], n) for n in names]), "a run's own masks can be given back"


def test_masks_for_half_of_the_images(tmp_path: Path) -> None:
    for i in range(6):
        photograph(tmp_path / "in" / f"{i}.jpg", seed=i)
    (tmp_path / "masks").mkdir()
    for i in range(3):
        cv2.imwrite(str(tmp_path / "masks" / f"{i}.jpg.png"), np.full((240, 320), 255, np.uint8))
    with pytest.raises(InputError, match=r"no mask for 3 of 6 images \(3\.jpg, 4\.jpg, 5\.jpg\).*leave --masks out"):
        staged(tmp_path, tmp_path / "in", masks=str(tmp_path / "masks"))


def test_zooms_devices_and_copies_are_cameras_of_their_own(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    for i in range(5):
        photograph(folder / f"a{i}.jpg", film=28, model="One", seed=i)
    for i in range(4):
        photograph(folder / f"b{i}.jpg", film=56, model="One", seed=10 + i)
    for i in range(3):
        photograph(folder / f"c{i}.jpg", (200, 150), seed=20 + i)
    _, footage, _ = staged(tmp_path, folder)
    cameras = footage["cameras"]
    assert footage["kind"] == "images" and [c["images"] for c in cameras] == [5, 4, 3]
    assert [c["focal_px"] for c in cameras[:2]] == pytest.approx([28 / 34.6133 * 320, 56 / 34.6133 * 320], rel=1e-4)
    assert cameras[2]["focal_px"] is None, "two zooms have the copies' shape: neither is guessed"
    assert {f["name"][5]: f["camera"] for f in footage["frames"]} == {"a": 0, "b": 1, "c": 2}
    assert all(f["name"].startswith("cam0/") for f in footage["frames"]), "no stereo rig"


def test_a_reduced_copy_has_the_focal_length_of_its_like(tmp_path: Path) -> None:
    for i in range(3):
        photograph(tmp_path / f"a{i}.jpg", film=28, model="One", seed=i)
    photograph(tmp_path / "c.jpg", (160, 120))
    photograph(tmp_path / "wide.jpg", (160, 90))
    cameras = open_sources(tmp_path)[0].cameras
    assert [(c.focal_source, c.focal_px and round(c.focal_px, 2)) for c in cameras] == [
        ("exif", 258.86),
        ("alike", 129.43),
        ("none", None),
    ]
    given = open_sources(tmp_path, 260.0)[0].cameras
    assert [(c.focal_source, c.focal_px) for c in given] == [("given", 260.0), ("start", 130.0), ("none", None)]


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("ending", ["jpg", "png", "webp", "tif"])
def test_every_orientation_is_shown_upright(tmp_path: Path, ending: str, orientation: int) -> None:
    stored = np.zeros((96, 160, 3), np.uint8)
    stored[:32, :48, 0], stored[-32:, :48, 1] = 255, 255
    from PIL import ImageOps

    exif = Image.Exif()
    exif[0x0112] = orientation
    exif.get_ifd(0x8769)[0xA405] = 36
    # Pillow writes the sub-folder of tags into a TIFF only where it was read from bytes
    exif.load(exif.tobytes())
    path = tmp_path / f"a.{ending}"
    image = Image.fromarray(stored)
    image.save(path, exif=exif, **({"lossless": True} if ending == "webp" else {}))
    image.getexif()[0x0112] = orientation
    expected = np.asarray(ImageOps.exif_transpose(image))[..., ::-1]
    found, header = load(path), inspect(path)
    assert header.size == found.shape[1::-1] == expected.shape[1::-1]
    assert np.abs(found.astype(int) - expected).mean() < 6
    assert header.focal_px == pytest.approx(160 * 36 / 34.6133, rel=1e-4)


def test_sideways_photographs_share_the_camera(tmp_path: Path) -> None:
    for i, orientation in enumerate((1, 1, 1, 6, 8, 3)):
        photograph(tmp_path / "in" / f"{i}.tif", orientation=orientation, film=28, model="One", seed=i)
    photograph(tmp_path / "in" / "6.tif", (240, 320), film=28, model="One", seed=6)
    out, footage, _ = staged(tmp_path, tmp_path / "in", max_size=160, focal=400.0)
    (camera,) = footage["cameras"]
    assert (camera["width"], camera["height"], camera["images"]) == (160, 120, 7)
    assert camera["focal_px"] == pytest.approx(200.0), "half the size, whichever way it was held"
    assert [f["turn"] for f in footage["frames"]] == [0, 0, 0, 3, 1, 2, 1]
    for frame in footage["frames"][:6]:
        image = cv2.imread(str(out / "frames" / frame["name"]))
        assert image.shape[1::-1] == (frame["width"], frame["height"])
        stored = cv2.resize(picture(frame["index"]), (160, 120), interpolation=cv2.INTER_AREA)[..., ::-1]
        assert np.abs(np.rot90(image, -frame["turn"]).astype(int) - stored).mean() < 1, "as on the sensor"


def test_a_mask_drawn_over_the_stored_pixels_is_turned(tmp_path: Path) -> None:
    for i in range(3):
        photograph(tmp_path / "in" / f"{i}.jpg", orientation=6, seed=i)
        mask = np.zeros((240, 320), np.uint8)
        mask[:60, :80] = 255
        (tmp_path / "masks").mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / "masks" / f"{i}.png"), mask)
    out, _, _ = staged(tmp_path, tmp_path / "in", masks=str(tmp_path / "masks"))
    seen = cv2.imread(str(out / "masks" / "cam0" / "1.jpg.png"), 0) > 0
    assert seen.shape == (320, 240) and seen[:80, -60:].all() and seen.sum() == 4800


def test_images_that_cannot_be_used_are_left_out_and_named(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    for i in range(8):
        photograph(folder / f"{i}.jpg", (1280, 960), seed=i)
    (folder / "broken.jpg").write_bytes(b"no image")
    whole = (folder / "0.jpg").read_bytes()
    (folder / "cut.jpg").write_bytes(whole[: len(whole) // 3])
    (folder / "broken.heic").write_bytes(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + b"\0" * 400)
    photograph(folder / "tiny.png", (40, 30))
    photograph(folder / "thumb.jpg", (160, 120))
    photograph(folder / "panorama.jpg", (1280, 300))
    _, footage, job = staged(tmp_path, folder)
    assert (footage["used"], footage["given"]) == (8, 14)
    assert {e["source_name"] for e in footage["left_out"]} == {
        "broken.jpg", "cut.jpg", "broken.heic", "tiny.png", "thumb.jpg", "panorama.jpg",
    }  # fmt: skip
    (line,) = job.notes
    assert line.startswith("6 images were left out: ") and "broken.heic (not an image that can be read" in line
    assert "panorama.jpg (a panorama" in line and "thumb.jpg (a thumbnail" in line and "tiny.png (too small" in line
    for i in range(2, 8):
        (folder / f"{i}.jpg").unlink()
    with pytest.raises(InputError, match=r"2 of 8 images can be used.*broken\.heic.*broken\.jpg.*and 3 more"):
        judge_frames(open_sources(folder)[0], lambda *_: None)


def test_links_that_lead_nowhere_pipes_and_devices_are_left_out_and_named(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    for i in range(4):
        photograph(folder / f"{i}.jpg", seed=i)
    (folder / "moved.jpg").symlink_to(tmp_path / "elsewhere.jpg")
    (folder / "loop.jpg").symlink_to(folder / "loop.jpg")
    (folder / "device.jpg").symlink_to("/dev/zero")
    os.mkfifo(folder / "pipe.jpg")
    (folder / "folder.jpg").mkdir()
    _, footage, job = staged(tmp_path, folder)
    assert (footage["used"], footage["given"]) == (4, 8)
    assert "4 images were left out" in job.notes[0] and "moved.jpg (a link that leads nowhere" in job.notes[0]


def test_sixteen_bits_and_other_formats(tmp_path: Path) -> None:
    from pillow_heif import register_heif_opener

    register_heif_opener()
    ramp = np.tile(np.linspace(0, 65535, 320).astype(np.uint16), (240, 1))
    colour = np.dstack([ramp, ramp[:, ::-1], ramp])
    cv2.imwrite(str(tmp_path / "a.png"), colour)
    cv2.imwrite(str(tmp_path / "b.tif"), colour)
    cv2.imwrite(str(tmp_path / "c.png"), ramp)
    cv2.imwrite(str(tmp_path / "d.bmp"), (colour // 257).astype(np.uint8))
    Image.fromarray((colour[..., ::-1] // 257).astype(np.uint8)).save(tmp_path / "e.heic", quality=95)
    for path in sorted(tmp_path.iterdir()):
        image = load(path)
        expected = np.dstack([ramp] * 3) if path.name == "c.png" else colour
        assert image.dtype == np.uint8 and inspect(path).size == (320, 240)
        assert np.abs(image - expected / 257).mean() < 3, path.name


def test_a_header_cannot_hurt(tmp_path: Path) -> None:
    import struct
    import zlib

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    bomb = tmp_path / "bomb.png"
    bomb.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 1000)))
    for read in (inspect, load):
        with pytest.raises(InputError, match="60000x60000 pixels are too many"):
            read(bomb)
    for year, expected in ((2300, -1), (1900, -1), (2024, 1704067200 * 10**9)):
        exif = Image.Exif()
        exif.get_ifd(0x8769)[0x9003] = f"{year}:01:01 00:00:00"
        Image.fromarray(picture(0)).save(tmp_path / "y.jpg", exif=exif)
        assert inspect(tmp_path / "y.jpg").timestamp_ns == expected
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x9003], exif.get_ifd(0x8769)[0xA405] = "\xff\0", "wide"
    Image.fromarray(picture(0)).save(tmp_path / "z.jpg", exif=exif)
    assert inspect(tmp_path / "z.jpg").focal_px is None


def test_each_size_has_a_background_of_its_own(tmp_path: Path) -> None:
    """A body before a textured wall that stays, half of the images reduced: no median mixes the two sizes."""
    wall = cv2.GaussianBlur(picture(5), (0, 0), 2)
    (tmp_path / "in").mkdir()
    true = {}
    for i in range(12):
        image, body = wall.copy(), np.zeros((240, 320), np.uint8)
        left = 20 + 22 * i
        body[90:150, left : left + 50] = 255
        image[body > 0] = picture(9, (200, 240)).reshape(-1, 3)[: np.count_nonzero(body)]
        if i % 2:
            image, body = cv2.resize(image, (240, 180)), cv2.resize(body, (240, 180))
        cv2.imwrite(str(tmp_path / "in" / f"{i}.png"), image)
        true[f"{i}.png"] = body > 127
    out, footage, _ = staged(tmp_path, tmp_path / "in", motion="tumbling")
    assert len(footage["cameras"]) == 2
    for frame in footage["frames"]:
        found = cv2.imread(str(out / "masks" / f"{frame['name']}.png"), 0) > 127
        body = true[frame["source_name"]]
        assert (found & body).sum() > 0.85 * (found | body).sum(), frame["source_name"]
