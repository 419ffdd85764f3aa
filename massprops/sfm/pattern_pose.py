"""Where a photograph of a repeating pattern was taken from, by all that is unique in it at once.

Two photographs of a patterned cloth share few features that have no twin, often too few to tell their geometry. But the
features that are unique in one photograph and match any placed one are clues to a single pose. Three of them fix a pose
up to four (Grunert's problem: Haralick and others 1994). A pose that is nearly right then finds the pattern's own
features where the model predicts them, by hundreds, which a wrong pose does not. A pose one cell of the pattern further
on finds them too, but the clues contradict it.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass

import numpy as np
import pycolmap

from massprops.sfm.gated_search import between, likest, within
from massprops.sfm.guided import ALIKE_DEG, cosines, in_frame
from massprops.sfm.points import SparsePoints
from massprops.views import Views

TRIALS = 1000
"""Triples of clues tried: where one in five is right, eight of them are."""

NEAR = 0.0125
"""Distance at which a clue agrees with the pose from a triple, in longer sides of the image."""

LEAST_CLUES = 4
"""Clues that agree with a pose which is looked at: its triple and one more."""

MOST_POSES = 12
"""Poses looked at, those with most clues."""

GATES = (0.022, 0.0125, 0.008, 0.008)
"""How far from its predicted place a point is looked for, round by round, in longer sides of the image."""

LEAST_POINTS = 12
"""Points that must be found."""

SURE_CLUES = 5
"""Clues that must agree with the pose found."""

FOUND = 0.2
"""Share of the points that a pose shows which must be found. On one printed cloth 0.28 to 0.45 at right poses, at most
0.12 at those that were wrong by degrees."""

RIVAL = 0.5
"""Of the points found, or of the clues that agree, from which on another pose is a rival of the best."""


@dataclass(frozen=True)
class Known:
    """The placed images.

    Attributes:
        views: their cameras; points: what they saw.
        look: (k, 128) uint8, the descriptor of each observation.
    """

    views: Views
    points: SparsePoints
    look: np.ndarray


@dataclass(frozen=True)
class Photograph:
    """An image to be placed.

    Attributes:
        K, distortion: (3, 3) and (4 or 8,) of its camera; size: (2,) width, height [px].
        uv: (n, 2) its features, centres of pixels at whole numbers [px]; ray: (n, 2) the same at depth 1.
        unit: (n, 128) their descriptors, of length one.
        feature: (c,) which of them are clues; xyz: (c, 3) where each clue may lie in the world.
    """

    K: np.ndarray
    distortion: np.ndarray
    size: np.ndarray
    uv: np.ndarray
    ray: np.ndarray
    unit: np.ndarray
    feature: np.ndarray
    xyz: np.ndarray

    def off(self, R: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(c,) distance of each clue from where a pose has it, in longer sides of the image."""
        c = self.xyz @ R.T + t
        with np.errstate(all="ignore"):
            away = np.linalg.norm(c[:, :2] / c[:, 2:] - self.ray[self.feature], axis=1)
        return np.where(c[:, 2] > 0, away * self.K[0, 0] / float(self.size.max()), np.inf)

    def agreeing(self, R: np.ndarray, t: np.ndarray) -> int:
        """Features whose clues agree with a pose that has been refined."""
        return len(np.unique(self.feature[self.off(R, t) < GATES[-1]]))


@dataclass(frozen=True)
class Pose:
    """R (3, 3), t (3,) from the world to the camera; clues: features that agree; found: points, of shown."""

    R: np.ndarray
    t: np.ndarray
    clues: int
    found: int
    shown: int


def find_pose(known: Known, image: Photograph, rng: np.random.Generator) -> Pose | None:
    """The pose that clues and pattern agree on; None where there is none, or more than one."""
    poses = [p for R, t in _from_clues(image, rng) if (p := _settled(known, image, R, t)) is not None]
    if not poses:
        return None
    most = max(p.found for p in poses)
    best = max(poses, key=lambda p: (p.found >= RIVAL * most, p.clues, p.found))
    if best.clues < SURE_CLUES or best.found < FOUND * best.shown:
        return None
    rivals = [p for p in poses if p.found >= RIVAL * best.found and _apart(image, best, p)]
    return None if any(p.clues >= RIVAL * best.clues for p in rivals) else best


def _apart(image: Photograph, one: Pose, other: Pose) -> bool:
    """Whether two poses show the clues of the first at different places."""
    right = image.off(one.R, one.t) < GATES[-1]
    return bool(np.median(image.off(other.R, other.t)[right]) > GATES[-1])


def _from_clues(image: Photograph, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses of triples of clues with which further ones agree, those with most first; none twice for the same clues."""
    import cv2

    if len(np.unique(image.feature)) < LEAST_CLUES:
        return []
    ray, best = image.ray[image.feature], {}
    for _ in range(TRIALS):
        three = rng.choice(len(ray), 3, replace=False)
        _, turns, shifts = cv2.solveP3P(image.xyz[three], ray[three], np.eye(3), None, cv2.SOLVEPNP_P3P)
        for turn, shift in zip(turns, shifts, strict=True):
            R, t = cv2.Rodrigues(turn)[0], shift[:, 0]
            near = image.off(R, t) < NEAR
            if len(np.unique(image.feature[near])) >= LEAST_CLUES:
                best.setdefault(near.tobytes(), (int(near.sum()), R, t))
    order = sorted(best.values(), key=lambda b: -b[0])
    return [(R, t) for _, R, t in order[:MOST_POSES]]


def _settled(known: Known, image: Photograph, R: np.ndarray, t: np.ndarray) -> Pose | None:
    """The pose refined by the points found where it shows them; None where too few are."""
    shown = inliers = 0
    for gate in GATES:
        radius = gate * float(image.size.max())
        points, feature, shown = _looked_for(known, image, (R, t), radius)
        if len(points) < LEAST_POINTS:
            return None
        options = pycolmap.AbsolutePoseEstimationOptions()
        options.ransac.max_error, options.ransac.random_seed = 0.5 * radius, 0
        options.ransac.min_num_trials, options.ransac.max_num_trials = 100, 1000
        focal = float(image.K[0, 0])
        flat = pycolmap.Camera(
            model="SIMPLE_PINHOLE", width=int(image.size[0]), height=int(image.size[1]), params=[focal, 0.0, 0.0]
        )
        fitted = pycolmap.estimate_and_refine_absolute_pose(
            focal * image.ray[feature], known.points.xyz[points], flat, options
        )
        if fitted is None:
            return None
        pose, inliers = np.asarray(fitted["cam_from_world"].matrix()), int(np.sum(fitted["inlier_mask"]))
        R, t = pose[:, :3], pose[:, 3]
    return Pose(R, t, image.agreeing(R, t), inliers, shown)


def _looked_for(
    known: Known, image: Photograph, pose: tuple[np.ndarray, np.ndarray], radius: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Points and features of an image that match near where a pose shows the points, and how many points it shows."""
    seen, at = _shown(known, image, *pose)
    which, other = within(image.uv, at, np.full(len(at), radius))
    look = known.look[seen].astype(np.float32)
    look /= np.maximum(np.linalg.norm(look, axis=1, keepdims=True), 1e-9)
    which, other = likest(which, other, between(look, image.unit, which, other), image.uv)
    return known.points.obs_point[seen[which]], other, len(seen)


def _shown(known: Known, image: Photograph, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each point that a pose shows from a direction like that of a placed image, the observation from the likest one,
    and its place (m, 2) [px]."""
    points = known.points
    cosine = cosines(known.views, points, -R.T @ t)
    order = np.lexsort((-cosine, points.obs_point))
    point = points.obs_point[order]
    nearest = order[np.r_[True, point[1:] != point[:-1]][: len(point)]]
    nearest = nearest[cosine[nearest] > np.cos(np.deg2rad(ALIKE_DEG))]
    camera = points.xyz[points.obs_point[nearest]] @ R.T + t
    at, inside = in_frame(camera, image.K, image.distortion, image.size)
    return nearest[inside], at[inside]
