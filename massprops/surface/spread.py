"""Replicates of the body: what its integrals might have been, given everything that is uncertain about its surface.

A surface moved along its normals by d(s) changes the integral of g by int g d dA (Reynolds), so a replicate is a
vector of offsets, one a face, and costs one product of matrices. Each replicate adds

1. resampled views: views are drawn with replacement in blocks of neighbours (block bootstrap, Kuensch 1989), and the
   mean residual of each patch's points is recomputed with the drawn views;
2. a common offset of all measured faces, `BIAS_PIXELS` of a pixel at the object, or as much as the points `scatter` there:
   matching windows and outlines err alike everywhere (of all faces where there are only outlines). Where brightness measured them,
   their slope over the distance from an outline: creases are rounded and light each other all alike, and each side is off besides;
3. the focal length: a symmetric strain with entries N(0, sigma_focal), which is how an error of self-calibration deforms
   a shape whose poses were fitted with it;
4. patches of one side, and unmeasured faces in proportion to their distance from measured surface (`error_modes`), and on
   a still object from where outlines show it; as far as the part is thick, and silhouettes leave room (`fill_bounds`); what was
   closed at a plane of support, inward, and as the plane's height is off;
5. how placements of an object that was turned over lie on each other;
6. cameras that drift: where the object's outlines lie outside or inside the mesh's (`outline_gaps`) the surface is off by
   that; as far as they scatter about it, it is off in patches and bent as a whole; of a still object, either of the two may be
   wrong in either direction, as silhouettes take in shadows and plain sides are measured too deep: a bottle was 1.0 px too small
   where its outlines said 0.5 outside, a padlock 0.6 px too large where they said 0.8 outside;
7. tips that stereo did not measure, where the silhouettes of a free body leave room for them.

Of a body that moves freely, what would move its centre of mass away from where the motion shows it did not happen (`balancing`). The
cross-check, which asks whether shape and motion agree at all, goes by the replicates before that.

The greatest length of each replicate is kept beside its integrals, since it is the model unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from massprops.mass.integrals import PAIRS, mesh_integrals, offset_response
from massprops.surface.error_modes import COMMON, REACH, SIDE_PIXELS, fill_modes, measured_modes, underside_modes
from massprops.surface.fill_bounds import beyond_bounds
from massprops.surface.fill_by_motion import Balance
from massprops.surface.length import model_length
from massprops.surface.outline_gaps import OUTLINE_SIGMA, SILHOUETTE_MARGIN, Gaps
from massprops.surface.reconstruct import ON_SUPPORT, Surface
from massprops.surface.refine import face_normals, residuals, vertex_normals
from massprops.surface.scatter import WINDOW, face_scatter
from massprops.views import entries

BIAS_PIXELS = 0.15
"""Least 1-sigma of the offset common to all measured faces [px]."""
WIDENED = 1.2
"""Of the half of the draws in which a mesh is off as its outlines say: one in twenty of all is off by twice that."""
DARK_MEAN, DARK_SIGMA = -0.3, 0.3
"""Mean and 1-sigma of the offset common to what was never seen lit of a body that turns, over its distance from measured
surface: silhouettes of lit parts leave room behind the terminator, and the fill takes most of it. Set on 17 films of six
bodies, some of them badly filmed; with -0.2 and 0.4 the small asteroid of `tests/run`, a fifth of which is filled in, had a wider interval than it should."""
ACROSS = 0.9
"""Cosine between the length and the surface at its end from which on that surface ends the body: the side of a rod that stereo lost
before its tip looks across the length."""
END_PIXELS = 1.7
"""1-sigma by which either end of a still object may be off [px]: windows of stereo round its rims off, and fill reaches out. On six
scanned objects and a machined part (Blender) the length was off by -0.5, -1.2, +0.6, -1.9, -1.8, -3.7 and +4.3 px over both ends, 2.4
in the root mean square. Of a body that turns before a dark sky, whose ends all of its outlines show, it is 0.2 to 0.7 px."""
FOOT_PIXELS = 4.2
"""1-sigma by which an end on the support may reach beyond the body [px]: a rounded foot cannot be told from its shadow, and is closed as if it went
straight down. Of a bottle, a box, a shoe, a chair and a figure (Blender) such an end was -0.5, +2.0, +0.9, -0.2 and +2.2 px off, of a jug
with a rounded foot +7.9 and +11.1 px, drawn twice: 4.2 in the root mean square of the six."""
PATCHES = 400
"""Patches into which the measured surface is cut at most."""


@dataclass(frozen=True)
class Joint:
    """How well a placement's views are joined to the others.

    Attributes:
        first, last: its views are these and those between.
        about: (3,) place about which it may be turned.
        covariance: (6, 6) of that turn [rad] and of a shift.
    """

    first: int
    last: int
    about: np.ndarray
    covariance: np.ndarray

    def drawn(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, 6) turns and shifts; the covariance may be singular."""
        size, axes = np.linalg.eigh(self.covariance)
        return np.asarray(rng.standard_normal((count, 6)) * np.sqrt(np.maximum(size, 0.0)) @ axes.T)


@dataclass(frozen=True)
class ErrorSources:
    """What is uncertain beside the surface's own points.

    Attributes:
        focal: relative 1-sigma of the focal length.
        gaps: between the mesh's outlines and the images', or None where outlines alone made the mesh.
        never_lit: what was not measured was never seen lit: the body turns, and the Sun stands.
        balanced: how far that reaches was chosen by the centre of mass that the motion shows.
        joints: of placements that were joined.
        shown: (k, 3) places that silhouettes show at times, of a part whose end the mesh may miss.
    """

    focal: float = 0.0
    gaps: Gaps | None = None
    never_lit: bool = False
    balanced: bool = False
    joints: Sequence[Joint] = ()
    shown: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))


def replicates(
    surface: Surface,
    views: int,
    sources: ErrorSources,
    count: int = 1000,
    blocks: int = 12,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Integrals and greatest lengths of `count` bodies that the data allow.

    Args:
        surface: the estimate, with its cloud and hull.
        views: number of views the cloud's lists refer to.
        sources: what else is uncertain.
        count: replicates.
        blocks: blocks of neighbouring views that are drawn together.
        seed: of the draws.

    Returns:
        rows (count, 10) about the world origin, lengths (count,); units of the reconstruction.
    """
    rng = np.random.default_rng([seed, 14])
    mesh, pixel = (surface.vertices, surface.faces), surface.hull.pixel
    response, ends = offset_response(*mesh), _ends(surface)
    rows, lengths = np.tile(mesh_integrals(*mesh), (count, 1)), np.full(count, ends.length)
    patch = _patches(surface, rng)

    def add(drawn: np.ndarray, modes: np.ndarray) -> None:
        """Offsets of the faces, drawn (count, m) times modes (m, f), to the integrals and lengths."""
        np.add(rows, drawn @ (modes @ response), out=rows)
        np.add(lengths, drawn @ (modes[:, ends.face] @ ends.pull), out=lengths)

    middle, window = mesh[0][mesh[1]].mean(axis=1), max(2 * surface.spacing, WINDOW * pixel)
    scatter = face_scatter(middle, surface.observed, surface.cloud, window, rng)
    drift = sources.gaps.drift * pixel if sources.gaps else 0.0
    lean = _leaning(surface, sources, ends.length)
    add(rng.standard_normal((count, 1)), np.hypot(_common(surface, scatter), lean)[None])
    if sources.gaps:
        add(_of_outlines(count, rng, sources.never_lit), sources.gaps.offset[None] * pixel)
    offset = _bootstrap(surface, patch, views, count, blocks, rng)
    rows += offset @ _by_patch(response, patch, offset.shape[1])
    for e in (0, 1):
        if patch[ends.face[e]] >= 0:
            lengths += offset[:, patch[ends.face[e]]] * ends.pull[e]

    by_side = np.hypot(np.hypot(np.maximum(SIDE_PIXELS * pixel, scatter), drift), lean)
    of_measured = measured_modes(*mesh, surface.observed, ends.length, by_side)
    add(rng.standard_normal((count, len(of_measured))), of_measured)
    of_fill, of_replicates = _of_fill(surface, sources, ends.length, count, rng)
    add(of_replicates, of_fill)
    rows -= beyond_bounds(mesh, surface.hull, of_fill, of_replicates, response)

    for joint in sources.joints:
        add(joint.drawn(count, rng), _carried(surface, joint))

    lengths += _of_ends(surface, ends, count, rng, sources)
    size = np.hypot(sources.focal, drift / float(np.sqrt(mesh[0].var(axis=0).sum())))
    strain = _strains(size, count, rng)
    lengths *= 1 + np.einsum("rij,i,j->r", strain, ends.direction, ends.direction)
    return deform(rows, strain), np.maximum(lengths, 0.1 * ends.length)


def balancing(
    rows: np.ndarray, lengths: np.ndarray, own: np.ndarray, balance: Balance, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Replicates (r, 10) and lengths (r,) of bodies whose centre of mass lies where the motion shows it, to first order: each is moved by
    what its own centre is off, as far as the others' numbers move with theirs (Matheron's rule, Journel and Huijbregts 1978).

    Where the replicates' centres miss that place by more than they scatter, they scatter too little, and so do all of their numbers: they are
    spread by as much (Birge 1932, "The calculation of errors by the method of least squares").

    Args:
        own: (10,) of the mesh.
    """
    centre = own[1:4] / own[0]
    apart = np.column_stack([rows - own, lengths])
    at = (apart[:, 1:4] - apart[:, :1] * centre) / own[0]
    apart, away = apart - apart.mean(axis=0), at - at.mean(axis=0)
    both, seen = apart.T @ away / len(rows), away.T @ away / len(rows) + balance.covariance
    noise = rng.multivariate_normal(np.zeros(3), balance.covariance, len(rows), method="cholesky")
    change = (centre + at + noise - balance.place) @ np.linalg.solve(seen, both.T)
    moved, missed = rows - change[:, :10], centre + at.mean(axis=0) - balance.place
    spread = np.sqrt(max(float(missed @ np.linalg.solve(seen, missed)) / 3, 1.0))
    return moved.mean(axis=0) + spread * (moved - moved.mean(axis=0)), lengths - change[:, 10]


def with_rivals(rows: np.ndarray, rivals: Sequence[tuple[float, np.ndarray]], rng: np.random.Generator) -> np.ndarray:
    """Replicates (r, 10) of which as many are filled in another way as it is likely.

    Args:
        rivals: the chance of each such way, and by how much its integrals (10,) are others.
    """
    drawn, before, out = rng.random(len(rows)), 0.0, rows.copy()
    for chance, change in rivals:
        out[(before <= drawn) & (drawn < before + chance)] += change
        before += chance
    return out


def _of_outlines(count: int, rng: np.random.Generator, free: bool) -> np.ndarray:
    """(count, 1) shares of the gaps to the outlines by which the mesh is off."""
    drawn = rng.standard_normal((count, 1))
    # a free body's mesh is off by them, or its silhouettes are wide and it is not
    return WIDENED * np.maximum(drawn, 0.0) if free else drawn


def _strains(size: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3, 3) symmetric strains with entries N(0, size) before they are made symmetric: poses that are off by the drift where
    the body's outlines are deform it as an error of the focal length does."""
    drawn = size * rng.standard_normal((count, 3, 3))
    return 0.5 * (drawn + drawn.transpose(0, 2, 1))


def _common(surface: Surface, scatter: np.ndarray) -> np.ndarray:
    """(f,) 1-sigma of the offset common to all measured faces, or to all where there are only outlines."""
    shown = surface.observed if surface.observed.any() else np.ones(len(surface.faces), bool)
    return np.where(shown, np.maximum(BIAS_PIXELS * surface.hull.pixel, scatter), 0.0)


def _leaning(surface: Surface, sources: ErrorSources, length: float) -> np.ndarray:
    """(f,) 1-sigma by which faces whose brightness was measured are off [world units]: their slope over the distance from where outlines
    show them, no farther than the body is long, beside what those are off themselves; 0 of any other surface. Without the latter k of two of
    three bodies of plaster (Blender) was .011 to .017 off and outside, of volumes known to 2 %."""
    if surface.slope is None:
        return np.zeros(len(surface.faces))
    away = np.full(len(surface.faces), length) if sources.gaps is None else np.minimum(sources.gaps.distance, length)
    sigma = np.hypot(surface.slope * away, OUTLINE_SIGMA * surface.hull.pixel)
    return np.where(surface.observed, sigma, 0.0)


def _outlined(surface: Surface, sources: ErrorSources, length: float) -> np.ndarray | None:
    """(f,) distance from where outlines show the mesh, which they do to the margin of a silhouette: fill of still objects that was
    brought out to them was 1.1, 0.7, -0.3 and -0.7 px off in the middle on four rendered things. None of a free body that stereo
    measured; length: of the body."""
    if sources.never_lit and surface.observed.any():
        return None
    if sources.gaps is None:
        return np.full(len(surface.faces), np.inf) if surface.observed.any() else None
    away = sources.gaps.distance
    if surface.observed.any():
        away = np.where(away <= REACH * length, away, np.inf)
    else:
        away = np.minimum(away, length)
    return np.asarray(away + SILHOUETTE_MARGIN * surface.hull.pixel / COMMON)


def _of_fill(
    surface: Surface, sources: ErrorSources, length: float, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """(m, f) modes of what was not measured, and (count, m) of each replicate in sigmas; length: of the body."""
    mesh, outlined = (surface.vertices, surface.faces), _outlined(surface, sources, length)
    modes = fill_modes(*mesh, surface.observed, length, surface.inferred, outlined)
    below = underside_modes(*mesh, surface.observed, surface.inferred, surface.hull.pixel, outlined)
    drawn = _fill_draws(surface, sources, (count, len(modes)), rng)
    under = rng.standard_normal((count, len(below)))
    under[:, :1] = -np.abs(under[:, :1])
    return np.concatenate([modes, below]), np.concatenate([drawn, under], axis=1)


def _fill_draws(
    surface: Surface, sources: ErrorSources, shape: tuple[int, int], rng: np.random.Generator
) -> np.ndarray:
    """(count, modes) of how far a fill is off, in sigmas of its modes, of which the first is common to all."""
    drawn = rng.standard_normal(shape)
    if not shape[1]:
        return drawn
    if not surface.observed.any():
        # a hull holds its body: what it hides is inward
        drawn[:, 0] = -np.abs(drawn[:, 0])
        drawn[:, 1:] *= 0.5
    elif sources.never_lit:
        drawn[:, 0] = ((0.0 if sources.balanced else DARK_MEAN) + DARK_SIGMA * drawn[:, 0]) / COMMON
    return drawn


def _carried(surface: Surface, joint: Joint) -> np.ndarray:
    """(6, f) outward offsets of the faces for unit turns and shifts of a placement, as far as its views measured them."""
    from scipy.spatial import cKDTree

    cloud = surface.cloud
    middle, normal = surface.vertices[surface.faces].mean(axis=1), face_normals(surface.vertices, surface.faces)
    of_placement = ((cloud.view_index >= joint.first) & (cloud.view_index <= joint.last)).astype(float)
    point = np.repeat(np.arange(len(cloud)), np.diff(cloud.view_start))
    share = np.bincount(point, of_placement, len(cloud)) / np.maximum(np.diff(cloud.view_start), 1)
    near = cKDTree(cloud.xyz).query(middle, k=min(8, len(cloud)))[1].reshape(len(middle), -1)
    rows = np.concatenate([np.cross(middle - joint.about, normal), normal], axis=1)
    return np.asarray((share[near].mean(axis=1)[:, None] * rows).T)


class _Ends(NamedTuple):
    """Of the greatest length: length, direction (3,), a face at each end (2,), and how much longer the body gets when that
    face moves outward, pull (2,); place: (2, 3) of the ends; measured: (2,) bool, all about it was measured and looks along the
    length, so that nothing goes on there; foot: (2,) bool, it lies on the support."""

    length: float
    direction: np.ndarray
    face: np.ndarray
    pull: np.ndarray
    place: np.ndarray
    measured: np.ndarray
    foot: np.ndarray


def _of_ends(surface: Surface, ends: _Ends, count: int, rng: np.random.Generator, sources: ErrorSources) -> np.ndarray:
    """(count,) how much longer the body may be. Each end is one vertex, as uncertain as the points about it, that of a still object as
    a rim; that of a free body may be a tip which stereo did not measure, where the silhouettes leave room for it beside their own margin, or
    show it when it is lit."""
    free = sources.never_lit
    sigma = float(np.hypot(np.median(surface.cloud.sigma), 0.0 if free else END_PIXELS * surface.hull.pixel))
    out: np.ndarray = sigma * np.sqrt(2.0) * rng.standard_normal(count)
    if ends.foot.any():
        out -= FOOT_PIXELS * surface.hull.pixel * np.abs(rng.standard_normal((count, 2))) @ ends.foot
    if free:
        outward = np.array([-ends.direction, ends.direction])
        room = np.where(ends.measured, 0.0, surface.hull.room(ends.place, outward, 0.5 * ends.length))
        room = room - SILHOUETTE_MARGIN * surface.hull.pixel
        if len(sources.shown):
            room = np.maximum(room, [np.max((sources.shown - p) @ d) for p, d in zip(ends.place, outward, strict=True)])
        out += rng.random((count, 2)) @ np.maximum(room, 0.0)
    return out


def _ends(surface: Surface) -> _Ends:
    vertices, faces = surface.vertices, surface.faces
    length, end_a, end_b = model_length(vertices, faces, surface.observed)
    ends = np.array([end_a, end_b])
    direction = (vertices[end_b] - vertices[end_a]) / np.linalg.norm(vertices[end_b] - vertices[end_a])
    pull = np.einsum("ij,j->i", vertex_normals(vertices, faces)[ends], direction) * [-1, 1]
    about = [np.flatnonzero((faces == e).any(1)) for e in ends]
    measured = np.array([bool(surface.observed[a].all()) for a in about]) & (pull > ACROSS)
    foot = np.array([bool(surface.inferred[a].any()) for a in about])
    support = surface.hull.support
    if support is not None:
        # measured or not: of a jug's foot the shade about it was
        foot |= np.abs(vertices[ends] @ support[:3] + support[3]) < ON_SUPPORT * surface.spacing
    return _Ends(length, direction, np.array([a[0] for a in about]), pull, vertices[ends], measured, foot)


def _by_patch(response: np.ndarray, patch: np.ndarray, patches: int) -> np.ndarray:
    """(patches, 10) sums of the faces' responses (f, 10)."""
    out = np.zeros((patches, response.shape[1]))
    np.add.at(out, patch[patch >= 0], response[patch >= 0])
    return out


def deform(rows: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Integrals (r, 10) of bodies deformed about their centres by x -> (1 + strain) x; strain (r, 3, 3)."""
    matrix = np.eye(3) + strain
    det = np.linalg.det(matrix)
    volume = rows[:, 0]
    centre = rows[:, 1:4] / volume[:, None]
    second = np.empty((len(rows), 3, 3))
    for k, (i, j) in enumerate(PAIRS):
        second[:, i, j] = second[:, j, i] = rows[:, 4 + k] - volume * centre[:, i] * centre[:, j]
    second = det[:, None, None] * (matrix @ second @ matrix.transpose(0, 2, 1))
    out = np.empty_like(rows)
    out[:, 0] = det * volume
    out[:, 1:4] = out[:, :1] * centre
    for k, (i, j) in enumerate(PAIRS):
        out[:, 4 + k] = second[:, i, j] + out[:, 0] * centre[:, i] * centre[:, j]
    return out


def _patches(surface: Surface, rng: np.random.Generator) -> np.ndarray:
    """(f,) which of at most PATCHES patches each measured face belongs to, -1 for the others."""
    from scipy.spatial import cKDTree

    out = np.full(len(surface.faces), -1)
    seen = np.flatnonzero(surface.observed)
    if len(seen):
        middle = surface.vertices[surface.faces[seen]].mean(1)
        # Position and direction together, so that the two sides of a plate are different patches.
        feature = np.column_stack([middle, 10 * surface.spacing * face_normals(surface.vertices, surface.faces)[seen]])
        seeds = feature[rng.permutation(len(seen))[:PATCHES]]
        out[seen] = cKDTree(seeds).query(feature)[1]
    return out


def _bootstrap(
    surface: Surface, patch: np.ndarray, views: int, count: int, blocks: int, rng: np.random.Generator
) -> np.ndarray:
    """(count, patches) change of each patch's mean residual when views are resampled."""
    patches = int(patch.max()) + 1 if (patch >= 0).any() else 0
    if patches == 0:
        return np.zeros((count, 0))
    cloud = surface.cloud
    point, face, distance = residuals(surface.vertices, surface.faces, cloud, 2 * surface.spacing)
    of_patch = patch[face]
    point, distance, of_patch = point[of_patch >= 0], distance[of_patch >= 0], of_patch[of_patch >= 0]
    which, place = entries(cloud.view_start, point)
    share = 1.0 / np.bincount(which, minlength=len(point))[which]
    code = cloud.view_index[place] * patches + of_patch[which]
    total = np.bincount(code, share * distance[which], views * patches).reshape(views, patches)
    weight = np.bincount(code, share, views * patches).reshape(views, patches)
    blocks = min(blocks, views)
    block = np.arange(views) * blocks // views
    drawn = np.stack([np.bincount(d, minlength=blocks) for d in rng.integers(0, blocks, (count, blocks))])
    w = drawn[:, block].astype(float)
    # A patch that a replicate lost keeps its mean: 2 points of no residual.
    middle = total.sum(0) / (weight.sum(0) + 2)
    return (w @ total) / (w @ weight + 2) - middle
