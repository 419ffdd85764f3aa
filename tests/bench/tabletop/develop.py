"""From rendered frames to what a phone would have stored: lens, exposure, noise, JPEG with EXIF or H.264."""

from __future__ import annotations

import os
from datetime import datetime, timedelta
from pathlib import Path

import av
import cv2
import numpy as np
from PIL import Image
from scipy.ndimage import map_coordinates

from tabletop.prepare import FPS, MARGIN
from tabletop.scenes import Scene

UNDER = 4.0
"""What the renderer took off (two stops), so that highlights keep their detail."""
BEGIN = datetime(2026, 11, 15, 10, 12, 0)
"""Clock of the first photograph."""


def linear(v: np.ndarray) -> np.ndarray:
    """Light of sRGB values from 0 to 1, in units of display white."""
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def rendered_light(work: Path, number: int) -> np.ndarray:
    """(h, w, 3) float32 light of a rendered frame, BGR, in units of display white.

    Raises:
        FileNotFoundError: it has not been rendered.
    """
    picture = _rendered(work, number)
    light = UNDER * linear(picture[..., :3])
    return light * picture[..., 3:] if picture.shape[2] == 4 else light


def rendered_coverage(work: Path, number: int) -> np.ndarray:
    """(h, w) float32 share of each pixel of a frame that was rendered with `coverage` that shows a body.

    Raises:
        FileNotFoundError: it has not been rendered.
    """
    return _rendered(work, number)[..., 3]


def _rendered(work: Path, number: int) -> np.ndarray:
    path = work / "frames" / f"{number:06d}.png"
    if not path.is_file():
        raise FileNotFoundError(path)
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float32) / 65535


def display(light: np.ndarray) -> np.ndarray:
    """uint8 sRGB; from 0.8 of white a soft shoulder, as cameras have."""
    v = np.clip(light, 0, None)
    v = np.where(v > 0.8, 0.8 + 0.2 * (1 - np.exp(-(v - 0.8) / 0.2)), v)
    return np.rint(255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)).astype(np.uint8)


def distort(image: np.ndarray, K: np.ndarray, k1: float, size: tuple[int, int]) -> np.ndarray:
    """The picture of a lens with radial k1, taken from the wider pinhole picture.

    Args:
        image: (h + 2 MARGIN, w + 2 MARGIN, 3).
        K: (3, 3) of the final picture, pixel centres at halves.
        k1: of OpenCV's model.
        size: width and height of the final picture.
    """
    width, height = size
    x, y = np.meshgrid((np.arange(width) + 0.5 - K[0, 2]) / K[0, 0], (np.arange(height) + 0.5 - K[1, 2]) / K[1, 1])
    reach = np.hypot(x, y)
    straight = reach.copy()
    for _ in range(20):
        straight = reach / (1 + k1 * straight**2)
    factor = np.divide(straight, reach, out=np.ones_like(reach), where=reach > 1e-12)
    u = K[0, 0] * x * factor + K[0, 2] + MARGIN - 0.5
    v = K[1, 1] * y * factor + K[1, 2] + MARGIN - 0.5
    # OpenCV's remap rounds coordinates to a fraction of a pixel, which moved points by up to 0.05 px
    layers = [map_coordinates(image[..., c], [v, u], order=3, mode="nearest") for c in range(3)]
    return np.stack(layers, axis=-1)


def develop(scene: Scene, folder: Path) -> None:
    """Writes `photos/` or `cam0.mp4`, then `truth.npz`.

    Raises:
        FileNotFoundError: a frame has not been rendered.
    """
    work = folder / "work"
    with np.load(work / "truth.npz", allow_pickle=False) as z:
        truth = {k: z[k] for k in z.files}
    rng = np.random.default_rng([scene.number, 7])
    count = len(truth["poses"])
    size = tuple(int(s) for s in truth["size"][0])
    exposure, tint = drift(rng, count, 0.07), np.column_stack([drift(rng, count, 0.015) for _ in range(3)])
    images, gain = [], 0.0
    for i in range(count):
        light = distort(rendered_light(work, i), truth["K"], float(truth["distortion"][0]), size)
        gain = gain or 0.30 / float(np.percentile(light.mean(2), 60))
        light = np.clip(light * gain * exposure[i] * tint[i], 0, None)
        light += sensor_noise(light, rng)
        images.append(display(light))
    if scene.images == "photos":
        truth["names"] = np.array(_photographs(scene, folder, images, truth))
    else:
        write_video(folder / "cam0.mp4", images, 17)
    np.savez(work / "finished.npz", **truth)
    (work / "finished.npz").replace(folder / "truth.npz")


def sensor_noise(light: np.ndarray, rng: np.random.Generator, times: float = 1.0) -> np.ndarray:
    """Noise of photons and of reading; `times` its usual deviation, that of a phone in a lit room."""
    return times * np.sqrt(0.00015 * light + 2e-6) * rng.standard_normal(light.shape)


def drift(rng: np.random.Generator, count: int, size: float) -> np.ndarray:
    """(count,) smooth factors about 1."""
    steps = np.cumsum(rng.standard_normal(count + 1))
    smooth = np.convolve(np.pad(steps, 4, mode="edge"), np.ones(9) / 9, mode="valid")[:count]
    smooth = smooth - smooth.mean()
    return np.exp(size * smooth / max(smooth.std(), 1e-9))


def _photographs(scene: Scene, folder: Path, images: list[np.ndarray], truth: dict[str, np.ndarray]) -> list[str]:
    photos = folder / "photos"
    photos.mkdir(exist_ok=True)
    equivalent = int(truth["focal_35mm"])
    names = []
    for image, seconds in zip(images, truth["t"], strict=True):
        taken = BEGIN + timedelta(days=scene.number, seconds=float(seconds))
        names.append(f"IMG_{taken:%Y%m%d_%H%M%S}.jpg")
        exif = Image.Exif()
        exif[271], exif[272], exif[306] = "Acme", "Phone 3", f"{taken:%Y:%m:%d %H:%M:%S}"
        inner = exif.get_ifd(0x8769)
        inner[37386], inner[41989], inner[36867] = equivalent / 6.1, equivalent, f"{taken:%Y:%m:%d %H:%M:%S}"
        temporary = photos / f"{names[-1]}.{os.getpid()}.tmp"
        Image.fromarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)).save(temporary, "JPEG", quality=91, exif=exif)
        temporary.replace(photos / names[-1])
    return names


def write_video(path: Path, images: list[np.ndarray], crf: int) -> None:
    """H.264 of (h, w, 3) uint8 BGR images at `FPS`; `crf`: 17 is good, 36 poor."""
    temporary = path.with_name(f"{path.stem}.{os.getpid()}.tmp.mp4")
    with av.open(str(temporary), "w") as container:
        stream = container.add_stream("libx264", rate=FPS)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt, stream.options = "yuv420p", {"crf": str(crf)}
        for image in images:
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    temporary.replace(path)
