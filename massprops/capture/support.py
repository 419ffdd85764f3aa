"""The plane an object stands on, found among dense oriented points, and the object that stands on it.

A flat object must not become its own table. A support carries: nothing lies below it, and it goes on beyond the object
on most sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.dense.region import Region

TOLERANCE = 0.009
"""Thickness of a plane, half, in radii of the region. This and the numbers below were set on five table-top sets (two
rendered, three photographed)."""
FACING = 0.8
"""Least cosine between a point's normal and its plane's."""
MOST_BELOW = 0.05
"""Largest share of points below a support: the top of a flat object has its table below it."""
CAMERAS_ABOVE = 0.9
LEAST_SHARE = 0.03
"""Least share of all points that a support holds."""
SECTORS, LEAST_SECTORS, REACH = 12, 6, 0.3
"""Sectors about the middle in which the plane must reach this far, in radii of the region."""
MOST_PLANES = 8
TRIALS = 300
SAMPLE = 10_000
"""Points on which planes are tried; the winner is fitted to all."""


@dataclass(frozen=True)
class OnSupport:
    """Split of dense points.

    Attributes:
        member: (n,) bool, the object's points.
        other: (n,) bool, surely the surroundings': on the support, or in another piece of many points. What is in neither
            may be a wrong match, such as a reflection.
        plane: (4,) unit normal towards the cameras and offset, n.x + d = 0; None when the object stands on nothing seen.
    """

    member: np.ndarray
    other: np.ndarray
    plane: np.ndarray | None


def thin_cells(xyz: np.ndarray, size: float) -> np.ndarray:
    """Indices (k,) of one of the points (n, 3) for each cell of a grid of `size`, the first in order."""
    cell = np.floor((xyz - xyz.min(0)) / size).astype(np.int64)
    shape = cell.max(0) + 1
    return np.sort(np.unique((cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2], return_index=True)[1])


def planes(xyz: np.ndarray, normal: np.ndarray, radius: float, seed: int) -> list[np.ndarray]:
    """The largest planes (4,) of oriented points, by RANSAC (Fischler and Bolles 1981) with a least-squares finish.

    Args:
        xyz: (n, 3); normal: (n, 3) unit.
        radius: of the region.
        seed: of the draws.
    """
    rng = np.random.default_rng([seed, 21])
    tolerance = TOLERANCE * radius
    remaining = np.ones(len(xyz), bool)
    largest_planes: list[np.ndarray] = []
    for _ in range(MOST_PLANES):
        index = np.flatnonzero(remaining)
        if len(index) < max(50, 0.02 * len(xyz)):
            break
        some = rng.choice(index, min(SAMPLE, len(index)), replace=False)
        place, facing = xyz[some], normal[some]
        best, most = None, 0
        # a point with its normal is a plane already
        for i in some[:TRIALS]:
            plane = np.append(normal[i], -normal[i] @ xyz[i])
            count = int(on_plane(place, facing, plane, tolerance).sum())
            if count > most:
                best, most = plane, count
        if best is None or most * len(index) < 0.02 * len(xyz) * len(some):
            break
        for _ in range(3):
            best = fitted(xyz[index[on_plane(xyz[index], normal[index], best, tolerance)]], best[:3])
        largest_planes.append(best)
        remaining[np.abs(xyz @ best[:3] + best[3]) < 2 * tolerance] = False
    return largest_planes


def on_plane(xyz: np.ndarray, normal: np.ndarray, plane: np.ndarray, tolerance: float) -> np.ndarray:
    """(n,) bool: near the plane and facing as it does."""
    return (np.abs(xyz @ plane[:3] + plane[3]) < tolerance) & (normal @ plane[:3] > FACING)


def fitted(xyz: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Least-squares plane (4,) of points (n, 3), its normal on the side of `towards`."""
    middle = xyz.mean(0)
    normal = np.linalg.eigh(np.cov((xyz - middle).T))[1][:, 0]
    normal = normal * np.sign(normal @ towards)
    return np.append(normal, -normal @ middle)


def carries(plane: np.ndarray, xyz: np.ndarray, normal: np.ndarray, centres: np.ndarray, region: Region) -> float:
    """Share of the points that a plane holds, 0 where it cannot be a support.

    Args:
        plane: (4,); xyz, normal: (n, 3) thinned points; centres: (c, 3) of the cameras.
    """
    height = xyz @ plane[:3] + plane[3]
    if np.mean(centres @ plane[:3] + plane[3] > 0) < CAMERAS_ABOVE:
        return 0.0
    if np.mean(height < -2 * TOLERANCE * region.radius) > MOST_BELOW:
        return 0.0
    held = on_plane(xyz, normal, plane, TOLERANCE * region.radius)
    if held.mean() < LEAST_SHARE:
        return 0.0
    first, second = axes(plane)
    across = xyz[held] - region.centre
    x, y = across @ first, across @ second
    far = np.hypot(x, y) > REACH * region.radius
    sector = np.floor((np.arctan2(y, x)[far] / (2 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    count = np.bincount(sector, minlength=SECTORS)
    return float(held.mean()) if np.sum(count >= 3) >= LEAST_SECTORS else 0.0


def axes(plane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (3,) within a plane."""
    first = np.linalg.svd(plane[None, :3])[2][1]
    return first, np.cross(plane[:3], first)


def find_support(
    xyz: np.ndarray, normal: np.ndarray, centres: np.ndarray, region: Region, seed: int = 0
) -> np.ndarray | None:
    """The plane (4,) that carries what the cameras look at, or None.

    Args:
        xyz, normal: (n, 3) dense points of the region.
        centres: (c, 3) of the cameras.
        region: where the object is.
        seed: of the draws.
    """
    few = thin_cells(xyz, region.radius / 150)
    xyz, normal = xyz[few], normal[few]
    held = [
        (carries(p, xyz, normal, centres, region), i, p) for i, p in enumerate(planes(xyz, normal, region.radius, seed))
    ]
    share, _, best = max(held, key=lambda h: (h[0], -h[1]), default=(0.0, 0, None))
    return best if share > 0 else None


CELLS = 75
"""Cells of the grid in which points hang together, along the radius of the region, where the points are dense."""
NARROW = 0.35
"""Distance from the axis of the region, in its radii, at which a piece weighs 1/e."""
LEAST_PIECE = 300
"""Points from which on another piece is a thing and no wrong match."""
LOWEST, NEARER = 2.0, 0.5
"""Percentile of a piece's points that are its lowest and its nearest to the object, and how far apart the two may be, over how high the piece
begins above the support: a thing of its own begins on the support, but for what stereo loses in the shade at its foot. Of bananas whose plain middle
stereo did not measure, a part began 79 px above the carpet and 27 px from the rest."""
RING = (1.02, 2.2)
"""Ring about the object, in its radii, on which its support is fitted again."""


def split(xyz: np.ndarray, normal: np.ndarray, plane: np.ndarray | None, region: Region, pixel: float) -> OnSupport:
    """The object among dense points: what rises from the support, hangs together and is what the cameras look at.

    Args:
        xyz, normal: (n, 3).
        plane: (4,) support, or None: then all points may be the object's.
        region: where the cameras look.
        pixel: size of a pixel at the object [units of the reconstruction].
    """
    piece = _things(xyz, normal, plane, region, pixel)
    if plane is None or not piece.any():
        return _answer(piece, None, plane)
    member = piece == 1
    middle = xyz[member].mean(0)
    first, second = axes(plane)

    def off(points: np.ndarray) -> np.ndarray:
        return np.hypot((points - middle) @ first, (points - middle) @ second)

    reach = float(np.percentile(off(xyz[member]), 98))
    held = on_plane(xyz, normal, plane, TOLERANCE * region.radius)
    ring = held & (off(xyz) > RING[0] * reach) & (off(xyz) < RING[1] * reach)
    if ring.sum() > 200:
        plane = fitted(xyz[ring], plane[:3])
        piece = _things(xyz, normal, plane, region, pixel)
        held = on_plane(xyz, normal, plane, TOLERANCE * region.radius)
    return _answer(piece, held, plane)


def _answer(piece: np.ndarray, held: np.ndarray | None, plane: np.ndarray | None) -> OnSupport:
    count = np.bincount(piece)
    large = np.flatnonzero(count >= LEAST_PIECE)
    other = np.isin(piece, large[large > 1])
    if held is not None:
        other |= held & (piece != 1)
    return OnSupport(piece == 1, other, plane)


def _risen(xyz: np.ndarray, normal: np.ndarray, plane: np.ndarray | None, region: Region, pixel: float) -> np.ndarray:
    """(n,) bool: higher above the plane than its own points scatter."""
    if plane is None:
        return np.ones(len(xyz), bool)
    return np.asarray(xyz @ plane[:3] + plane[3] > least_rise(xyz, normal, plane, region, pixel))


def least_rise(xyz: np.ndarray, normal: np.ndarray, plane: np.ndarray, region: Region, pixel: float) -> float:
    """Height above a support up to which its own points scatter. Arguments as for `split`."""
    height = xyz @ plane[:3] + plane[3]
    support_height = height[on_plane(xyz, normal, plane, TOLERANCE * region.radius)]
    scatter = mad_sigma(support_height - np.median(support_height)) if len(support_height) else 0.0
    return max(3 * scatter, 1.5 * pixel)


def label_pieces(
    xyz: np.ndarray, normal: np.ndarray, plane: np.ndarray | None, region: Region, pixel: float
) -> tuple[np.ndarray, np.ndarray]:
    """What rises from the support, by pieces that hang together. Arguments as for `split`.

    Returns:
        (n,) piece of each point, 1 the one that most lies in the middle, 2 and up the others, 0 none; and (p,) how much
        of each piece lies in the middle, by its number.
    """
    axis = None if plane is None else plane[:3]
    piece = _things(xyz, normal, plane, region, pixel)
    return piece, np.bincount(piece, _middling(xyz, region, axis) * (piece > 0))


def _things(xyz: np.ndarray, normal: np.ndarray, plane: np.ndarray | None, region: Region, pixel: float) -> np.ndarray:
    """(n,) as `_pieces`, of what rises from the support; a piece in the air belongs to the first, which must carry it. Arguments as for
    `split`."""
    from scipy.spatial import cKDTree

    piece = _pieces(xyz, _risen(xyz, normal, plane, region, pixel), region, None if plane is None else plane[:3])
    if plane is None or not (piece == 1).any():
        return piece
    first = cKDTree(xyz[piece == 1])
    count = np.bincount(piece)
    for k in 2 + np.flatnonzero(count[2:] >= LEAST_PIECE):
        points = xyz[piece == k]
        lowest = float(np.percentile(points @ plane[:3] + plane[3], LOWEST))
        apart = float(np.percentile(first.query(points)[0], LOWEST))
        if apart < NEARER * lowest:
            piece[piece == k] = 1
    return piece


def _middling(xyz: np.ndarray, region: Region, axis: np.ndarray | None) -> np.ndarray:
    """(n,) weight of points by their nearness to the middle of the region, or to its axis."""
    off = xyz - region.centre
    if axis is not None:
        off = off - (off @ axis)[:, None] * axis
    return np.exp(-((np.linalg.norm(off, axis=1) / (NARROW * region.radius)) ** 2))


def _pieces(xyz: np.ndarray, candidate: np.ndarray, region: Region, axis: np.ndarray | None) -> np.ndarray:
    """(n,) connected piece of each candidate: 1 the one that most lies in the middle, 2 and up the others, 0 none."""
    from scipy.ndimage import generate_binary_structure, label

    out = np.zeros(len(xyz), np.int64)
    index = np.flatnonzero(candidate & (np.linalg.norm(xyz - region.centre, axis=1) < 1.2 * region.radius))
    if len(index) < 20:
        return out
    size = max(region.radius / CELLS, 3.0 * _spacing(xyz[index]))
    cell = np.floor((xyz[index] - region.centre) / size).astype(np.int64)
    cell -= cell.min(0)
    count = np.zeros(cell.max(0) + 1, np.int32)
    np.add.at(count, tuple(cell.T), 1)
    piece, number = label(count >= 2, generate_binary_structure(3, 3))
    if number == 0:
        return out
    piece_of_point = piece[tuple(cell.T)]
    total = np.bincount(piece_of_point, _middling(xyz[index], region, axis), number + 1)
    total[0] = 0.0
    best = int(np.argmax(total))
    out[index] = np.where(piece_of_point == best, 1, np.where(piece_of_point == 0, 0, piece_of_point + 1))
    return out


def _spacing(xyz: np.ndarray) -> float:
    """Median distance to the fourth neighbour, of a sample."""
    from scipy.spatial import cKDTree

    return float(np.median(cKDTree(xyz).query(xyz[:: max(1, len(xyz) // 5000)], k=min(5, len(xyz)))[0][:, -1]))
