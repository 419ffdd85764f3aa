"""What bad footage and bad options get from `massprops reconstruct`: one line, exit 2 or 3, never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import trimesh
from whole import Said, assert_one_line, massprops

SIZE = (160, 120)
SAMPLE = Path(__file__).resolve().parents[2] / "samples" / "spacecraft.stl"


def view(angle: float, seed: int = 0, place: tuple[int, int] = (80, 60), half: int = 35) -> np.ndarray:
    """A textured square that turns before a black sky, (120, 160, 3) uint8."""
    rng = np.random.default_rng(seed)
    patch = cv2.resize(rng.integers(40, 255, (24, 24, 3), dtype=np.uint8), (2 * half, 2 * half), interpolation=0)
    out = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    out[place[1] - half : place[1] + half, place[0] - half : place[0] + half] = patch
    return cv2.warpAffine(out, cv2.getRotationMatrix2D(place, angle, 1.0), SIZE)


def grey(level: int) -> np.ndarray:
    return np.full((SIZE[1], SIZE[0], 3), level, np.uint8)


def folder(place: Path, images: list[np.ndarray], ending: str = "png") -> Path:
    place.mkdir(parents=True)
    for i, image in enumerate(images):
        cv2.imwrite(str(place / f"{i:02d}.{ending}"), image)
    return place


def video(path: Path, images: list[np.ndarray]) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(25))
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for image in images:
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def turning(n: int = 8) -> list[np.ndarray]:
    return [view(7.0 * i) for i in range(n)]


def noisy(image: np.ndarray, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, 2, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def blurred(sigma: float) -> list[np.ndarray]:
    return [cv2.GaussianBlur(image, (0, 0), sigma) for image in turning()]


def text_named_mp4(t: Path) -> Path:
    (t / "v.mp4").write_text("not a video " * 100)
    return t / "v.mp4"


def empty_video(t: Path) -> Path:
    (t / "v.mp4").touch()
    return t / "v.mp4"


def truncated_video(t: Path) -> Path:
    whole = video(t / "whole.mp4", turning()).read_bytes()
    (t / "v.mp4").write_bytes(whole[: len(whole) // 2])
    return t / "v.mp4"


def damaged_photographs(t: Path) -> Path:
    """Two of eight are whole; one damaged file alone would be left out with a warning."""
    place = folder(t / "f", turning(), "jpg")
    for file in sorted(place.iterdir())[2:]:
        file.write_bytes(file.read_bytes()[:40])
    return place


def panoramas(t: Path) -> Path:
    return folder(t / "f", [np.hstack([image] * 3) for image in turning()])


def still_body(t: Path) -> Path:
    return folder(t / "f", [noisy(view(0), i) for i in range(8)])


def drifting_body(t: Path) -> Path:
    """It moves across the sky without turning: no parallax in it."""
    return folder(t / "f", [noisy(view(0, place=(50 + 8 * i, 60), half=30), i) for i in range(8)])


def mixed_masks(t: Path, mask: Callable[[int], np.ndarray | None]) -> tuple[Path, Path]:
    place, masks = folder(t / "f", turning()), t / "m"
    masks.mkdir()
    for i, file in enumerate(sorted(place.iterdir())):
        content = mask(i)
        if content is not None:
            cv2.imwrite(str(masks / f"{file.name}.png"), content)
    return place, masks


BAD_FOOTAGE: dict[str, tuple[Callable[[Path], Path], int, tuple[str, ...]]] = {
    "missing": (lambda t: t / "no.mp4", 2, ("no such file", "give a video")),
    "empty video": (empty_video, 2, ("empty", "copy it again")),
    "truncated video": (truncated_video, 2, ("not a video that can be read", "give MP4")),
    "text named mp4": (text_named_mp4, 2, ("not a video", "give MP4")),
    "empty folder": (lambda t: folder(t / "f", []), 2, ("no images here", "give a video")),
    "two photographs": (lambda t: folder(t / "f", turning(2)), 2, ("2 images are too few", "take at least 20")),
    "damaged photographs": (damaged_photographs, 2, ("2 of 8 images can be used", "02.jpg", "copy the images again")),
    "panoramas": (panoramas, 2, ("0 of 8 images can be used", "00.png (a panorama, 480x120")),
    "black": (lambda t: folder(t / "f", [grey(0)] * 6), 2, ("all frames are black", "light the object")),
    "white": (lambda t: folder(t / "f", [grey(255)] * 6), 2, ("all frames are white", "expose less")),
    "identical": (lambda t: folder(t / "f", [view(0)] * 6), 2, ("the same picture", "must move")),
    "identical video": (lambda t: video(t / "v.mp4", [view(0)] * 9), 2, ("the same picture",)),
    "still body": (still_body, 3, ("make sure that the body turns",)),
    "blurred": (lambda t: folder(t / "f", blurred(14)), 2, ("every frame is blurred", "focus")),
    "blurred less": (lambda t: folder(t / "f", blurred(9)), 3, ("enough texture", "sharper")),
    "drifting body": (drifting_body, 3, ("turn",)),
}


@pytest.mark.parametrize("case", BAD_FOOTAGE)
def test_bad_footage(tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str) -> None:
    build, code, says = BAD_FOOTAGE[case]
    said = massprops(capfd, "reconstruct", build(tmp_path), "-o", tmp_path / "run", "-q", "--json")
    assert_one_line(said, code, *says)


def mask_of(level: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    return np.full((size[1], size[0]), level, np.uint8)


BAD_MASKS: dict[str, tuple[Callable[[int], np.ndarray | None], tuple[str, ...]]] = {
    "wrong size": (lambda i: mask_of(255, (80, 60)), ("mask is 80x60, its image 160x120", "must agree")),
    "none of the object": (lambda i: mask_of(0 if i > 1 else 255), ("6 of 8 masks", "02.png", "none of the object")),
    "missing": (lambda i: None if i == 3 else mask_of(255), ("no mask for 1 of 8 images", "expected names like")),
    "no mask at all": (lambda i: None, ("no mask for 8 of 8 images", "expected names like 00.png.png")),
}


@pytest.mark.parametrize("case", BAD_MASKS)
def test_bad_masks(tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str) -> None:
    build, says = BAD_MASKS[case]
    footage, masks = mixed_masks(tmp_path, build)
    said = massprops(capfd, "reconstruct", footage, "-o", tmp_path / "run", "-q", "--masks", masks)
    assert_one_line(said, 2, *says)


def test_several_objects(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    both = [np.maximum(view(7.0 * i, 1, (30, 60), 20), view(-9.0 * i, 2, (130, 60), 20)) for i in range(8)]
    said = massprops(capfd, "reconstruct", folder(tmp_path / "f", both), "-o", tmp_path / "run", "-q")
    assert_one_line(said, 2, "several objects are in view", "crop to one")


OPTIONS = {
    "--frames 2": "3 to 5000",
    "--max-size 10": "160 to 8000",
    "--focal 1": "10 to 1e+06",
    "--dense-views -1": "0 to 2000",
    "--density 0": "1e-06 to 1e+09",
    "--density nan": "1e-06 to 1e+09",
    "--scale 0": "1e-09 to 1e+09",
    "--scale inf": "1e-09 to 1e+09",
    "--scale-sigma 0.9": "0 to 0.5",
    "--threads -2": "0 to 1024",
    "--seed -1": "0 to 2",
    "--motion sideways": "auto, tumbling, static",
    "--mapper best": "incremental, global",
    "--masks nowhere": "no such folder",
    "--sparse nowhere": "no such folder",
    "--sparse f": "no COLMAP model",
    "--distance 0,0,0 1,0,0 -2": "above 0",
    "--distance 0,0,0 1,0,0 nan": "above 0",
    "--distance 0,0 1,0,0 2": "x,y,z",
    "--distance nose 0,0,0 2": "nose",
    "--distance 1,2,3 1,2,3 2": "same point",
    "--marker 4X4_50": "DICTIONARY:SIDE_METRES",
    "--marker 9X9_50:0.1": "unknown dictionary",
    "--marker 4X4_50:-1": "above 0",
    "--frames many": "--frames",
    "--nonsense": "--nonsense",
}


@pytest.mark.parametrize("text", OPTIONS)
def test_an_option_out_of_range_is_told_before_any_work(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    footage = folder(tmp_path / "f", turning(3))
    said = massprops(capfd, "reconstruct", footage, "-o", tmp_path / "run", *text.split())
    assert_one_line(said, 2, OPTIONS[text])
    assert not (tmp_path / "run" / "work" / "capture.log").exists()


def test_a_place_that_is_no_folder(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    footage = folder(tmp_path / "f", turning(3))
    (tmp_path / "file").write_text("x")
    for out in (tmp_path / "file", footage, footage / "run", tmp_path / "file" / "run"):
        said = massprops(capfd, "reconstruct", footage, "-o", out, "-q")
        assert_one_line(said, 2, str(out), "-o")


def on_a_small_disk(place: Path, kilobytes: int, *arguments: object) -> Said:
    """`massprops ARGUMENTS` with a file system of that size at `place`, which only the command sees."""
    place.mkdir()
    inner = f'mount -t tmpfs -o size={kilobytes}k none "{place}" && exec "$@"'
    code = "from massprops_cli.main import main; main()"
    command = ["unshare", "-rm", "sh", "-c", inner, "sh", sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return Said(done.returncode, done.stdout, done.stderr)


@pytest.mark.parametrize(
    ("kilobytes", "what"), [(40, "reconstruct"), (700, "reconstruct"), (40, "mass"), (4, "export"), (8, "simulate")]
)
def test_a_full_disk(tmp_path: Path, kilobytes: int, what: str) -> None:
    if subprocess.run(["unshare", "-rm", "true"], capture_output=True, check=False).returncode:
        pytest.skip("no user name spaces here, so no small disk can be made")
    disk = tmp_path / "disk"
    arguments = {
        "reconstruct": (folder(tmp_path / "f", turning()), "-q"),
        "mass": (SAMPLE,),
        "export": (SAMPLE, "--to", "urdf"),
        "simulate": ("tracks", "-q"),
    }[what]
    said = on_a_small_disk(disk, kilobytes, what, *arguments, "-o", disk / "out")
    assert_one_line(said, 2, str(disk), "choose another")


def test_no_permission_to_write(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    if os.geteuid() == 0:
        place = Path("/proc/run")  # not even root can make a folder there
    else:
        place = tmp_path / "closed" / "run"
        place.parent.mkdir(mode=0o500)
    trimesh.creation.box().export(tmp_path / "box.stl")
    box = tmp_path / "box.stl"
    for arguments in (
        ("reconstruct", folder(tmp_path / "f", turning(3)), "-q"),
        ("mass", box),
        ("simulate", "tracks", "-q"),
        ("compare", box, box),
    ):
        assert_one_line(massprops(capfd, *arguments, "-o", place), 2, str(place), "choose another")
    for form in ("urdf", "json"):
        out = place / "file"
        assert_one_line(massprops(capfd, "export", box, "--to", form, "-o", out), 2, str(place), "choose another")
