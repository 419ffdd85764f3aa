"""Turns a scene's description into what the renderer reads, and into its truth.

A scene folder under work: `work/scene.json`, `work/body.npz`, `work/pictures/`, `work/truth.npz`, `cad.ply`. The
truth stays in `work/` until the pictures are finished, so a folder with `truth.npz` is a whole scene.
"""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from trimesh.transformations import rotation_matrix, translation_matrix

from tabletop import cameras, rooms
from tabletop.objects import Item, make_item, resting_poses
from tabletop.scenes import Scene
from tabletop.truth import truth_arrays

SAMPLES = 8
"""A pixel; the denoiser is guided by the surfaces' colours, so their detail survives so few."""
MARGIN = 12
"""Pixels rendered beyond each edge, for the lens distortion: 0.06 moves the corners by less than 10."""
FPS = Fraction(5, 2)
"""Frames a second of the videos: a hand-held phone video of 16 s, of which every twelfth frame is kept."""
SHUTTER = {"video": 1 / 60, "turntable": 1 / 60, "photos": 1 / 200}
"""Exposure times [s]."""


def prepare(scene: Scene, scans: Path, folder: Path) -> None:
    """Writes the folder of a scene up to its pictures.

    Args:
        scene: the description.
        scans: folder of the scanned objects.
        folder: of the scene, made here.
    """
    work = folder / "work"
    work.mkdir(parents=True, exist_ok=True)
    rng = scene.generator()
    item = make_item(scene, scans)
    pictures = rooms.Pictures(rng)
    lens = cameras.draw_lens(rng, upright=scene.images != "photos")
    things = rooms.shell(rng, pictures, scene.table)
    rests = resting_poses(item.mesh, scene.up, scene.turned) * (2 if scene.again else 1)
    footprint = max(_reach(item, pose) for pose in rests)
    raised = 0.0
    if scene.stand:
        thing, raised = rooms.stand(rng, pictures, footprint)
        things.append(thing)
    if scene.images == "turntable":
        thing, raised = rooms.turntable(pictures, footprint)
        things.append(thing)
    free = footprint * (2.6 if raised else 1.3)
    if scene.cluttered:
        things += rooms.clutter(rng, pictures, free, max(2.5 * footprint, free + 0.25))
    lamps, ambient = rooms.lights(rng)
    if scene.flash:
        lamps, ambient = [], {**ambient, "strength": 0.15 * ambient["strength"]}
    moves = _moves(scene, rng, item, rests, raised, lens)
    pictures.images["body"] = item.image
    document = {
        "size": [lens.width + 2 * MARGIN, lens.height + 2 * MARGIN],
        "focal": lens.focal,
        "flash": scene.flash,
        "focus": scene.macro,
        "samples": SAMPLES,
        "body": {"picture": "body", "span": item.span, "smooth": item.uv is not None, **item.look},
        "things": things,
        "lights": lamps,
        "ambient": ambient,
        "frames": [{k: np.asarray(v).tolist() for k, v in m.items() if k != "placement"} for m in moves],
    }
    write_pictures(work, pictures.images)
    uv = {} if item.uv is None else {"uv": item.uv}
    np.savez(work / "body.npz", vertices=item.drawn.vertices, faces=item.drawn.faces, **uv)
    item.mesh.export(folder / "cad.ply")
    np.savez(work / "truth.npz", **truth(scene, item, lens, moves))
    write_scene(work, document)


def write_pictures(work: Path, images: dict[str, np.ndarray]) -> None:
    """(n, n, 3) uint8 RGB by name, to `pictures/`."""
    (work / "pictures").mkdir(parents=True, exist_ok=True)
    for name, image in images.items():
        cv2.imwrite(str(work / "pictures" / f"{name}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))


def write_scene(work: Path, document: dict[str, Any]) -> None:
    """`scene.json`, last and whole: a folder that has it is prepared."""
    temporary = work / "scene.json.tmp"
    temporary.write_text(json.dumps(document))
    temporary.replace(work / "scene.json")


def _reach(item: Item, pose: np.ndarray) -> float:
    """Greatest horizontal distance of the object from the z axis [m]."""
    points = item.mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
    return float(np.linalg.norm(points[:, :2], axis=1).max())


BY_HAND = 3
"""Photographs between two turns by hand."""


def _turned_by_hand(
    shots: list[list[np.ndarray]], i: int, body: np.ndarray, target: np.ndarray, push: np.ndarray
) -> dict[str, Any]:
    """Photograph i of a round, taken from one side of an object that was turned, and pushed by `push` (2,) [m], instead.

    Camera and object are moved together, so that what is seen of the object stays as it was; the room is another.
    """
    first = shots[i - i % BY_HAND][0][:3, 3] - target
    turn = rotation_matrix(-np.arctan2(first[1], first[0]), [0, 0, 1], target)
    moved = translation_matrix([*push, 0.0]) @ turn
    return {"camera": [moved @ pose for pose in shots[i]], "body": [moved @ body] * 3, "placement": 0}


def _moves(
    scene: Scene, rng: np.random.Generator, item: Item, rests: list[np.ndarray], raised: float, lens: cameras.Lens
) -> list[dict[str, Any]]:
    """Of each frame: poses of camera, body and plate at the shutter's opening, middle and closing, and placement."""
    turn = [rotation_matrix(rng.uniform(0, 2 * np.pi), [0, 0, 1]) for _ in rests]
    bodies = [translation_matrix([0, 0, raised]) @ t @ pose for t, pose in zip(turn, rests, strict=True)]
    share = scene.count // len(bodies)
    half = SHUTTER[scene.images] / 2
    found = []
    for placement, body in enumerate(bodies):
        points = item.mesh.vertices @ body[:3, :3].T + body[:3, 3]
        target = (points.min(0) + points.max(0)) / 2
        away = cameras.fitting_distance(points, target, lens)
        if scene.images == "turntable":
            heights = cameras.still(rng, away, target)
            for i in range(share):
                angle = 2 * np.pi * (2 * i / share)
                step = 2 * np.pi * 2 / share * float(FPS) * half
                spins = [rotation_matrix(angle + d, [0, 0, 1]) for d in (-step, 0.0, step)]
                camera = heights[0] if 2 * i < share else heights[1]
                found.append(
                    {
                        "camera": [camera] * 3,
                        "body": [s @ body for s in spins],
                        "plate": spins,
                        "placement": i * 2 // share,
                    }
                )
            for frame in found:
                frame["plate"] = [s @ translation_matrix([0, 0, raised / 2]) for s in frame["plate"]]
            continue
        if scene.images == "video":
            path = cameras.hand_held(rng, share / float(FPS), away, target)
            shots = [[path(i / float(FPS) + d) for d in (-half, 0.0, half)] for i in range(share)]
        else:
            shots = [
                [pose] * 3 for pose in cameras.photographs(rng, share, away, target, np.pi if scene.arc else 2 * np.pi)
            ]
        if scene.moved:
            push = rng.uniform(-0.01, 0.01, (share // BY_HAND + 1, 2))
            found += [_turned_by_hand(shots, i, body, target, push[i // BY_HAND]) for i in range(share)]
            continue
        found += [{"camera": shot, "body": [body] * 3, "placement": placement} for shot in shots]
    return found


def truth(scene: Scene, item: Item, lens: cameras.Lens, moves: list[dict[str, Any]]) -> dict[str, Any]:
    """The arrays of `truth.npz`."""
    clock = np.arange(len(moves)) / float(FPS)
    placement = np.array([m["placement"] for m in moves])
    if scene.images == "photos":
        clock = 11.0 * np.arange(len(moves)) + 420.0 * placement
    return truth_arrays(
        item.mesh,
        np.stack([np.asarray(m["body"][1]) for m in moves]),
        np.stack([np.asarray(m["camera"][1]) for m in moves]),
        lens.K,
        (lens.width, lens.height),
        clock,
        distortion=np.array([lens.k1, 0.0]),
        placement=placement,
        focal_35mm=lens.focal_35mm,
    )
