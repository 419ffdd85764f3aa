"""Where the known surroundings do not show: something stands before them, however plain it is.

Stereo finds no points on a plain or glossy object. The surroundings have been measured all the same, in other images: a
pixel that has not the colour of the point of the table which lies there shows something nearer. The space that no image
sees the surroundings through is the object's hull (Laurentini 1994), with votes in place of certainty.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from massprops.capture.support import axes
from massprops.core.robust import MAD_TO_SIGMA, nanmedian
from massprops.dense.region import Region
from massprops.geometry.projection import pixels_of, project
from massprops.surface.cloud import Cloud
from massprops.views import Views

CELL = 4
"""Side of a cell of the maps [px of an image whose shorter side is 480]."""
REACH, GRID = 2.2, 3.0
"""Radius of the support that is looked at, in radii of the region, and distance of its points [px of an image as above]."""
LEAST_SEEN = 5
"""Images that must see a point of the support before its colour is known."""
UNSTEADY = 25.0
"""Scatter of a point's colour over the images [grey levels] above which it is not known: gloss, or something on it."""
SHOWS, HIDES, LEAST_SHOWS, LEAST_HIDES = 3.0, 4.5, 9.0, 16.0
"""A point shows within so many of its scatters, is hidden beyond so many, and not below so many grey levels."""
ABOUT = 30
"""Points of the support about one that stereo did not measure, whose colour it must have (within `LEAST_SHOWS`). About a
grey padlock on a plain grey cloth, whose shade hid half of the plane's points, the hull's silhouettes overlapped the true
ones by 0.70 and 0.79 without such points, with them by 0.86 and 0.84."""
WIDE, HIGH = 0.65, 1.1
"""Half width and height of the space that is searched, in radii of the region."""
MOST_SHOWN = 0.2
"""Largest share of the images that know it which may see the surroundings through a place within the object: of an object
of its table's colour some pixels pass for the table."""
LEAST_HIDDEN = 4
"""Images that must see the surroundings hidden there."""
COARSE, FINE = 36, 100
"""Voxels along the radius's double width where placements are divided and where a shape is made."""


@dataclass(frozen=True)
class Occlusion:
    """n maps, one a view: 1 the surroundings show, -1 something hides them, 0 nothing is known.

    Attributes:
        state: n arrays (h, w) int8.
        cell: (n,) size of a cell [px].
        support, colour: (k, 3) points of the support of which the views know something, and their colours, uint8 BGR.
    """

    state: list[np.ndarray]
    cell: np.ndarray
    support: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    colour: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.uint8))


def support_points(
    plane: np.ndarray, region: Region, measured: np.ndarray, pixel: float
) -> tuple[np.ndarray, np.ndarray]:
    """(m, 3) grid on the support, and (m,) bool which of it is sure to be seen.

    Near the middle that is only what stereo measured: below an object there is nothing to see.

    Args:
        plane: (4,); region: where the cameras look; measured: (k, 3) dense points on the plane; pixel: at the object.
    """
    from scipy.spatial import cKDTree

    first, second = axes(plane)
    foot = region.centre - (region.centre @ plane[:3] + plane[3]) * plane[:3]
    step = max(GRID * pixel, REACH * region.radius / 200)
    flat = np.arange(-REACH * region.radius, REACH * region.radius, step)
    x, y = (a.ravel() for a in np.meshgrid(flat, flat))
    off = np.hypot(x, y)
    inside = off < REACH * region.radius
    x, y, off = x[inside], y[inside], off[inside]
    grid = foot + x[:, None] * first + y[:, None] * second
    near = off < WIDE * region.radius
    away = np.full(len(grid), np.inf)
    if len(measured):
        away[near] = cKDTree(measured).query(grid[near], distance_upper_bound=3 * step)[0]
    return grid, ~near | np.isfinite(away)


def sampled(views: Views, image: Callable[[int], np.ndarray], xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colours (n, m, 3) uint8 of points in every view, and (n, m) bool where they lie in the image.

    Args:
        views: n views; image: `image(i)` is (h, w, 3) uint8, undistorted.
        xyz: (m, 3).
    """
    import cv2

    colour = np.zeros((len(views), len(xyz), 3), np.uint8)
    there = np.zeros((len(views), len(xyz)), bool)
    for i in range(len(views)):
        picture = cv2.GaussianBlur(image(i), (0, 0), 1.5)
        index, rows, columns = pixels_of(xyz, views.K[i], views.R[i], views.t[i], picture.shape)
        there[i, index] = True
        colour[i, index] = picture[rows, columns]
    return colour, there


def visibility(colour: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, m) int8: 1 the point shows in the view, -1 it is hidden, 0 not known; and (m, 3) the points' own colours.

    A point's own colour is the median over the views, each view's exposure divided out; its scatter says how far a view
    may differ.

    Args:
        colour, there: of `sampled`.
    """
    level = np.where(there[..., None], colour.astype(np.float32), np.nan)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        point_colour = nanmedian(level, axis=0)
        for _ in range(2):
            gain = np.nanmedian(level / np.maximum(point_colour, 1.0), axis=1)
            gain = np.clip(np.where(np.isfinite(gain), gain, 1.0), 0.4, 2.5)
            point_colour = nanmedian(level / gain[:, None], axis=0)
        off = np.abs(level / gain[:, None] - point_colour).max(axis=2)
        scatter = MAD_TO_SIGMA * nanmedian(off, axis=0)
    known = there & (there.sum(0) >= LEAST_SEEN) & (scatter < UNSTEADY)
    shows = known & (off < np.maximum(SHOWS * scatter, LEAST_SHOWS))
    hides = known & (off > np.maximum(HIDES * scatter, LEAST_HIDES))
    return shows.astype(np.int8) - hides.astype(np.int8), point_colour


def continued(xyz: np.ndarray, own: np.ndarray, sure: np.ndarray) -> np.ndarray:
    """(m,) bool: points of the support that are sure to be seen, and such as have the colour of the nearest of those.

    A cloth of one colour gives stereo nothing to measure, but it goes on in its colour, which no shade and no object has.

    Args:
        xyz: (m, 3); own: (m, 3) their colours, NaN where nobody knows; sure: (m,) bool, of `support_points`.
    """
    from scipy.spatial import cKDTree

    out = sure.copy()
    known = sure & np.isfinite(own).all(1)
    if known.sum() < ABOUT or sure.all():
        return out
    near = cKDTree(xyz[known]).query(xyz[~sure], k=ABOUT)[1]
    out[~sure] = np.abs(own[~sure] - np.median(own[known][near], axis=1)).max(1) < LEAST_SHOWS
    return out


def occlusion_maps(
    views: Views, image: Callable[[int], np.ndarray], xyz: np.ndarray, sure: np.ndarray | None = None
) -> Occlusion:
    """What each view shows of the support.

    Args:
        views: n views.
        image: `image(i)` is (h, w, 3) uint8, undistorted.
        xyz, sure: (m, 3) and (m,) points of the support (`support_points`); all are sure by default.
    """
    import cv2

    seen, point_colour = visibility(*sampled(views, image, xyz))
    kept = continued(xyz, point_colour, np.ones(len(xyz), bool) if sure is None else sure)
    xyz, seen, point_colour = xyz[kept], seen[:, kept], point_colour[kept]
    states, cells = [], []
    for i in range(len(views)):
        w, h = views.size[i]
        cell = CELL * min(h, w) / 480
        shape = (int(np.ceil(h / cell)), int(np.ceil(w / cell)))
        pixel, _ = project(xyz, views.K[i], views.R[i], views.t[i])
        count = []
        for chosen in (seen[i] == 1, seen[i] == -1):
            dots = np.zeros(shape, np.float32)
            at = np.minimum((pixel[chosen] / cell).astype(int), np.array(shape[::-1]) - 1).clip(0)
            np.add.at(dots, (at[:, 1], at[:, 0]), 1.0)
            count.append(cv2.boxFilter(dots, -1, (3, 3), normalize=False))
        known = count[0] + count[1] > 1.5
        states.append(np.where(known, np.where(count[0] >= count[1], 1, -1), 0).astype(np.int8))
        cells.append(cell)
    known = (seen != 0).any(0)
    return Occlusion(states, np.array(cells), xyz[known], np.clip(point_colour[known], 0, 255).astype(np.uint8))


def with_still(maps: Occlusion, still: list[np.ndarray]) -> Occlusion:
    """The maps where what stands still while the object turns, (h, w) bool of each view, shows too, of what else nothing is known.

    A figure before wood of its colour hid the turntable, and nothing told how far it reaches above that.
    """
    states = [
        np.where((state == 0) & (_share_of_cells(there, state) > 0.99), 1, state).astype(np.int8)
        for state, there in zip(maps.state, still, strict=True)
    ]
    return replace(maps, state=states)


def _share_of_cells(mask: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Share of each cell of a map `state` (h, w) that a mask of its image, bool, covers; float32 (h, w)."""
    import cv2

    return np.asarray(cv2.resize(mask.astype(np.float32), state.shape[::-1], interpolation=cv2.INTER_AREA))


@dataclass(frozen=True)
class Voxels:
    """A grid of cubes that stands on the support.

    Attributes:
        centre: (a, b, c, 3) of each cube.
        size: its side.
        shown, hidden: (n, a, b, c) bool, view i sees the surroundings through it, and sees them hidden there.
        cell: (n, a, b, c) int32, cell of view i's map it falls on, -1 outside.
    """

    centre: np.ndarray
    size: float
    shown: np.ndarray
    hidden: np.ndarray
    cell: np.ndarray


def voxels(views: Views, maps: Occlusion, plane: np.ndarray, region: Region, count: int) -> Voxels:
    """What the views say of each cube above a plane (4,); `count` cubes along the width of the space."""
    first, second = axes(plane)
    size = 2 * WIDE * region.radius / count
    foot = region.centre - (region.centre @ plane[:3] + plane[3]) * plane[:3]
    flat = (np.arange(count) + 0.5) * size - WIDE * region.radius
    up = (np.arange(round(HIGH * region.radius / size)) + 0.5) * size
    centre = (
        foot
        + flat[:, None, None, None] * first
        + flat[None, :, None, None] * second
        + up[None, None, :, None] * plane[:3]
    )
    shape = centre.shape[:3]
    points = centre.reshape(-1, 3)
    shown, hidden = (np.zeros((len(views), *shape), bool) for _ in range(2))
    cell = np.full((len(views), *shape), -1, np.int32)
    for i in range(len(views)):
        uv, z = project(points, views.K[i], views.R[i], views.t[i])
        h, w = maps.state[i].shape
        at = np.floor(uv / maps.cell[i]).astype(np.int64)
        there = np.flatnonzero((z > 1e-9) & (at >= 0).all(1) & (at < [w, h]).all(1))
        index = at[there, 1] * w + at[there, 0]
        state = maps.state[i].ravel()[index]
        cell[i].reshape(-1)[there] = index
        shown[i].reshape(-1)[there] = state == 1
        hidden[i].reshape(-1)[there] = state == -1
    return Voxels(centre, size, shown, hidden, cell)


def hull(grid: Voxels, member: np.ndarray) -> np.ndarray:
    """(a, b, c) bool: the largest piece through which the views of `member` (k,) do not see the surroundings."""
    from scipy.ndimage import label

    shown = grid.shown[member].sum(0)
    hidden = grid.hidden[member].sum(0)
    empty = shown > np.maximum(MOST_SHOWN * (shown + hidden), 1)
    solid: np.ndarray = (hidden >= LEAST_HIDDEN) & ~empty
    # next to the support, nothing is known behind the object: what stands on it goes down to it
    above = np.cumsum(solid[..., ::-1], axis=2)[..., ::-1] > 0
    solid |= above & ~empty
    piece, number = label(solid)
    if number == 0:
        return solid
    return piece == 1 + int(np.argmax(np.bincount(piece.ravel())[1:]))


def explained(grid: Voxels, maps: Occlusion, solid: np.ndarray, member: np.ndarray) -> np.ndarray:
    """(k,) intersection over union, in each view of `member`, of where a hull is drawn and where surroundings are hidden.

    Only cells count onto which the searched space projects and of which something is known.
    """
    out = np.zeros(len(member))
    for k, i in enumerate(member):
        cells = maps.state[i].size
        state = maps.state[i].ravel()
        reach, drawn = np.zeros(cells, bool), np.zeros(cells, bool)
        cell_of_voxel = grid.cell[i]
        reach[cell_of_voxel[cell_of_voxel >= 0]] = True
        inside = cell_of_voxel[solid & (cell_of_voxel >= 0)]
        drawn[inside] = True
        hidden = reach & (state == -1)
        union = np.count_nonzero(hidden | (drawn & (state != 0)))
        out[k] = np.count_nonzero(hidden & drawn) / union if union else 1.0
    return out


def boundary(grid: Voxels, solid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The faces of a hull's cubes as a closed mesh: vertices (v, 3), faces (f, 3) wound outward."""
    first = grid.centre[0, 0, 0]
    step = [grid.centre[1, 0, 0] - first, grid.centre[0, 1, 0] - first, grid.centre[0, 0, 1] - first]
    return boundary_of(first, np.stack(step), solid)


def boundary_of(first: np.ndarray, steps: np.ndarray, solid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same of cubes whose first has its middle at `first` (3,), with a row of `steps` (3, 3) between neighbours."""
    origin = first - 0.5 * steps.sum(0)
    padded = np.pad(solid, 1)
    corners, quads = [], 0
    for axis in range(3):
        across = [k for k in range(3) if k != axis]
        u, v = np.eye(3, dtype=int)[across]
        # u x v points along the axis, or against it
        flip = np.linalg.det([np.eye(3)[axis], u, v]) < 0
        for side in (1, -1):
            beside = np.roll(padded, -side, axis)
            at = np.argwhere(padded & ~beside) - 1
            base = at + (np.eye(3, dtype=int)[axis] if side == 1 else 0)
            quad = np.stack([base, base + u, base + u + v, base + v], axis=1)
            corners.append(quad[:, ::-1] if (side == -1) != flip else quad)
            quads += len(at)
    lattice, index = np.unique(np.concatenate(corners).reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(quads, 4)
    faces = np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]])
    handed = np.linalg.det(steps) < 0
    return origin + lattice @ steps, faces[:, ::-1] if handed else faces


def on_mesh(vertices: np.ndarray, faces: np.ndarray) -> Cloud:
    """A mesh's vertices (v, 3) as points that no view has measured; faces (f, 3)."""
    from massprops.surface.refine import vertex_normals

    edge = float(np.linalg.norm(vertices[faces[0, 1]] - vertices[faces[0, 0]]))
    none = np.zeros(len(vertices) + 1, np.int64)
    sigma = np.full(len(vertices), edge)
    return Cloud(vertices, vertex_normals(vertices, faces), sigma, none, np.zeros(0, np.int64))


@dataclass(frozen=True)
class HiddenShape:
    """The hull of what hides its support.

    Attributes:
        vertices, faces: its boundary, (v, 3) and (f, 3); cubes may touch along edges.
        agreement: median over the views of the intersection over union of its silhouette and of where the support is
            hidden.
    """

    vertices: np.ndarray
    faces: np.ndarray
    agreement: float


NEARBY = 12
"""Cells about a silhouette in which the surroundings should show, or else speak against it."""


def drawn_agreement(views: Views, maps: Occlusion, shapes: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """(n, s) intersection over union of each shape's silhouette and of where something hides the support.

    Tells which placement of an object an image shows: the room that stayed says where each would be seen.

    Args:
        views: n views; maps: of these views.
        shapes: s meshes, vertices (v, 3) and faces (f, 3).
    """
    import cv2

    from massprops.geometry.rasterise import silhouette

    out = np.zeros((len(views), len(shapes)))
    for i, state in enumerate(maps.state):
        w, h = (int(x) for x in views.size[i])
        for k, (vertices, faces) in enumerate(shapes):
            seen = silhouette(vertices, faces, views.K[i], views.R[i], views.t[i], (w, h)).astype(np.uint8)
            drawn = cv2.resize(seen, state.shape[::-1], interpolation=cv2.INTER_AREA)
            near = cv2.dilate(drawn, np.ones((3, 3), np.uint8), iterations=NEARBY) > 0
            union = np.count_nonzero(((state == -1) & near) | ((drawn > 0) & (state != 0)))
            out[i, k] = np.count_nonzero((state == -1) & (drawn > 0)) / union if union else 0.0
    return out


def support_agreement(views: Views, maps: Occlusion, vertices: np.ndarray, faces: np.ndarray) -> float:
    """Median over the views of `drawn_agreement` for one shape, vertices (v, 3) and faces (f, 3)."""
    return float(np.median(drawn_agreement(views, maps, [(vertices, faces)])))


def hidden_by(views: Views, maps: Occlusion, vertices: np.ndarray, faces: np.ndarray) -> Occlusion:
    """The maps where a measured shape, vertices (v, 3) and faces (f, 3), hides the surroundings too.

    No view sees the support through what stereo has measured, though a grey thing on a grey cloth looks like it.
    """
    from massprops.geometry.rasterise import silhouette

    states = []
    for i, state in enumerate(maps.state):
        size = (int(views.size[i, 0]), int(views.size[i, 1]))
        drawn = silhouette(vertices, faces, views.K[i], views.R[i], views.t[i], size)
        states.append(np.where(_share_of_cells(drawn, state) > 0.5, -1, state).astype(np.int8))
    return Occlusion(states, maps.cell)


def held_share(views: Views, vertices: np.ndarray, faces: np.ndarray, xyz: np.ndarray) -> float:
    """Median over the views of the share of points (m, 3) that fall on a shape's silhouette, or beside it by a cell.

    What stereo measured of an object is part of it: a hull that leaves it out is the hull of a part.
    """
    from massprops.capture.from_shape import share_covered
    from massprops.geometry.rasterise import silhouette

    shares = []
    for i in range(len(views)):
        w, h = (int(x) for x in views.size[i])
        camera = views.K[i], views.R[i], views.t[i]
        margin = int(np.ceil(CELL * min(h, w) / 480))
        shares.append(share_covered(silhouette(vertices, faces, *camera, (w, h)), margin, xyz, *camera))
    known = [share for share in shares if share is not None]
    return float(np.median(known)) if known else 0.0


def settled(label: np.ndarray, agreement: np.ndarray) -> np.ndarray:
    """(n,) the placement that each image shows, by where the support is hidden in it; -1 where that does not tell.

    Args:
        label: (n,) as far as known, -1 for the others.
        agreement: (n, s) of `drawn_agreement`.
    """
    order = np.argsort(-agreement, axis=1, kind="stable")
    every = np.arange(len(label))
    best, ahead = order[:, 0], agreement[every, order[:, 0]] - agreement[every, order[:, 1]]
    least = np.where(label < 0, AHEAD, OVERRULES)
    sure = (agreement[every, best] > LEAST_DRAWN) & (ahead > least)
    return np.where(sure, best, label)


LEAST_DRAWN, AHEAD, OVERRULES = 0.2, 0.05, 0.15
"""An image shows the placement whose silhouette agrees with what it hides to this share at least, and by so much better
than any other's; the second margin where the order of capture says otherwise. On a glossy part turned over (56 images, 17
without a feature in common, three in a group of their own) all were told rightly; the narrowest margin was 0.09, that of
the three 0.24. What the object's own features say stands: of a padlock on a plain grey cloth 17 of 20 images, told rightly
by 12 to 225 features, would have gone to the wrong placement."""

LEAST_VOXELS = 60
"""Cubes of the coarse grid without which there is no shape."""
LEAST_AGREEMENT = 0.4
"""Agreement below which a hull explains too little of what is hidden to be an object. A plain cup before wood that
mirrors a window had 0.6."""


def hidden_shape(views: Views, maps: Occlusion, plane: np.ndarray, region: Region) -> HiddenShape | None:
    """The object as far as it hides what it stands on, or None where nothing does so consistently.

    Args:
        views: n views of one placement; maps: of these views.
        plane: (4,) of the support; region: where the cameras look.
    """
    everyone = np.arange(len(views))
    coarse = voxels(views, maps, plane, region, COARSE)
    solid = hull(coarse, everyone)
    if solid.sum() < LEAST_VOXELS:
        return None
    agreement = float(np.median(explained(coarse, maps, solid, everyone)))
    if agreement < LEAST_AGREEMENT:
        return None
    fine = voxels(views, maps, plane, region, FINE)
    vertices, faces = boundary(fine, hull(fine, everyone))
    return HiddenShape(vertices, faces, agreement)
