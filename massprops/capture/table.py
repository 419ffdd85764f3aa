"""A still object cut from the flat thing it stands on, by what the table itself looks like.

Colours alone cannot tell a grey part from a grey table. But every view sees the same table through a homography of
its plane: put together, the views give a picture of the table without the object, and a pixel that does not show
what the table has there shows the object. Shadows lie on the table, so they stay with it. (Plane and parallax:
Irani and Anandan 1996; the cut: Boykov and Jolly 2001.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LARGEST_MAP = 900
"""Most cells along a side of the table's picture."""

MOST_VIEWS = 32
"""Views that the table's picture is made of."""

NOISE = 4.0
"""Grey levels by which resampling and light alone may change the table from view to view."""


WORK = 640
"""Longer side at which the object is cut from the table [px]."""


@dataclass(frozen=True)
class Table:
    """The picture of a plane.

    Attributes:
        to_world: (3, 3); columns step * e1, step * e2 and the corner: world = to_world @ (i, j, 1).
        colour: (g, g, 3) float32.
        sigma: (g, g) float32, spread between views [grey levels].
        seen: (g, g) uint8, how many views saw the cell.
    """

    to_world: np.ndarray
    colour: np.ndarray
    sigma: np.ndarray
    seen: np.ndarray

    def homography(self, K: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(3, 3) from cells of the map to pixels of a pinhole view; the last row is the depth."""
        camera = R @ self.to_world
        camera[:, 2] += t
        return K @ camera


def picture(
    images: list[np.ndarray],
    bodies: list[np.ndarray],
    cameras: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    plane: np.ndarray,
    centre: np.ndarray,
    extent: float,
    step: float,
) -> Table:
    """What the table looks like, as the median over the views that see it.

    Args:
        images: n undistorted (h, w, 3) uint8.
        bodies: n (h, w) bool, where the object surely hides the table.
        cameras: n of K (3, 3), R (3, 3), t (3,).
        plane: (4,) unit normal and offset.
        centre: (3,) about which the table is pictured.
        extent: half the side of the picture [world].
        step: cell [world]; made larger where the picture would have more than `LARGEST_MAP` cells a side.
    """
    import cv2

    normal = plane[:3]
    foot = centre - (normal @ centre + plane[3]) * normal
    first = np.linalg.svd(normal[None])[2][1]
    second = np.cross(normal, first)
    cells = int(min(LARGEST_MAP, np.ceil(2 * extent / step)))
    step = 2 * extent / cells
    to_world = np.column_stack([step * first, step * second, foot - extent * (first + second)])
    empty = Table(to_world, np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0)))
    chosen = np.unique(np.linspace(0, len(images) - 1, min(len(images), MOST_VIEWS)).round().astype(int))
    samples = np.empty((len(chosen), cells, cells, 3), np.uint8)
    valid = np.empty((len(chosen), cells, cells), bool)
    i, j = np.meshgrid(np.arange(cells), np.arange(cells))
    for k, v in enumerate(chosen):
        H = empty.homography(*cameras[v])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        samples[k] = cv2.warpPerspective(images[v], H, (cells, cells), flags=flags)
        free = np.pad((~bodies[v]).astype(np.uint8)[1:-1, 1:-1], 1)
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        depth = H[2, 0] * i + H[2, 1] * j + H[2, 2]
        valid[k] = (cv2.warpPerspective(free, H, (cells, cells), flags=flags) > 0) & (depth > 0)
    seen = valid.sum(axis=0).astype(np.uint8)
    colour = np.empty((cells, cells, 3), np.float32)
    spread = np.empty((cells, cells, 3), np.float32)
    for top in range(0, cells, 100):
        rows = slice(top, min(top + 100, cells))
        # what no view saw sorts behind everything else, so the quartiles are those of the valid samples
        ranked = np.sort(np.where(valid[:, rows, :, None], samples[:, rows].astype(np.int16), 999), axis=0)
        n = seen[rows][None, :, :, None].astype(int)
        low, middle, high = (
            np.take_along_axis(ranked, np.clip((n - 1) * q // 4, 0, None), axis=0)[0] for q in (1, 2, 3)
        )
        colour[rows], spread[rows] = middle, (high - low) / 1.35
    return Table(to_world, colour, spread.max(axis=2), seen)


def strangeness(
    image: np.ndarray, table: Table, K: np.ndarray, R: np.ndarray, t: np.ndarray, away: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How unlike the table every pixel is.

    Args:
        image: (h, w, 3) uint8, undistorted.
        table: of `picture`.
        K, R, t: of the view.
        away: (h, w) bool, certainly not the object: there the view's exposure is compared with the table's.

    Returns:
        (h, w) float32, difference in units of the table's own spread; (h, w) uint8: 1 where the table is known, 2 where
        the views do not agree on it, which is what the object hides, 0 where the ray misses the picture.
    """
    import cv2

    h, w = image.shape[:2]
    H = table.homography(K, R, t)
    expected = cv2.warpPerspective(table.colour, H, (w, h), flags=cv2.INTER_LINEAR)
    sigma = cv2.warpPerspective(table.sigma, H, (w, h), flags=cv2.INTER_LINEAR)
    seen = cv2.warpPerspective(table.seen, H, (w, h), flags=cv2.INTER_NEAREST)
    # a ray that leaves the table's plane behind it also has a homography
    inverse = np.linalg.inv(H)
    u, v = np.meshgrid(np.arange(w), np.arange(h))
    ahead = inverse[2, 0] * u + inverse[2, 1] * v + inverse[2, 2] > 0
    usual = float(np.median(table.sigma[table.seen >= 4])) if np.any(table.seen >= 4) else NOISE
    inside = cv2.warpPerspective(np.ones_like(table.seen), H, (w, h), flags=cv2.INTER_NEAREST) > 0
    known = (seen >= 4) & ahead & (sigma < 3.0 * max(usual, 0.5 * NOISE))
    own = cv2.GaussianBlur(image, (0, 0), 0.8).astype(np.float32)
    expected = cv2.GaussianBlur(expected, (0, 0), 0.8)
    calm = known & away
    if calm.sum() > 500:
        own = own * float(np.clip(np.median(expected[calm]) / max(np.median(own[calm]), 1.0), 0.5, 2.0))
    difference = np.abs(own - expected).max(axis=2) / np.hypot(sigma, NOISE)
    state = np.where(known, 1, np.where(inside & ahead, 2, 0)).astype(np.uint8)
    return np.where(known, difference, 0).astype(np.float32), state


def cut(image: np.ndarray, strange: np.ndarray, state: np.ndarray, surely: np.ndarray, away: np.ndarray) -> np.ndarray:
    """Object against table by one graph cut: unlike the table, edges where the image has them.

    Args:
        image: (h, w, 3) uint8.
        strange, state: of `strangeness`.
        surely: (h, w) bool, object points.
        away: (h, w) bool, certainly not object.

    Returns:
        (h, w) bool; only pieces with sure points, small holes filled.
    """
    import cv2
    import maxflow

    # by chance a body has the table's colour in spots, but not over an area
    known = state == 1
    share = np.maximum(cv2.GaussianBlur(known.astype(np.float32), (0, 0), 1.8), 0.05)
    calm = (cv2.GaussianBlur(np.minimum(strange, 5.0), (0, 0), 1.8) / share)[known & away]
    threshold = float(np.clip(1.3 * np.percentile(calm, 98), 0.35, 2.0)) if len(calm) > 500 else 1.3
    # clipped at twice the threshold, a blurred edge crosses the threshold where the edge is
    local = cv2.GaussianBlur(np.minimum(strange, 2.0 * threshold), (0, 0), 1.8) / share
    weight = np.where(known, np.clip(2.0 * (local / threshold - 1.0), -2.0, 3.0), 0.0)
    weight[state == 2] = 1.0
    weight[surely], weight[away] = 50.0, -50.0
    grey = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (0, 0), 0.8).astype(np.float32)
    graph = maxflow.Graph[float]()
    nodes = graph.add_grid_nodes(grey.shape)
    for axis, structure in ((1, [[0, 0, 0], [0, 0, 1], [0, 0, 0]]), (0, [[0, 0, 0], [0, 0, 0], [0, 1, 0]])):
        edge = np.abs(np.diff(grey, axis=axis, append=grey[:, -1:] if axis == 1 else grey[-1:]))
        contrast = max(float(np.mean(edge**2)), 1.0)
        pair = 0.3 + 1.5 * np.exp(-(edge**2) / (4.0 * contrast))
        graph.add_grid_edges(nodes, pair, structure=np.array(structure), symmetric=True)
    graph.add_grid_tedges(nodes, np.maximum(weight, 0), np.maximum(-weight, 0))
    graph.maxflow()
    found = ~graph.get_grid_segments(nodes)
    found = cv2.morphologyEx(found.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    count, label, _, _ = cv2.connectedComponentsWithStats(found, connectivity=8)
    sure = np.bincount(label[surely], minlength=count)
    sure[0] = 0
    kept = (sure >= max(3, 0.03 * sure.max(initial=0)))[label]
    count, label, stats, _ = cv2.connectedComponentsWithStats((~kept).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < 0.002 * kept.sum()
    small[0] = False
    return kept | small[label]


def reduced_camera(image: np.ndarray, K: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The image with its longer side at most `WORK` [px], and K (3, 3) for it; pixel centres at whole numbers."""
    from massprops.capture.images import reduce

    small = reduce(image, WORK)
    factor = np.array([small.shape[1] / image.shape[1], small.shape[0] / image.shape[0]])
    out = np.array(K, float)
    out[:2, 2] += 0.5
    out[:2] *= factor[:, None]
    out[:2, 2] -= 0.5
    return small, out


def to_stored(found: np.ndarray, size: tuple[int, int], K: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """A silhouette of the reduced, undistorted view in the geometry of the stored frame.

    Args:
        found: (h, w) bool.
        size: width, height of the stored frame [px].
        K, distortion: (3, 3) and (4,) of the stored frame.

    Returns:
        (height, width) uint8 of 0 and 255.
    """
    import cv2

    w, h = (int(v) for v in size)
    full = cv2.resize(found.astype(np.float32), (w, h), interpolation=cv2.INTER_LINEAR)
    if np.any(distortion):
        u, v = np.meshgrid(np.arange(w, dtype=np.float64), np.arange(h, dtype=np.float64))
        pixel = np.column_stack([u.ravel(), v.ravel()])[:, None]
        lens = np.asarray(distortion, float).reshape(-1, 1)
        at = cv2.undistortPoints(pixel, np.asarray(K, float), lens, P=np.asarray(K, float))
        grid = at.reshape(h, w, 2).astype(np.float32)
        full = cv2.remap(full, grid[..., 0].copy(), grid[..., 1].copy(), cv2.INTER_LINEAR)
    return np.where(full > 0.5, 255, 0).astype(np.uint8)
