"""The features of an object that was moved by hand between photographs, while its room stayed.

Where it was moved between two photographs, their matches agree on two geometries: one of the object, one of the room. Verification
keeps the larger. Here both are found, and all photographs together tell which is which. A minimum cut (Boykov and Kolmogorov 2004)
labels every feature: two that match have one label, neighbours in an image mostly do, and one motion of each pair is the object's.
The object is what was photographed: its features lie about one place of the images, which is learned, beginning at their middle.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pycolmap
from scipy.spatial import cKDTree

from massprops.sfm.mapping import MappingOptions, verification

MOST = 3
"""Motions looked for in a pair."""

NEIGHBOURS, NEXT = 5, 0.2
"""Neighbours of a feature in its image, and what a label that differs from a neighbour's costs, where one that differs from a
match's costs 1. These and what follows were set on 23 phone photographs of a parcel, whose labels were looked at."""

PLACE, MOST_PLACE = 0.3, 2.0
"""Weight of the logarithm by which the object's place speaks for a feature, and its bound."""

MOST_VOTES = 2.0
"""Bound of what a feature's motions say: +1 for each that is the object's, -1 for each other."""

FIRST_SPREAD = 0.2
"""Spread of the object's features about the middle of the image, in longer sides, before it is learned."""

ROUNDS = 20


class Motion(NamedTuple):
    """Matches (m, 2) of a pair of images that agree on one geometry, as numbers of features counted through all images."""

    pair: int
    matches: np.ndarray


class FeaturePlaces(NamedTuple):
    """Features of all images, counted through: place (n, 2) from the middle of the image, in its longer sides; image (n,)."""

    place: np.ndarray
    image: np.ndarray


def own_features(database: Path, options: MappingOptions) -> dict[str, np.ndarray]:
    """Which features of each image (k,) bool are the object's, by name; empty where no pair shows two motions."""
    with pycolmap.Database.open(database) as db:
        images = sorted(db.read_all_images(), key=lambda image: image.image_id)
        cameras = {camera.camera_id: camera for camera in db.read_all_cameras()}
        places = {im.image_id: np.asarray(db.read_keypoints(im.image_id), float)[:, :2] for im in images}
        count = [len(places[im.image_id]) for im in images]
        first = dict(zip(places, np.cumsum([0, *count[:-1]]).tolist(), strict=True))
        pair_motions: list[Motion] = []
        for number, (pair_id, geometry) in enumerate(zip(*db.read_two_view_geometries(), strict=True)):
            pair = pycolmap.pair_id_to_image_pair(pair_id)
            matches = np.asarray(db.read_matches(*pair), int).reshape(-1, 2)
            inliers = np.asarray(geometry.inlier_matches, int).reshape(-1, 2)
            seen = [(cameras[db.read_image(i).camera_id], places[i]) for i in pair]
            offset = np.array([first[i] for i in pair])
            pair_motions += [Motion(number, m + offset) for m in motions(matches, inliers, seen, options)]
    middle = [0.5 * np.array([cameras[im.camera_id].width, cameras[im.camera_id].height]) for im in images]
    place = [
        (places[im.image_id] - half).reshape(-1, 2) / (2 * half.max()) for im, half in zip(images, middle, strict=True)
    ]
    of_object = label(FeaturePlaces(np.concatenate(place), np.repeat(np.arange(len(images)), count)), pair_motions)
    if of_object is None:
        return {}
    return {im.name: part for im, part in zip(images, np.split(of_object, np.cumsum(count)[:-1]), strict=True)}


def motions(
    matches: np.ndarray,
    inliers: np.ndarray,
    seen: list[tuple[pycolmap.Camera, np.ndarray]],
    options: MappingOptions,
) -> list[np.ndarray]:
    """Matches (m, 2) of each motion of a pair, the verified one first.

    Args:
        matches: (n, 2) of the pair.
        inliers: (m, 2) those that agree on its verified geometry.
        seen: camera and places (k, 2) [px] of the features of either image.
    """
    if len(inliers) < options.least_matches:
        return []
    out, rest = [inliers], _without(matches, inliers)
    (camera1, uv1), (camera2, uv2) = seen
    while len(rest) >= options.least_matches and len(out) < MOST:
        geometry = pycolmap.estimate_calibrated_two_view_geometry(
            camera1, uv1, camera2, uv2, rest.astype(np.uint32), verification(options)
        )
        more = np.asarray(geometry.inlier_matches, int).reshape(-1, 2)
        if len(more) < options.least_matches:
            break
        out.append(more)
        rest = _without(rest, more)
    return out


def _without(matches: np.ndarray, taken: np.ndarray) -> np.ndarray:
    gone = {tuple(m) for m in taken.tolist()}
    return np.array([m for m in matches.tolist() if tuple(m) not in gone], int).reshape(-1, 2)


def label(features: FeaturePlaces, found: list[Motion]) -> np.ndarray | None:
    """Which features (n,) bool are the object's; None where no pair shows two motions.

    Args:
        found: the motions of all pairs, of one pair one after the other.
    """
    pairs: dict[int, list[np.ndarray]] = {}
    for motion in found:
        pairs.setdefault(motion.pair, []).append(motion.matches.ravel())
    moved = [selected for selected in pairs.values() if len(selected) > 1]
    if not moved:
        return None
    edges = np.concatenate([m.matches for m in found])
    beside = _beside(features)
    matched = np.zeros(len(features.place), bool)
    matched[edges.ravel()] = True
    centre, spread = np.zeros(2), FIRST_SPREAD**2 * np.eye(2)
    selected: np.ndarray | None = None
    for _ in range(ROUNDS):
        here = _speaks(features.place, centre, spread)
        likely = here if selected is None else here + np.where(selected, 1.0, -1.0)
        votes = np.zeros(len(matched))
        for of_pair in moved:
            best = max(range(len(of_pair)), key=lambda k: float(likely[of_pair[k]].mean()))
            for k, ends in enumerate(of_pair):
                votes[ends] += 1.0 if k == best else -1.0
        new = _cut(PLACE * here + np.clip(votes, -MOST_VOTES, MOST_VOTES), edges, beside)
        if selected is not None and np.array_equal(new, selected):
            break
        selected = new
        if np.count_nonzero(selected & matched) <= NEIGHBOURS:
            return None
        there = features.place[selected & matched]
        centre = np.median(there, axis=0)
        spread = (there - centre).T @ (there - centre) / len(there)
    return selected


def _speaks(place: np.ndarray, centre: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """(n,) by how much, as a bounded logarithm, a place speaks for the object beside anywhere in the image."""
    away = place - centre
    inverse = np.linalg.inv(spread)
    distance = np.einsum("ni,ij,nj->n", away, inverse, away)
    anywhere = float(np.ptp(place[:, 0]) * np.ptp(place[:, 1]))
    log = -0.5 * distance + np.log(anywhere / (2 * np.pi * np.sqrt(np.linalg.det(spread))))
    return np.clip(log, -MOST_PLACE, MOST_PLACE)


def _beside(features: FeaturePlaces) -> np.ndarray:
    """(e, 2) pairs of neighbouring features of one image."""
    out = []
    for image in np.unique(features.image):
        mine = np.flatnonzero(features.image == image)
        k = min(NEIGHBOURS, len(mine) - 1)
        if k > 0:
            near = cKDTree(features.place[mine]).query(features.place[mine], k + 1)[1][:, 1:]
            out.append(np.column_stack([np.repeat(mine, k), mine[near.ravel()]]))
    return np.concatenate(out) if out else np.zeros((0, 2), int)


def _cut(speaks: np.ndarray, edges: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """(n,) bool: the labels of least cost."""
    import maxflow

    graph = maxflow.Graph[float](len(speaks), len(edges) + len(beside))
    nodes = graph.add_nodes(len(speaks))
    graph.add_grid_tedges(nodes, np.maximum(speaks, 0), np.maximum(-speaks, 0))
    for ends, cost in ((edges, 1.0), (beside, NEXT)):
        graph.add_edges(ends[:, 0], ends[:, 1], np.full(len(ends), cost), np.full(len(ends), cost))
    graph.maxflow()
    return ~np.asarray(graph.get_grid_segments(nodes), bool)
