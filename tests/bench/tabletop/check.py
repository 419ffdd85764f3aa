"""Whether a finished scene is whole, judged without a look at it: held-out scenes are checked by this alone."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
from PIL import Image

from tabletop.scenes import Scene
from tabletop.silhouettes import project
from tabletop.truth import SceneTruth, read_scene_truth


def in_frame(truth: SceneTruth) -> np.ndarray:
    """(n,) share of the mesh's vertices that fall inside the image."""
    shares = []
    for pose, size in zip(truth.poses, truth.size, strict=True):
        pixels = project(truth.mesh.vertices, pose, truth.K, truth.distortion)
        shares.append(np.mean(((pixels >= 0) & (pixels < size)).all(axis=1)))
    return np.array(shares)


def lowest_point(folder: Path) -> float:
    """Height of the object's lowest point over its support's middle in the worst image [m]; 0 where it just touches."""
    with np.load(folder / "truth.npz", allow_pickle=False) as z:
        truth = read_scene_truth(folder)
        heights = [(truth.mesh.vertices @ pose[2, :3] + pose[2, 3]).min() for pose in z["object_world"]]
    return float(min(heights))


def brightness(folder: Path) -> tuple[int, float, float]:
    """Number of images, and the darkest and brightest mean of them in 0..255."""
    if (folder / "photos").is_dir():
        means = [np.asarray(Image.open(p).convert("L")).mean() for p in sorted((folder / "photos").glob("*.jpg"))]
    else:
        with av.open(str(folder / "cam0.mp4")) as container:
            means = [frame.to_ndarray(format="gray").mean() for frame in container.decode(video=0)]
    return len(means), float(min(means)), float(max(means))


def check(scene: Scene, folder: Path) -> str:
    """One line of numbers about a finished scene.

    Raises:
        ValueError: images are missing, or the object is out of the frame in more than a tenth of them.
    """
    truth = read_scene_truth(folder)
    shares = in_frame(truth)
    count, darkest, brightest = brightness(folder)
    if count != len(truth.poses) or count != scene.count:
        raise ValueError(f"{folder}: {count} images, {len(truth.poses)} poses, {scene.count} wanted")
    if np.mean(shares < 1) > 0.1:
        raise ValueError(f"{folder}: the object leaves the frame in {np.sum(shares < 1)} of {count} images")
    return (
        f"{scene.name:<28} {count} images, whole object in {np.sum(shares == 1)}, least {100 * shares.min():.0f} %; "
        f"lowest point {1000 * lowest_point(folder):.2f} mm; mean brightness {darkest:.0f} to {brightest:.0f}"
    )
