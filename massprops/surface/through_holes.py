"""Holes that go through a body although nothing was measured in their middle.

Stereo measures the walls of a bore at both of its mouths, and nothing in the dark between: the surface is closed there. Where
the walls of two mouths that face each other leave the same section free, and nothing between was measured, one hole is the
simplest body that shows both. It is opened by the space between the two sections. How deep a hole with one mouth goes, nothing
tells (`holes`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from massprops.mass.bodies import solid
from massprops.mass.integrals import face_areas
from massprops.surface.holes import Surface
from massprops.surface.hollow import Grid, integrals_of
from massprops.surface.layers import Layers, layers_across
from massprops.surface.level_set import level_set
from massprops.surface.refine import face_normals

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

ALIKE = 0.6
"""Share of either of two sections that the other covers to a cell above which they belong to one hole. Set on two machined parts (Blender):
their bores have .93, a slot of which one mouth was half filled in .64, screw holes .82 and .95, most pairs of other dark places at most
.32. By itself it tells little: most of the place must lie between the sections."""
MEASURED = 0.8
"""Share of a section's rim that was measured from which on the section is believed; deeper in, the fill narrows it. Set on the
same part."""
SAME_DIRECTION = 0.996
"""Cosine above which two directions are tried as one (5 degrees)."""
DIRECTIONS = 6
"""Main directions of the body's sides that are tried."""
VOTERS = 10_000
"""Faces by which they are chosen."""
SMALLEST = 12
"""Cells of a section below which nothing is opened."""
FALLS_OFF = 0.01
"""Share of the volume that may fall off as crumbs where a hole is opened."""
ROUNDS = 3
"""How often the direction is taken anew from the middles of the two sections."""


@dataclass(frozen=True)
class Tube:
    """The space of a hole between its mouths, in the units and axes of the body.

    Attributes:
        vertices: (v, 3); faces: (f, 3), closed and wound outward.
        unsure: integrals (10,) of the space in which its two mouths differ, about the origin of the vertices.
    """

    vertices: np.ndarray
    faces: np.ndarray
    unsure: np.ndarray


class _Section(NamedTuple):
    """Free cells (a, b) bool of a layer; middle (3,) of them in the body's axes."""

    free: np.ndarray
    layer: int
    middle: np.ndarray


class _Mouths(NamedTuple):
    """The two ends of a hole along a direction, and how much their sections are alike."""

    layers: Layers
    upper: _Section
    lower: _Section
    alike: float

    def contains(self, points: np.ndarray) -> bool:
        """Whether most of the points (k, 3) lie between the mouths."""
        grid = self.layers.grid
        local = points @ grid.base.T + [0.0, 0.0, grid.offset]
        i, j, k = np.floor((local - grid.corner) / grid.step).astype(int).T
        within = (self.upper.free | self.lower.free)[i, j] & (k >= self.lower.layer) & (k <= self.upper.layer)
        return bool(within.mean() > 0.5)


def through_holes(body: Surface, places: list[np.ndarray]) -> tuple[list[Tube], list[np.ndarray]]:
    """Holes between two mouths, and the places (indices of faces) that belong to none.

    Args:
        body: closed and wound outward.
        places: faces that may be the mouths of holes (`holes.dark_places`), of each.
    """
    from scipy.spatial import cKDTree

    normal = face_normals(body.vertices, body.faces)
    middle, area = body.vertices[body.faces].mean(axis=1), face_areas(body.vertices, body.faces)
    faces = cKDTree(middle)
    directions = _directions(area, normal, body.observed, places)
    mouth_pairs: list[_Mouths] = []
    remaining_places = []
    cut: dict[bytes, Layers | None] = {}
    for place in sorted(places, key=lambda p: -float(area[p].sum())):
        if any(mouths.contains(middle[place]) for mouths in mouth_pairs):
            continue
        up = [d if area[place] @ normal[place] @ d >= 0 else -d for d in directions]
        others = [p for p in places if p is not place]
        mouths = _mouths(body, faces, place, up, cut) or _lids(body, place, others, up, cut)
        if mouths is None:
            remaining_places.append(place)
        else:
            mouth_pairs.append(mouths)
    remaining_places = [
        place for place in remaining_places if not any(mouths.contains(middle[place]) for mouths in mouth_pairs)
    ]
    return [_tube(mouths) for mouths in mouth_pairs], remaining_places


def opened(body: Surface, tubes: list[Tube]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """The body without the tubes: vertices (v, 3), faces (f, 3) int32, observed and inferred (f,) bool; walls of the tubes
    are neither. None where they cannot be taken out, or part the body: a hole does not."""
    from scipy.spatial import cKDTree

    solids = [solid(body.vertices, body.faces), *(solid(tube.vertices, tube.faces) for tube in tubes)]
    if any(part is None for part in solids):
        return None
    # names its faces, so that those of the tubes can be told
    whole = solids[0].as_original()
    rest = whole
    for tube in solids[1:]:
        rest = rest - tube
    largest = max(rest.decompose(), key=lambda part: float(part.volume()), default=None)
    if largest is None or largest.volume() < (1.0 - FALLS_OFF) * rest.volume():
        return None
    made = largest.to_mesh64()
    vertices, faces = np.array(made.vert_properties[:, :3]), np.array(made.tri_verts, np.int32)
    run = np.searchsorted(np.asarray(made.run_index) // 3, np.arange(len(faces)), side="right") - 1
    of_body = np.asarray(made.run_original_id)[run] == whole.original_id()
    nearest = cKDTree(body.vertices[body.faces].mean(axis=1)).query(vertices[faces].mean(axis=1))[1]
    return vertices, faces, of_body & body.observed[nearest], of_body & body.inferred[nearest]


def with_open_holes(rows: np.ndarray, unsure: np.ndarray, seed: int) -> np.ndarray:
    """Replicates (r, 10) of an opened body: any share of the space (10,) in which the mouths differ may be empty, and half of
    it is."""
    share = np.random.default_rng([seed, 32]).random(len(rows))[:, None] - 0.5
    return np.asarray(rows + share * unsure)


def _directions(
    area: np.ndarray, normal: np.ndarray, observed: np.ndarray, places: list[np.ndarray]
) -> list[np.ndarray]:
    """Directions (3,) in which a hole may go: those that the places face, and across the body's largest flat sides."""
    mean = [area[p] @ normal[p] for p in places]
    tried = [m / np.linalg.norm(m) for m in mean if np.linalg.norm(m) > 0.0]
    remaining, weight = normal[observed], area[observed]
    for _ in range(DIRECTIONS):
        if not len(remaining):
            break
        some, voters = (slice(None, None, max(1, len(remaining) // n)) for n in (500, VOTERS))
        best = remaining[some][
            np.argmax((np.abs(remaining[some] @ remaining[voters].T) > SAME_DIRECTION) @ weight[voters])
        ]
        near = np.abs(remaining @ best) > SAME_DIRECTION
        flat = np.linalg.eigh((remaining[near] * weight[near, None]).T @ remaining[near])[1][:, 2]
        tried.append(flat)
        remaining, weight = remaining[~near], weight[~near]
    kept: list[np.ndarray] = []
    for direction in tried:
        if all(abs(direction @ other) < SAME_DIRECTION for other in kept):
            kept.append(direction)
    return kept


def _kept_layers(body: Surface, up: np.ndarray, cut: dict[bytes, Layers | None]) -> Layers | None:
    """As `layers_across`, which `cut` keeps by direction."""
    if up.tobytes() not in cut:
        cut[up.tobytes()] = layers_across(body.vertices, body.faces, up)
    return cut[up.tobytes()]


def _mouths(
    body: Surface, faces: cKDTree, place: np.ndarray, directions: list[np.ndarray], cut: dict[bytes, Layers | None]
) -> _Mouths | None:
    """The best pair of mouths of which the place closes one; `cut` keeps the layers of a direction."""
    best = None
    for first in directions:
        up = first
        for _ in range(ROUNDS):
            layers = _kept_layers(body, up, cut)
            pair = None if layers is None else _pair(body, faces, place, layers)
            if pair is None:
                break
            inside = pair.contains(body.vertices[body.faces[place]].mean(axis=1))
            if inside and (best is None or pair.alike > best.alike):
                best = pair
            line = pair.upper.middle - pair.lower.middle
            up = line / np.linalg.norm(line)
    return best if best is not None and best.alike > ALIKE else None


def _pair(body: Surface, faces: cKDTree, place: np.ndarray, layers: Layers) -> _Mouths | None:
    """The sections above the place and below what lies under it, where nothing was measured there."""
    top = np.flatnonzero(np.isin(layers.face, place) & (layers.rank % 2 == 1))
    if not len(top) or body.observed[layers.face[top - 1]].mean() > 0.5:
        return None
    columns, low, step = layers.cell[top], layers.grid.corner[2], layers.grid.step[2]
    middle = int((np.median(0.5 * (layers.height[top] + layers.height[top - 1])) - low) / step)
    upper = _section(body, faces, layers, columns, range(middle, layers.piece.shape[2]))
    lower = _section(body, faces, layers, columns, range(middle - 1, -1, -1))
    if upper is None or lower is None:
        return None
    return _Mouths(layers, upper, lower, _alike(upper.free, lower.free))


def _lids(
    body: Surface,
    place: np.ndarray,
    others: list[np.ndarray],
    directions: list[np.ndarray],
    cut: dict[bytes, Layers | None],
) -> _Mouths | None:
    """The place and the one of the `others` that closes the other end of a hole without measured walls: along the direction
    each covers the other, and the body between them is bounded by these two."""
    best = None
    for up in directions:
        layers = _kept_layers(body, up, cut)
        if layers is None:
            continue
        ends = layers.rank % 2 == 1
        top = np.flatnonzero(np.isin(layers.face, place) & ends)
        for other in others:
            bottom = np.flatnonzero(np.isin(layers.face, other) & ~ends)
            both = np.intersect1d(top - 1, bottom)
            if len(both) < SMALLEST:
                continue
            alike = _alike(*(_covered(layers, crossings) for crossings in (top, bottom)))
            if alike > max(ALIKE, 0.0 if best is None else best.alike):
                best = _Mouths(layers, _lid(layers, top, 1), _lid(layers, bottom, -1), alike)
    return best


def _covered(layers: Layers, crossings: np.ndarray) -> np.ndarray:
    """(a, b) bool, the columns of some crossings."""
    out = np.zeros(layers.piece.shape[:2], bool)
    out.ravel()[layers.cell[crossings]] = True
    return out


def _alike(one: np.ndarray, other: np.ndarray) -> float:
    """How far either of two sections (a, b) bool covers the other, each known to a cell: the lesser of both shares.

    The edge of a dark place is a pixel or two wide, as a cell is: of screw holes 7 cells across the two ends overlapped by .42 and
    .57 (intersection over union).
    """
    from scipy.ndimage import binary_dilation

    around = np.ones((3, 3), bool)
    shares = [binary_dilation(b, around)[a].mean() if a.any() else 0.0 for a, b in ((one, other), (other, one))]
    return float(min(shares))


def _lid(layers: Layers, crossings: np.ndarray, side: int) -> _Section:
    """What a place covers, at its highest (`side` 1) or lowest (-1) layer and one beyond."""
    grid = layers.grid
    free = _covered(layers, crossings)
    level = (layers.height[crossings] - grid.corner[2]) / grid.step[2]
    layer = int(np.clip(side * np.max(side * level) + side, 0, layers.piece.shape[2] - 1))
    return _section_at(grid, free, layer)


def _section_at(grid: Grid, free: np.ndarray, layer: int) -> _Section:
    """The free cells (a, b) bool of a layer as a section."""
    cells = np.argwhere(free)
    return _Section(free, layer, grid.world(np.column_stack([cells, np.full(len(cells), layer)])).mean(axis=0))


def _section(body: Surface, faces: cKDTree, layers: Layers, columns: np.ndarray, order: range) -> _Section | None:
    """The free space over the columns in the first layer, from inside, whose rim was measured, else in the one of which
    most was. None where the walls close about nothing."""
    from scipy.ndimage import binary_erosion

    best, share = None, 0.0
    for k in order:
        flat = layers.piece[:, :, k]
        pieces = flat.ravel()[columns]
        pieces = pieces[pieces > 0]
        if not len(pieces):
            if best is not None:
                break
            continue
        free = flat == np.bincount(pieces).argmax()
        rim = np.argwhere(free & ~binary_erosion(free))
        at = layers.grid.world(np.column_stack([rim, np.full(len(rim), k)]))
        rim_measured = float(body.observed[faces.query(at)[1]].mean())
        if rim_measured > share and np.count_nonzero(free) >= SMALLEST:
            best, share = _section_at(layers.grid, free, k), rim_measured
        if share >= MEASURED:
            break
    return best


def _tube(mouths: _Mouths) -> Tube:
    """The space between the two sections, whose outlines go over into each other."""
    grid, upper, lower = mouths.layers.grid, mouths.upper, mouths.lower
    either = upper.free | lower.free
    corner = np.maximum(np.argwhere(either).min(axis=0) - 3, 0)
    end = np.argwhere(either).max(axis=0) + 4
    part = slice(corner[0], end[0]), slice(corner[1], end[1])
    share = np.linspace(0.0, 1.0, upper.layer - lower.layer + 1)
    low, high = _outside(lower.free[part]), _outside(upper.free[part])
    value = (1.0 - share) * low[:, :, None] + share * high[:, :, None]
    value = np.pad(value, 1, constant_values=1.0)
    vertices, faces = level_set(value, np.array([*corner, lower.layer], float) - 1.0, 1.0)
    unlike = np.repeat((upper.free ^ lower.free)[:, :, None], len(share), axis=2)
    index = np.argwhere(unlike) + [0, 0, lower.layer]
    return Tube(grid.world(vertices), faces, integrals_of(index, grid))


def _outside(free: np.ndarray) -> np.ndarray:
    """(a, b) distance from the free cells' outline, negative within them [cells], without the cells' steps."""
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    distance = distance_transform_edt(~free) - distance_transform_edt(free)
    return np.asarray(gaussian_filter(distance - 0.5 * np.sign(distance), 1.0))
