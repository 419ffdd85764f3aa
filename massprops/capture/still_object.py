"""The object among the points of a still scene: what the cameras look at, above what it stands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.errors import NotPossible


@dataclass(frozen=True)
class Scene3D:
    """Split of a sparse cloud.

    Attributes:
        object: (m,) bool, points of the object.
        support: (m,) bool, points of the plane it stands on.
        plane: (4,) unit normal towards the cameras and offset, n.x + d = 0; None when there is no plane.
        centre: (3,) of the object.
        radius: within which the object lies.
    """

    object: np.ndarray
    support: np.ndarray
    plane: np.ndarray | None
    centre: np.ndarray
    radius: float


def looked_at(centres: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Point nearest to all optical axes in the least-squares sense.

    Args:
        centres: (n, 3) camera centres.
        axes: (n, 3) unit viewing directions.
    """
    across = np.eye(3) - np.einsum("ni,nj->nij", axes, axes)
    return np.linalg.solve(across.sum(0) + 1e-9 * np.eye(3), np.einsum("nij,nj->i", across, centres))


def fit_plane(
    points: np.ndarray, tolerance: float, rng: np.random.Generator, trials: int = 600
) -> tuple[np.ndarray, np.ndarray]:
    """Plane with most points within `tolerance`, by RANSAC and a least-squares finish.

    Returns:
        plane (4,), inliers (n,) bool.
    """
    best, plane = np.zeros(len(points), bool), np.array([0.0, 0.0, 1.0, 0.0])
    for _ in range(trials):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-12:
            continue
        normal = normal / length
        inlier = np.abs((points - a) @ normal) < tolerance
        if inlier.sum() > best.sum():
            best, plane = inlier, np.append(normal, -normal @ a)
    for _ in range(3):
        if best.sum() < 3:
            break
        middle = points[best].mean(0)
        normal = np.linalg.svd(points[best] - middle, full_matrices=False)[2][2]
        plane = np.append(normal, -normal @ middle)
        best = np.abs(points @ normal + plane[3]) < tolerance
    return plane, best


def split_scene(points: np.ndarray, centres: np.ndarray, axes: np.ndarray, seed: int = 0) -> Scene3D:
    """Which points are the object.

    The centre is what all cameras look at; the support is the largest plane near it with the cameras on one side; the
    object is what rises from the plane and hangs together about the centre.

    Args:
        points: (m, 3) sparse points, the object and its surroundings.
        centres: (n, 3) camera centres.
        axes: (n, 3) unit optical axes.
        seed: of the plane's random draws.

    Raises:
        NotPossible: nothing stands out from the plane where the cameras look.
    """
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(seed)
    centre = looked_at(centres, axes)
    reach = float(np.median(np.linalg.norm(centres - centre, axis=1)))
    near = np.linalg.norm(points - centre, axis=1) < 0.6 * reach
    if near.sum() < 30:
        raise NotPossible(
            "the cameras do not look at one place with enough texture: walk round the object, keep it in the middle"
        )
    plane, inlier = fit_plane(points[near], 0.006 * reach, rng)
    side = np.sign(np.median(centres @ plane[:3] + plane[3]))
    plane = plane * side
    agree = np.mean(centres @ plane[:3] + plane[3] > 0)
    support = np.zeros(len(points), bool)
    if agree > 0.95 and inlier.mean() > 0.12:
        height = points @ plane[:3] + plane[3]
        support = np.abs(height) < 0.008 * reach
        candidate = near & (height > 0.010 * reach)
    else:
        plane, candidate = None, near  # type: ignore[assignment]
    if candidate.sum() < 20:
        raise NotPossible(
            "nothing rises above the support where the cameras look: give the object's silhouettes with --masks"
        )
    chosen = np.flatnonzero(candidate)
    tree = cKDTree(points[chosen])
    spacing = tree.query(points[chosen], k=min(6, len(chosen)))[0][:, -1]
    link = max(2.5 * float(np.percentile(spacing, 80)), 0.01 * reach)
    label = _components(tree, link, len(chosen))
    seed_distance = np.linalg.norm(points[chosen] - centre, axis=1)
    score = np.array(
        [np.sum(np.exp(-((seed_distance[label == k] / (0.25 * reach)) ** 2))) for k in range(label.max() + 1)]
    )
    member = chosen[label == int(np.argmax(score))]
    mask = np.zeros(len(points), bool)
    mask[member] = True
    middle = np.median(points[member], axis=0)
    radius = float(np.percentile(np.linalg.norm(points[member] - middle, axis=1), 98)) * 1.3
    return Scene3D(mask, support & ~mask, plane, middle, radius)


def _components(tree, link: float, n: int) -> np.ndarray:  # type: ignore[no-untyped-def]
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    pairs = tree.query_pairs(link, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return connected_components(graph, directed=False)[1]
