"""Where two placements of one body lie to each other for any turn, by the planes that touch it.

A line that touches a silhouette is the edge of a plane through the camera's centre that touches the body. How far the body reaches in the
plane's direction (its support function) the silhouettes of the other placement tell as well, so that each plane gives one linear equation
for the shift between the two. A first shape may lack a side, and then its middle tells nothing of that.
"""

from __future__ import annotations

import numpy as np

from massprops.views import Views

DIRECTIONS = 16
"""Lines that touch each silhouette."""
LEAST = 6
"""Planes without which nothing is told of a shift."""
ROUNDS, LEAST_OFF = 6, 0.05
"""Of reweighting, and least distance over the median one that still weighs more than others: a hull may reach far beyond its body on some sides."""
AT_ONCE = 500
"""Turns in one step, for memory."""


def tangent_planes(views: Views, masks: list[np.ndarray]) -> np.ndarray:
    """(m, 4) planes (n, d) with unit n that touch the body from outside: n x + d is 0 at some place of it, and nowhere more.

    Args:
        views: n cameras; masks: n arrays (h, w) uint8, undistorted: 255 object, 0 not. A line that touches the object where the image
            ends, or what may be object, says nothing.
    """
    import cv2

    angle = np.linspace(0.0, 2 * np.pi, DIRECTIONS, endpoint=False)
    way = np.column_stack([np.cos(angle), np.sin(angle)])
    out = []
    for i, mask in enumerate(masks):
        row, column = np.nonzero(mask == 255)
        if not len(row):
            continue
        hull = cv2.convexHull(np.column_stack([column, row]).astype(np.int32))[:, 0]
        touched = hull[np.argmax(hull @ way.T, axis=0)]
        ends = cv2.dilate(
            np.pad((mask != 255) & (mask != 0), 1, constant_values=True).astype(np.uint8), np.ones((3, 3))
        )
        sure = ends[touched[:, 1] + 1, touched[:, 0] + 1] == 0
        line = np.column_stack([way, -np.einsum("ij,ij->i", way, touched)])[sure]
        normal = line @ views.K[i] @ views.R[i]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        out.append(np.column_stack([normal, -normal @ views.centres[i]]))
    return np.concatenate([*out, np.zeros((0, 4))])


def touching_shifts(turns: np.ndarray, planes: np.ndarray, body: np.ndarray) -> np.ndarray:
    """(n, 3) for each turn the shift by which the planes of one placement touch what the other's silhouettes leave room for.

    Args:
        turns: (n, 3, 3), x is carried to R x + t.
        planes: (m, 4) of `tangent_planes`, of the placement that is carried; body: (k, 3) corners of the other's hull.
    """
    if len(planes) < LEAST or not len(body):
        return np.zeros((len(turns), 3))
    parts = [turns[k : k + AT_ONCE] for k in range(0, len(turns), AT_ONCE)]
    return np.concatenate([_shifts(part, planes, body) for part in parts])


def _shifts(turns: np.ndarray, planes: np.ndarray, body: np.ndarray) -> np.ndarray:
    """As `touching_shifts`, by least squares weighted again and again towards the least mean distance."""
    normal = planes[:, :3] @ np.swapaxes(turns, 1, 2)
    wanted = (normal @ body.T).max(axis=2) + planes[:, 3]
    weight, shift = np.ones_like(wanted), np.zeros((len(turns), 3))
    for _ in range(ROUNDS):
        rows = np.swapaxes(normal * weight[:, :, None], 1, 2)
        shift = np.linalg.solve(rows @ normal + 1e-9 * np.eye(3), rows @ wanted[:, :, None])[:, :, 0]
        off = np.abs(wanted - np.einsum("nij,nj->ni", normal, shift))
        weight = 1.0 / np.maximum(off, LEAST_OFF * np.median(off, axis=1, keepdims=True) + 1e-12)
    return shift
