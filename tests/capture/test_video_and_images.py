"""Footage in: clocks, rotation, EXIF, and what bad footage gets."""

from __future__ import annotations

import struct
import zlib
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from massprops.capture.footage import (
    BLURRED,
    choose_all,
    choose_frames,
    full_frames,
    judge_frames,
    open_sources,
    refuse_useless,
    stored_frames,
)
from massprops.capture.images import inspect, list_images, plain_png, png_size
from massprops.capture.keyframes import choose, edge_width, sharpness
from massprops.capture.video import read_video
from massprops.errors import InputError, NotPossible


def scene(angle: float, size: tuple[int, int] = (160, 120), seed: int = 0) -> np.ndarray:
    """A textured square that turns before a black sky."""
    rng = np.random.default_rng(seed)
    patch = cv2.resize(rng.integers(40, 255, (24, 24, 3), dtype=np.uint8), (70, 70), interpolation=cv2.INTER_NEAREST)
    out = np.zeros((size[1], size[0], 3), np.uint8)
    out[25:95, 45:115] = patch
    turn = cv2.getRotationMatrix2D((80, 60), angle, 1.0)
    return cv2.warpAffine(out, turn, size)


def write_video(path: Path, images: list[np.ndarray], stamps: list[int] | None = None) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = images[0].shape[1], images[0].shape[0], "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.options = {"crf": "10"}
        for i, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = (stamps[i] if stamps else 40 * i), Fraction(1, 1000)
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def turn_header(path: Path) -> None:
    """Sets the display matrix of an MP4 to a quarter turn clockwise, as a phone held upright does."""
    data = bytearray(path.read_bytes())
    at = data.find(b"tkhd")
    place = at + 4 + 4 + 4 * 5 + 8 + 8
    matrix = np.array([0, 1 << 16, 0, -(1 << 16), 0, 0, 0, 0, 1 << 30], dtype=">i4")
    data[place : place + 36] = matrix.tobytes()
    path.write_bytes(bytes(data))


def test_true_timestamps_of_a_variable_rate(tmp_path: Path) -> None:
    stamps = [0, 40, 95, 300, 310, 1000]
    video = write_video(tmp_path / "v.mp4", [scene(5 * i) for i in range(6)], stamps)
    found = [f.timestamp_ns for f in read_video(video)]
    assert np.allclose(np.diff(found), np.diff(stamps) * 1e6, atol=1e5)


def test_rotation_flag_is_honoured(tmp_path: Path) -> None:
    image = np.zeros((120, 160, 3), np.uint8)
    image[:40, :40] = 255  # top left as stored
    video = write_video(tmp_path / "v.mp4", [image] * 3)
    turn_header(video)
    shown = next(iter(read_video(video))).image
    assert shown.shape[:2] == (160, 120)
    assert shown[:35, 85:].mean() > 200 > 50 > shown[125:, :].mean(), "a clockwise turn brings top left to top right"


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "empty"), (b"just some text\n" * 50, "not a video"), (None, "no such file")],
)
def test_files_that_are_no_video(tmp_path: Path, content: bytes | None, says: str) -> None:
    path = tmp_path / "v.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        list(read_video(path))


def test_truncated_video(tmp_path: Path) -> None:
    path = write_video(tmp_path / "v.mp4", [scene(5 * i) for i in range(30)])
    path.write_bytes(path.read_bytes()[:900])
    with pytest.raises(InputError, match=r"v\.mp4"):
        list(read_video(path))


def folder_of(tmp_path: Path, images: list[np.ndarray], suffix: str = ".png") -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    for i, image in enumerate(images):
        cv2.imwrite(str(folder / f"im{i}{suffix}"), image)
    return folder


def test_exif_focal_and_orientation(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    exif = Image.Exif()
    exif[0x0112] = 6
    exif.get_ifd(0x8769)[0xA405] = 28
    Image.fromarray(np.zeros((120, 160, 3), np.uint8)).save(path, exif=exif)
    photo = inspect(path)
    assert photo.size == (120, 160)
    # the equivalent compares diagonals: 200 px here, 43.27 mm on film
    assert photo.focal_px == pytest.approx(28 / 43.267 * 200, rel=1e-4)


def test_exif_behind_the_pixels_of_a_png(tmp_path: Path) -> None:
    """Where no pixel is decoded it has to be looked for there."""
    exif = Image.Exif()
    exif[0x0112] = 1
    exif.get_ifd(0x8769)[0xA405] = 28
    before, behind, without = (tmp_path / f"{name}.png" for name in ("before", "behind", "without"))
    pixels = Image.fromarray(np.zeros((120, 160, 3), np.uint8))
    pixels.save(before, exif=exif)
    pixels.save(without)
    content = before.read_bytes()
    begin = content.index(b"eXIf") - 4
    end = begin + 12 + int.from_bytes(content[begin : begin + 4], "big")
    last = content.index(b"IEND") - 4
    behind.write_bytes(content[:begin] + content[end:last] + content[begin:end] + content[last:])
    focal = [inspect(path).focal_px for path in (before, behind, without)]
    assert focal[0] is not None and focal == [focal[0], focal[0], None]


def test_natural_order_and_mixed_formats(tmp_path: Path) -> None:
    for name in ("im10.png", "im2.jpg", "im1.PNG", "notes.txt"):
        cv2.imwrite(str(tmp_path / name), scene(0)) if not name.endswith("txt") else (tmp_path / name).write_text("x")
    assert [p.name for p in list_images(tmp_path)] == ["im1.PNG", "im2.jpg", "im10.png"]


def test_photograph_folders_that_cannot_be_used(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match="no images"):
        open_sources(empty)
    folder = folder_of(tmp_path, [scene(0), scene(5)])
    with pytest.raises(InputError, match="2 images are too few"):
        open_sources(folder)
    (folder / "im2.png").write_text("broken")
    with pytest.raises(InputError, match=r"2 of 3 images can be used.*im2\.png \(not an image"):
        open_sources(folder)


@pytest.mark.parametrize(
    ("images", "says"),
    [
        ([np.zeros((120, 160, 3), np.uint8)] * 5, "black"),
        ([np.full((120, 160, 3), 255, np.uint8)] * 5, "white"),
        ([scene(10)] * 5, "same picture"),
        ([cv2.GaussianBlur(scene(9 * i), (0, 0), 12) for i in range(6)], "blurred"),
    ],
)
def test_useless_footage_is_named(tmp_path: Path, images: list[np.ndarray], says: str) -> None:
    source = open_sources(folder_of(tmp_path, images))[0]
    with pytest.raises(InputError, match=says):
        refuse_useless(judge_frames(source, lambda *_: None), "photos")


def test_good_footage_is_not_refused(tmp_path: Path) -> None:
    source = open_sources(folder_of(tmp_path, [scene(6 * i) for i in range(8)]))[0]
    judged = judge_frames(source, lambda *_: None)
    refuse_useless(judged, "photos")
    assert len(choose_frames(source, judged, 100).index) == 8


def test_video_frames_follow_the_motion_not_the_clock(tmp_path: Path) -> None:
    slow = [scene(0.2 * i) for i in range(30)]
    fast = [scene(6 + 4 * i) for i in range(15)]
    source = open_sources(write_video(tmp_path / "v.mp4", slow + fast))[0]
    chosen = choose_frames(source, judge_frames(source, lambda *_: None), 12)
    assert len(chosen.index) <= 12
    assert np.mean(chosen.index >= 30) > 0.6, "most of the turn happens in the last third"


def test_choice_prefers_sharp_frames() -> None:
    rng = np.random.default_rng(0)
    motion, sharp = np.full(200, 0.01), rng.uniform(0.8, 1.2, 200)
    sharp[50:53] = 0.1
    picked = choose(motion, sharp, 25)
    assert len(picked) <= 25 and not set(picked) & {50, 51, 52}
    assert np.all(np.diff(picked) > 0)


def test_a_still_video_gives_nothing_to_choose(tmp_path: Path) -> None:
    source = open_sources(write_video(tmp_path / "v.mp4", [scene(0)] * 8))[0]
    judged = judge_frames(source, lambda *_: None)
    with pytest.raises((NotPossible, InputError)):
        refuse_useless(judged, "v")
        choose_frames(source, judged, 6)


def test_sharpness_orders_blur() -> None:
    grey = cv2.cvtColor(scene(20), cv2.COLOR_BGR2GRAY)
    values = [sharpness(cv2.GaussianBlur(grey, (0, 0), s)) for s in (0.5, 2, 5)]
    assert values[0] > values[1] > values[2]


def plain(turn: float) -> np.ndarray:
    """A smooth body without any detail under one light, before a black sky; one side bulges."""
    v, u = np.mgrid[:120, :160]
    x, y = (u - 80) / (40 + 8 * np.cos(np.radians(turn))), (v - 60) / 40
    inside = x**2 + y**2 < 1
    light = np.clip(np.sqrt(np.clip(1 - x**2 - y**2, 0, 1)) + 0.5 * x, 0, 1.2)
    grey = cv2.GaussianBlur(np.where(inside, 30 + 150 * light, 0).astype(np.float32), (0, 0), 0.6)
    return np.repeat(grey[:, :, None], 3, 2).astype(np.uint8)


def test_a_plain_body_is_not_called_blurred(tmp_path: Path) -> None:
    source = open_sources(folder_of(tmp_path, [plain(20 * i) for i in range(8)]))[0]
    judged = judge_frames(source, lambda *_: None)
    assert np.median(judged.sharp) < BLURRED, "there is nothing fine in it"
    refuse_useless(judged, "photos")


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_edge_width_is_that_of_the_blur(noise: float) -> None:
    rng = np.random.default_rng(0)
    wide = []
    for sigma in (0.5, 2.0, 4.0, 6.0):
        grey = cv2.GaussianBlur(plain(0)[:, :, 0].astype(np.float32), (0, 0), sigma)
        wide.append(edge_width(np.clip(grey + rng.normal(0, noise, grey.shape), 0, 255).astype(np.uint8)))
    assert wide == sorted(wide)
    assert wide[0] < 2 and abs(wide[2] - 4.2) < 1.0 and wide[3] > 4.5
    assert edge_width(np.zeros((60, 80), np.uint8)) == 0.0


def test_frames_from_python(tmp_path: Path) -> None:
    """A phone's video, turned and with a variable rate: upright frames with their own times."""
    from massprops.capture import read_frames

    stamps = [0, 40, 95, 300, 310, 500, 640, 1000]
    video = write_video(tmp_path / "v.mp4", [scene(9 * i) for i in range(8)], stamps)
    turn_header(video)
    frames = list(read_frames(video, most=5, longest=80))
    assert 3 <= len(frames) <= 5 and all(f.image.shape == (80, 60, 3) and f.camera == 0 for f in frames)
    assert all(abs(f.timestamp_ns * 1e-6 - stamps[f.index]) < 0.2 for f in frames)
    assert [f.index for f in frames] == sorted(f.index for f in frames)
    nothing = tmp_path / "nothing"
    nothing.mkdir()
    with pytest.raises(InputError, match="no images here.*; give a video"):
        next(read_frames(nothing))


def test_images_in_the_one_folder_within_are_found(tmp_path: Path) -> None:
    from massprops.capture.frames import read_frames

    for folder in ("day one", "day two"):
        (tmp_path / folder).mkdir()
        for k in range(3):
            Image.fromarray(scene(9 * k)).save(tmp_path / folder / f"{k}.png")
    with pytest.raises(InputError, match="give its folder day one, its folder day two, a video"):
        next(read_frames(tmp_path))
    (tmp_path / "day two").rename(tmp_path / ".hidden")
    assert len(list(read_frames(tmp_path))) == 3
    (tmp_path / ".hidden").rename(tmp_path / "images")
    source = open_sources(tmp_path)[0]
    assert [s.path.parent.name for s in source.images] == ["images"] * 3


def encoded(path: Path, codec: str, pixels: str, images: list[np.ndarray], stamps: list[int], **options: str) -> Path:
    """A small clip as phones write them; skips where this build of FFmpeg has no such encoder."""
    try:
        av.codec.Codec(codec, "w")
    except Exception:
        pytest.skip(f"no {codec} encoder in this build of PyAV")
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = images[0].shape[1], images[0].shape[0], pixels
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.options = options
        if codec == "libx265":
            stream.codec_context.codec_tag = "hvc1"
        for image, stamp in zip(images, stamps, strict=True):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format=pixels)
            frame.pts, frame.time_base = stamp, Fraction(1, 1000)
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


@pytest.mark.parametrize(
    ("name", "codec", "pixels"),
    [
        ("iphone.mov", "libx265", "yuv420p10le"),
        ("iphone.mov", "libx265", "yuv420p"),
        ("android.mp4", "libx265", "yuv420p10le"),
        ("android.mp4", "libx264", "yuv420p"),
        ("web.mkv", "libvpx-vp9", "yuv420p"),
    ],
)
def test_video_as_phones_write_it(tmp_path: Path, name: str, codec: str, pixels: str) -> None:
    """HEVC of 8 and 10 bits, variable rate, and a quarter turn in the header of MP4 and MOV."""
    stamps = [0, 33, 67, 100, 150, 233, 267, 300]
    size = (160, 120)
    images = [scene(9 * i, size) for i in range(8)]
    options = {"x265-params": "log-level=none", "crf": "8"} if codec == "libx265" else {"crf": "8"}
    video = encoded(tmp_path / name, codec, pixels, images, stamps, **options)
    turned = name.endswith(("mov", "mp4"))
    if turned:
        turn_header(video)
    source = open_sources(video)[0]
    assert source.cameras[0].size == ((120, 160) if turned else (160, 120))
    frames = list(read_video(video))
    assert [round(f.timestamp_ns / 1e6) for f in frames] == stamps
    for frame, image in zip(frames, images, strict=True):
        expected = np.rot90(image, -1) if turned else image
        assert frame.image.dtype == np.uint8 and frame.image.shape == expected.shape
        assert np.abs(frame.image.astype(int) - expected).mean() < 12


def test_only_a_png_of_just_these_pixels_is_copied(tmp_path: Path) -> None:
    image = scene(0.1)
    for name in ("a.png", "b.jpg"):
        cv2.imwrite(str(tmp_path / name), image)
    content = (tmp_path / "a.png").read_bytes()
    assert plain_png(tmp_path / "a.png") == plain_png(tmp_path / "a.png", image.shape[1]) == content
    assert png_size(content) == (image.shape[1], image.shape[0])
    assert plain_png(tmp_path / "a.png", image.shape[1] - 1) is None
    (tmp_path / "c.jpg").write_bytes(content)  # some readers go by the name
    assert plain_png(tmp_path / "b.jpg") is None and plain_png(tmp_path / "c.jpg") is None
    gamma = struct.pack(">I4sII", 4, b"gAMA", 45455, zlib.crc32(struct.pack(">4sI", b"gAMA", 45455)))
    for number, other in enumerate(
        (content[:33] + gamma + content[33:], content[:-6], content + b"more", content[:20])
    ):
        (tmp_path / f"{number}.png").write_bytes(other)
        assert plain_png(tmp_path / f"{number}.png") is None
    cv2.imwrite(str(tmp_path / "grey.png"), image[..., 0])
    grey = (tmp_path / "grey.png").read_bytes()
    assert plain_png(tmp_path / "grey.png") == grey and len(grey) < len(content)
    deep = image.astype(np.uint16) * 257
    others = {"deep": deep, "deep grey": deep[..., 0], "clear": np.dstack([image, image[..., :1]])}
    for other_name, pixels in others.items():
        cv2.imwrite(str(tmp_path / f"{other_name}.png"), pixels)
        assert plain_png(tmp_path / f"{other_name}.png") is None


def test_stored_frames_are_those_that_are_shown(tmp_path: Path) -> None:
    images = [scene(0.1 * k) for k in range(4)]
    for k, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"{k}{'.jpg' if k == 3 else '.png'}"), image)
    (source,) = open_sources(tmp_path, None)
    (chosen,) = choose_all([source], [judge_frames(source, lambda *_: None)], 10)
    kept = list(stored_frames(source, chosen, 10_000))
    assert [type(content) is bytes for _, _, content in kept] == [True, True, True, False]
    for (_, name, shown), (_, other_name, content) in zip(full_frames(source, chosen, 10_000), kept, strict=True):
        decoded = cv2.imdecode(np.frombuffer(content, np.uint8), 1) if isinstance(content, bytes) else content
        assert name == other_name and (decoded == shown).all()
    assert not any(isinstance(content, bytes) for _, _, content in stored_frames(source, chosen, 100))
