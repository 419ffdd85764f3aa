"""How a body tumbles and is filmed: free rotation before a still camera, one hard Sun, a black sky.

Bodies with an even number are for development; **those with an odd number are held out** and not looked at until the
end. `poor.POOR` names what can be wrong with the footage.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from backdrop import stars_and_limb
from tabletop import textures
from tabletop.develop import display, linear, rendered_coverage, rendered_light, sensor_noise, write_video
from tabletop.prepare import FPS, write_pictures, write_scene
from tabletop.truth import truth_arrays

from massprops.dynamics.quaternion import (
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    normalise,
    rotation_matrix,
)
from massprops.dynamics.rigid_body import propagate
from massprops.sequence.data import AttitudeSeries, Camera, Sequence
from massprops.sequence.write import write_sequence
from tumbling_footage.bodies import KINDS, Body, make_body
from tumbling_footage.poor import POOR, Poor

SEED = 20261123
"""Of every draw: body number k of kind number j uses the generator (SEED, j, k)."""

SENSORS = ("attitudes", "stereo")
"""A sequence folder in place of a video: with the attitude of each image, or with a second camera beside the first."""
ATTITUDE_SIGMA = 0.1
"""Of given attitudes, per axis [degree]."""
BASELINE = 0.1
"""Between the two cameras, over the body's distance."""

RATE = 5.0
"""Turn between two frames [degree]."""
SECONDS = 0.4
"""Between two frames, as `develop.FPS` plays them [s]."""
LEAST_ASPECT = 30.0
"""Angle between the angular momentum and the line of sight [degree]: a body that turns about the line of sight shows one
side, whatever its surface."""
WINDOW_MARGIN = 16.0
"""Black sky drawn about the body, for the camera's and the denoiser's filters [px]."""
SUN = {"sun": 0.0093, "watts": 14.0, "warm": 0.0}
"""The Sun's angle [rad] and strength, at which white in full light is display white less a third."""


@dataclass(frozen=True, kw_only=True)
class Footage:
    """One body, what is wrong with its footage and what else is known: `poor` is one of `POOR`, `sensors` empty or one of
    `SENSORS`; `frames` is for all but few."""

    kind: str
    number: int
    poor: str = ""
    sensors: str = ""
    frames: int = 88

    @property
    def name(self) -> str:
        """Of its folder."""
        half = "held" if self.number % 2 else "dev"
        return "_".join(word for word in (self.kind, f"{self.number:02d}", half, self.poor, self.sensors) if word)

    @property
    def held_out(self) -> bool:
        """Not looked at until the end."""
        return self.number % 2 == 1

    @property
    def how(self) -> Poor:
        """How it is filmed."""
        return POOR[self.poor]

    @property
    def count(self) -> int:
        """Frames."""
        return self.how.frames or self.frames

    def generator(self) -> np.random.Generator:
        """The body's own random numbers; the same for poor footage of it."""
        return np.random.default_rng([SEED, list(KINDS).index(self.kind), self.number])


def prepare(footage: Footage, folder: Path) -> None:
    """Writes what the renderer reads, the truth and the CAD."""
    work = folder / "work"
    work.mkdir(parents=True, exist_ok=True)
    rng = footage.generator()
    body = make_body(footage.kind, rng)
    rates, shutter = _motion(footage, rng, body.mesh)
    width, height = footage.how.size
    focal = 1.45 * width
    radius = float(np.linalg.norm(body.mesh.vertices - body.mesh.center_mass, axis=1).max())
    distance = radius * focal / (0.44 * height)
    cameras = [np.eye(4)]
    if footage.sensors == "stereo":
        cameras.append(np.eye(4))
        cameras[1][0, 3] = BASELINE * distance
    away = distance * np.linspace(1.0, footage.how.farther, footage.count)
    moved = [_seen(p, body.mesh.center_mass, z) for p, z in zip(shutter, away, strict=True)]
    angle, side = np.radians(rng.uniform(20, 60)), rng.uniform(0, 2 * np.pi)
    sun = [np.sin(angle) * np.cos(side), np.sin(angle) * np.sin(side), -np.cos(angle)]
    pictures, looks = _surfaces(body, rng)
    drawn = trimesh.util.concatenate([m for m, _ in body.solids])
    part = np.repeat(np.arange(len(looks)), [len(m.faces) for m, _ in body.solids])
    document = {
        "size": [width, height],
        "focal": focal,
        "samples": 16,
        "rolling": footage.how.rows_deg > 0,
        "coverage": footage.how.sky,
        "body": looks,
        "things": [],
        "lights": [{**SUN, "at": sun}],
        "ambient": {"strength": 0.0, "warm": 0.0},
        "frames": [_frame(drawn.vertices, camera, m, focal, footage.how.size) for camera in cameras for m in moved],
    }
    write_pictures(work, pictures)
    np.savez(work / "body.npz", vertices=drawn.vertices, faces=drawn.faces, part=part)
    body.mesh.export(folder / "cad.ply")
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    clock = SECONDS * np.arange(footage.count)
    middle = np.stack([m[1] for m in moved])
    arrays = truth_arrays(
        body.mesh, middle, np.stack([cameras[0]] * footage.count), K, footage.how.size, clock, w=rates
    )
    np.savez(work / "truth.npz", **arrays)
    write_scene(work, document)


def _motion(footage: Footage, rng: np.random.Generator, mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Body rates (n, 3) [rad/s] at the frames, and rotations body -> camera (n, 3, 3, 3) through each exposure."""
    inertia = np.asarray(mesh.moment_inertia)
    axes = np.linalg.eigh(inertia)[1]
    # near the middle axis, where the motion turns over and shows all sides
    direction = np.array(
        [rng.choice([-1, 1]) * rng.uniform(0.15, 0.45), 1.0, rng.choice([-1, 1]) * rng.uniform(0.15, 0.45)]
    )
    how = footage.how
    step = np.radians(360.0 / how.frames if how.frames else RATE)
    w0 = axes @ direction / np.linalg.norm(direction) * step / SECONDS
    start = normalise(rng.standard_normal(4))
    momentum = inertia @ w0 / np.linalg.norm(inertia @ w0)
    while abs(float((rotation_matrix(start) @ momentum)[2])) > np.cos(np.radians(LEAST_ASPECT)):
        start = normalise(rng.standard_normal(4))
    half = 0.5 * np.radians(how.rows_deg or how.open_deg) / (step / SECONDS)
    times = (SECONDS * np.arange(footage.count)[:, None] + [-half, 0.0, half]).ravel()
    q, w = propagate(start, w0, inertia, times, largest_turn=0.02)
    return w[1::3], rotation_matrix(q).reshape(-1, 3, 3, 3)


def _seen(turns: np.ndarray, centre: np.ndarray, distance: float) -> list[np.ndarray]:
    """(4, 4) CAD axes -> camera for each rotation (k, 3, 3) about the centre of mass."""
    out = []
    for R in turns:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R, np.array([0, 0, distance]) - R @ centre
        out.append(pose)
    return out


def _frame(
    vertices: np.ndarray, camera: np.ndarray, poses: list[np.ndarray], focal: float, size: tuple[int, int]
) -> dict[str, Any]:
    """One image of a still camera, as the renderer reads it. Its `window` is what the body fills while the shutter is open: left, bottom,
    right, top, as fractions. Outside it is black sky, which needs no rays.
    """
    seen = np.concatenate([vertices @ p[:3, :3].T + p[:3, 3] - camera[:3, 3] for p in poses])
    pixels = focal * seen[:, :2] / seen[:, 2:]
    low, high = pixels.min(0) - WINDOW_MARGIN, pixels.max(0) + WINDOW_MARGIN
    edges = np.array([low[0], -high[1], high[0], -low[1]]) / [*size, *size] + 0.5
    window = np.clip(edges, 0.0, 1.0).tolist()
    return {"camera": [camera.tolist()] * 3, "body": np.stack(poses).tolist(), "window": window}


def _surfaces(body: Body, rng: np.random.Generator) -> tuple[dict[str, np.ndarray], list[dict[str, Any]]]:
    """Pictures by name, drawn once a kind so that repeated cells are the same, and a surface for each solid."""
    pictures: dict[str, np.ndarray] = {}
    for _, look in body.solids:
        if look["picture"] not in pictures:
            pictures[look["picture"]] = getattr(textures, look["picture"])(rng)
    return pictures, [dict(look) for _, look in body.solids]


def develop(footage: Footage, folder: Path) -> None:
    """Writes `cam0.mp4`, `photos/` of few images or `sequence/` with what else is known, then `truth.npz`.

    Raises:
        FileNotFoundError: a frame has not been rendered.
    """
    work = folder / "work"
    with np.load(work / "truth.npz", allow_pickle=False) as z:
        truth = {k: z[k] for k in z.files}
    document = json.loads((work / "scene.json").read_text())
    images = images_of(footage, work, len(document["frames"]))
    if footage.how.frames:
        (folder / "photos").mkdir(exist_ok=True)
        truth["names"] = np.array([f"{i:03d}.png" for i in range(footage.count)])
        for name, image in zip(truth["names"], images, strict=True):
            cv2.imwrite(str(folder / "photos" / str(name)), image)
    elif footage.sensors:
        _sequence(footage, folder / "sequence", images, truth, document)
    else:
        write_video(folder / "cam0.mp4", images, footage.how.crf)
    np.savez(work / "finished.npz", **truth)
    (work / "finished.npz").replace(folder / "truth.npz")


def images_of(footage: Footage, work: Path, count: int) -> list[np.ndarray]:
    """What the camera makes of the rendered light of the first `count` frames in a folder: (h, w, 3) uint8 each, BGR."""
    rng = np.random.default_rng([SEED, footage.number, 7])
    lights = [rendered_light(work, i) for i in range(count)]
    bright = np.concatenate([light.mean(2)[light.mean(2) > 0.02][::50] for light in lights])
    gain = 0.35 / float(np.median(bright))
    how = footage.how
    sky = stars_and_limb(how.size, footage.number) if how.sky else None
    images = []
    for i, light in enumerate(lights):
        shadow = 0.002 if how.dark and (i // how.dark) % 2 else 1.0
        seen = np.clip(light * gain * shadow, 0, None)
        if sky is not None:
            behind = sky(i, np.zeros(how.size[::-1], np.float32))
            seen += (1 - rendered_coverage(work, i))[..., None] * linear(behind / 255)[..., None]
        images.append(display(seen + sensor_noise(seen, rng, how.noise)))
    return images


def _sequence(
    footage: Footage, folder: Path, images: list[np.ndarray], truth: dict[str, np.ndarray], document: dict[str, Any]
) -> None:
    """A sequence folder: a video for each camera, and what else is known."""
    K, clock = truth["K"], np.rint(np.arange(footage.count) * 1e9 / float(FPS)).astype(np.int64)
    intrinsics = np.array([K[0, 0], K[1, 1], K[0, 2] - 0.5, K[1, 2] - 0.5])
    cameras = {}
    for number, first in enumerate(range(0, len(images), footage.count)):
        camera = folder / f"cam{number}"
        camera.mkdir(parents=True, exist_ok=True)
        write_video(camera / "video.mp4", images[first : first + footage.count], 17)
        mount = np.array(document["frames"][first]["camera"][1])
        cameras[number] = Camera(resolution=footage.how.size, intrinsics=intrinsics, T_BS=mount)
    attitude = None
    if footage.sensors == "attitudes":
        sigma = np.radians(ATTITUDE_SIGMA)
        noise = sigma * np.random.default_rng([SEED, footage.number, 9]).standard_normal((footage.count, 3))
        q = multiply(from_rotation_vector(noise), from_rotation_matrix(truth["poses"][:, :, :3]))
        attitude = AttitudeSeries(clock, q, np.full(footage.count, sigma))
    write_sequence(folder, Sequence(cameras=cameras, attitude=attitude))
