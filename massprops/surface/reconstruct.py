"""Points and silhouettes to one closed surface.

1. The cloud is thinned and its noise taken out (`cloud`).
2. Rays from below the measured surface find where the silhouettes' hull ends (`silhouette`): the points that carry the
   unseen side, at any thinness.
3. All points are joined by Delaunay tetrahedra; lines of sight say which are empty, the measured normals which are
   inside, the silhouettes which cannot be the object (`tetra`).
4. A minimum cut labels the tetrahedra; its border is closed by construction (`cut`). Measured parts that hang by what
   was not measured are linked to the body (`join`).
5. Measured parts are moved to the middle of the noise, unseen parts are made fair (`refine`).

What no view constrains is filled up to the hull, less `HOLLOW` of the way to a membrane stretched over the measured
rims: recesses lie near the membrane, unseen sides near the hull. What hangs over a support, and all fill of a still object
that stands on no plane, is put on the film of least area over these rims. What of a still object then falls
short of its silhouettes is moved out to them (`outline_fill`).
See `spread` for what that leaves uncertain.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from massprops.core.progress import Progress, silent
from massprops.errors import NotPossible
from massprops.geometry.vectors import sphere
from massprops.mass.integrals import face_areas, mesh_integrals
from massprops.surface.cloud import Cloud, Thinned, thin, without_outliers
from massprops.surface.cut import Costs, manifold, minimum_cut, surface_faces
from massprops.surface.fill_by_motion import Balance, Cut, LikelyFill, Pull, balanced, centre_of, fill_centres, tells
from massprops.surface.flat_side import FlatSide
from massprops.surface.flat_sides import enclosed, flat_sides, in_front, measured_sides
from massprops.surface.join import joined
from massprops.surface.one_thing import hang_together
from massprops.surface.outline_fill import filling_outlines
from massprops.surface.refine import (
    Film,
    face_normals,
    fair,
    least_area,
    measured_faces,
    membrane,
    remove_bias,
    vertex_normals,
    without_islands,
)
from massprops.surface.reflections import reflections
from massprops.surface.silhouette import Hull, hull_points, make_hull
from massprops.surface.silhouette_only import SilhouetteOnly, inside_reward, silhouette_only_space
from massprops.surface.standing_off import standing_off
from massprops.surface.tetra import Tetrahedra, sight_evidence, tetrahedra_at_depth, tetrahedralise
from massprops.views import Views

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

AREA = 0.08
"""Cost of surface, per spacing squared, against 1 for the line of sight of one point."""
FILL = 0.02
"""Pull of the hull on space that nothing was measured in, per spacing cubed."""
OFF_HULL = 1.0
"""Points of the cloud farther than this outside the hull [px] are errors of matching."""
MEASURED, ON_HULL, WITHIN, CONTACT, BESIDE, GUARD, SHOWN, FLAT = range(8)
"""Kinds of points: of the dense cloud, on the silhouettes' hull, inside it, on the plane of support, of the surroundings,
far outside, on the hull of what silhouettes alone show, and where a flat side may go on."""
STRAIGHT = 0.5
"""Cost of surface on a flat side that goes on, against that of any other: below .7 two sides at a right angle cost less than a web."""
HOLLOW = 1 / 3
"""Where an unmeasured side is put, from 0 on the cut, which fills up to the hull, to 1 on a membrane. Where the motion of eight
bodies chose, it was from 0.3 to 1."""

ON_SUPPORT = 0.75
"""Spacings of the mesh within which a place lies on the plane of support."""
OVERHANGS = -0.5
"""Component along the support's normal of the normals of fill that hangs over: lines of sight less steep than 60 degrees
leave such. With all of it on a membrane a thin-legged chair went from +40 to -5 % of its volume; another one from +18 to -2 % with the
film of least area in its place, its moments of shape from -30, -41 and -37 to -16, -25 and -21 %."""

FEWEST_HOLD = 10
"""Vertices that must hang together to hold what hangs over a support: what was measured has measured places beside it, and a single outlier pins all
that is about it. Below the seats of three chairs all but one of some eighty such groups had fewer than 10; one of them held 19 % of a chair's
volume. On a plain jug's wall such groups are all that was measured, and without them it was 6 % too small."""


@dataclass(frozen=True)
class Fill:
    """How space in which nothing was measured is filled in.

    Attributes:
        pull: of the hull on it, per spacing cubed.
        membrane: where an unmeasured side is put, from 0 on the cut to 1 on a membrane over the measured rims.
        straight: flat sides go on, as `massprops.surface.flat_sides` says.
    """

    pull: float = FILL
    membrane: float = HOLLOW
    straight: bool = False


FILLED = Fill()
"""How it is where nothing else says how far an unmeasured side reaches."""
CONTINUED = Fill(straight=True)
"""How it may be in a free body before a black sky, whose unlit sides silhouettes take for sky."""
STRETCHED = Fill(membrane=1.0)
"""How it is in a still object that no plane bounds: the smallest surface, as far as it reaches all outlines. Of a banana, a screwdriver, a
padlock and a tin that were turned over (5 to 59 % filled in), volumes that were off by +5.7, +2.2, +4.2 and +0.2 % are off by
-4.8, -1.5, +3.9 and +0.1 %, and k1 of the banana by .005 in place of .111."""
PULLS = Pull(FILL), Pull(0.0)
"""Between which a free body's motion chooses, and `CONTINUED` where it has flat sides that go on."""
Mesh = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Vertices (v, 3), faces (f, 3) and kinds (v,) of a cut's mesh."""


@dataclass(frozen=True)
class Surface:
    """A closed, outward-wound mesh in the units and axes of the reconstruction.

    Attributes:
        vertices: (v, 3).
        faces: (f, 3) int32.
        observed: (f,) bool, measured and not filled.
        inferred: (f,) bool, closed at the plane of support, which nobody saw.
        hull: the silhouettes' evidence.
        cloud: the points the surface was made of, without outliers.
        spacing: distance between neighbouring vertices where it was measured.
        slope: 1-sigma of the surface's slope where its brightness measured it [rad]; None where stereo or outlines did.
        fill: how unmeasured space was filled in; None where outlines alone made the surface.
        rivals: other ways that may be right: the chance of each, and by how much its integrals (10,) are others.
    """

    vertices: np.ndarray
    faces: np.ndarray
    observed: np.ndarray
    inferred: np.ndarray
    hull: Hull
    cloud: Cloud
    spacing: float
    slope: float | None = None
    fill: Fill | None = None
    rivals: tuple[tuple[float, np.ndarray], ...] = ()

    @property
    def noise(self) -> float:
        """1-sigma of the measured surface's place: neighbours together know it better than each point does."""
        return 0.5 * float(np.median(self.cloud.sigma))

    def share(self, faces: np.ndarray) -> float:
        """Of the area, that of some faces (f,) bool."""
        area = face_areas(self.vertices, self.faces)
        return float(area[faces].sum() / area.sum())


def reconstruct_surface(
    views: Views,
    masks: list[np.ndarray],
    cloud: Cloud,
    points: int = 60_000,
    seed: int = 0,
    progress: Progress = silent,
    support: np.ndarray | None = None,
    moving: bool = True,
    surroundings: Cloud | None = None,
    fill: Fill | Balance = FILLED,
) -> Surface:
    """One closed surface from dense points and silhouettes.

    Args:
        views: n pinhole cameras.
        masks: n undistorted silhouettes (h, w) uint8: 255 object, 0 sky, 128 no evidence; an empty list where none is
            known yet.
        cloud: dense points; its views index `views`.
        points: about how many of them carry the surface.
        seed: of every random draw.
        progress: told after each step.
        support: (4,) plane the object stands on, normal towards the object; None for a free body.
        moving: whatever the cloud holds is the body's; of a still scene other pieces may stand beside the object.
        surroundings: dense points that are not the object's: their lines of sight only empty space.
        fill: how space in which nothing was measured is filled in; or where a free body's motion shows its centre of mass.

    Raises:
        NotPossible: too few points, or no closed body in them.
    """
    cloud = _sound(cloud)
    hull = make_hull(views, masks, cloud.xyz, support=support, free=moving and support is None)
    # What several views see against the sky is not there, however well its depths agreed.
    cloud = cloud.take(np.flatnonzero(hull.value(cloud.xyz) < OFF_HULL))
    thinned = thin(cloud, points, seed)
    if not len(thinned.xyz):
        raise NotPossible("surface: the dense points agree nowhere; take more overlapping or sharper images")
    progress(1, 5, "points thinned")
    hull = hull.sparing(thinned.xyz)
    beside = None if surroundings is None else _beside(thinned, surroundings, seed)
    first = fill if isinstance(fill, Fill) else FILLED
    given = _Given(
        thinned=thinned,
        hull=hull,
        views=views,
        masks=masks,
        cloud=cloud,
        moving=moving,
        seed=seed,
        beside=beside,
        pull=Pull(first.pull),
    )
    given = _with_flat_sides(given) if first.straight else given
    progress(2, 5, "first cut")
    meshes = _meshes(given, (given.pull, *(p for p in PULLS if p != given.pull)))
    mesh = next(meshes)[1]
    progress(4, 5, "cut")
    surface = _finished(given, mesh, fill) if isinstance(fill, Fill) else _balanced(given, mesh, meshes, fill)
    progress(5, 5, "surface")
    return surface


def _balanced(given: _Given, mesh: Mesh, others: Iterator[tuple[Pull, Mesh]], balance: Balance) -> Surface:
    """The surface whose unmeasured sides are filled in so that its centre of mass lies likeliest where the motion shows it.

    Args:
        mesh: of the usual pull; others: of other pulls, made where they are asked for.
    """

    def cut_of(mesh: Mesh, pull: Pull) -> Cut:
        vertices, faces, kinds = mesh
        return Cut(
            vertices,
            faces,
            kinds == MEASURED,
            _hollow(vertices, faces, _held(kinds, pull.straight), given.hull.support, 1.0),
        )

    def integrals(pull: Pull, membrane_share: float) -> np.ndarray:
        return mesh_integrals(cuts[pull].at(membrane_share), cuts[pull].faces)

    meshes, cuts = {given.pull: mesh}, {given.pull: cut_of(mesh, given.pull)}
    if not tells(cuts[given.pull], balance):
        return _finished(given, mesh, FILLED)
    continued = _with_flat_sides(given)
    # without a pull flat sides hold what they close, and are as good as none where they close nothing
    closed = any(not side.measured.any() for side in continued.sides)
    straight = [Pull(pull.strength, straight=True) for pull in (PULLS if closed else PULLS[:1])]
    for pull, other in chain(others, _meshes(continued, straight) if continued.sides else ()):
        meshes[pull], cuts[pull] = other, cut_of(other, pull)
    ways = {pull: fill_centres(cut) for pull, cut in cuts.items()}
    likely, tried = balanced(ways, HOLLOW, balance), set[Fill]()
    # taking the noise out of measured sides moves the centre, too, much alike for all ways of filling in
    while (fill := _as_fill(likely[0])) not in tried and len(tried) < 3:
        tried.add(fill)
        chosen, pull = fill, likely[0].pull
        surface = _finished(given, meshes[pull], fill)
        shift = centre_of(surface.vertices, surface.faces) - centre_of(cuts[pull].at(fill.membrane), cuts[pull].faces)
        likely = balanced(ways, HOLLOW, balance, shift)
    body = integrals(pull, chosen.membrane)
    less_likely = [way for way in likely if way.pull != pull]
    return replace(surface, rivals=tuple((way.chance, integrals(way.pull, way.membrane) - body) for way in less_likely))


def _as_fill(likely: LikelyFill) -> Fill:
    return Fill(likely.pull.strength, likely.membrane, likely.pull.straight)


def _with_flat_sides(given: _Given) -> _Given:
    """The same with the flat sides that go on, if there are any, and without what these reflect."""
    thinned, views = given.thinned, given.views
    thinned = thinned.take(~reflections(thinned, views, measured_sides(thinned, given.seed)))
    sides = flat_sides(thinned, given.hull, views, given.seed)
    return replace(given, thinned=thinned, sides=sides, pull=Pull(given.pull.strength, True)) if sides else given


def _held(kinds: np.ndarray, straight: bool) -> np.ndarray:
    """(v,) bool: vertices that no film moves; straight: flat sides go on."""
    return np.isin(kinds, (MEASURED, CONTACT, SHOWN, FLAT) if straight else (MEASURED, CONTACT, SHOWN))


def _finished(given: _Given, mesh: Mesh, fill: Fill) -> Surface:
    """The surface from a cut's mesh: its unmeasured sides in their place, the others in the middle of the noise."""
    vertices, faces, kinds = mesh
    hull, cloud, h = given.hull, given.cloud, given.thinned.spacing
    support = hull.support
    measured, fixed = kinds == MEASURED, _held(kinds, fill.straight)
    film = membrane if given.moving and support is None else least_area
    if support is not None:
        loose = fixed & (kinds != CONTACT) & ~without_islands(faces, fixed, FEWEST_HOLD)
        if loose.any():
            fixed = fixed & ~(loose & _lifted(vertices, film(vertices, faces, fixed & ~loose), faces, support))
    elif given.masks and not given.moving:
        fixed = fixed & ~standing_off(vertices, faces, fixed, given.views)
    vertices = _hollow(vertices, faces, fixed, support, fill.membrane, film)
    if given.masks and not given.moving:
        vertices = filling_outlines(vertices, faces, ~fixed, given.views, given.masks, hull.pixel)
    vertices = fair(vertices, faces, fixed, 10)
    for _ in range(2):
        vertices = remove_bias(vertices, faces, cloud, 2 * h, measured)
    observed = _observed(vertices, faces, cloud, h, hull if given.moving else None)
    inferred = ~observed & on_support(vertices, faces, support, ON_SUPPORT * h)
    return Surface(vertices, faces.astype(np.int32), observed, inferred, hull, cloud, h, fill=fill)


def _observed(vertices: np.ndarray, faces: np.ndarray, cloud: Cloud, spacing: float, sharp: Hull | None) -> np.ndarray:
    """(f,) bool: faces that were measured. sharp: silhouettes as before a black sky: a face with a corner off them is a hair; or None."""
    measured = measured_faces(vertices, faces, cloud, 2 * spacing)
    return measured if sharp is None else measured & (sharp.value(vertices)[faces] < OFF_HULL).all(1)


@dataclass(frozen=True)
class _Given:
    """What a cut is made of: arguments of `reconstruct_surface`, and what silhouettes show beside an earlier cut."""

    thinned: Thinned
    hull: Hull
    views: Views
    masks: list[np.ndarray]
    cloud: Cloud
    moving: bool
    seed: int
    beside: Thinned | None
    pull: Pull
    sides: Sequence[FlatSide] = ()
    more: SilhouetteOnly | None = None


def _meshes(given: _Given, pulls: Sequence[Pull]) -> Iterator[tuple[Pull, Mesh]]:
    """Each pull on what was not measured, and the mesh of the body that it leaves, made one by one; pulls after the first may leave
    none.

    Once more with what silhouettes show where a first cut left nothing: of what moves freely, parts that protrude, such as booms.

    Raises:
        NotPossible: no closed body.
    """
    tetra, kind, costs, inside = _cut_out(given)
    if given.masks:
        # another thing that was measured is no part of the object, though a silhouette may show it
        every = joined(tetra, costs, inside, moving=True)
        vertices, faces, _ = _mesh(tetra, kind, every)
        spacing = given.thinned.spacing
        shown = (vertices, faces), given.views, given.masks, given.hull, spacing, given.seed
        more = silhouette_only_space(*shown, sharp=given.moving) if len(faces) else None
        if more is not None:
            tetra, kind, costs, inside = _cut_out(replace(given, more=more))
    guard = (kind[tetra.corners] == GUARD).any(1)
    one_thing = partial(hang_together, given.views, given.masks) if given.masks else None
    for k, pull in enumerate(pulls):
        pulled_costs = costs.pulled(pull.strength - given.pull.strength)
        label = inside if pull == given.pull else minimum_cut(tetra, pulled_costs)
        body = manifold(tetra, joined(tetra, pulled_costs, label, given.moving, one_thing), guard)
        if body.sum() >= 10:
            yield pull, _mesh(tetra, kind, body)
        elif k == 0:
            raise NotPossible("surface: no closed body in the dense points; more of the object must be seen")


def _cut_out(given: _Given) -> tuple[Tetrahedra, np.ndarray, Costs, np.ndarray]:
    """Tetrahedra, the kind of each point, costs, and (t,) bool which are inside at least cost."""
    tetra, kind = _tetrahedra(given)
    costs = _costs(given, tetra, kind)
    return tetra, kind, costs, minimum_cut(tetra, costs)


def _sound(cloud: Cloud) -> Cloud:
    """The cloud without its outliers.

    Raises:
        NotPossible: too few points.
    """
    if len(cloud) < 200:
        raise NotPossible(f"surface: only {len(cloud)} dense points; take more overlapping or better lit images")
    cloud = without_outliers(cloud)
    if len(cloud) < 200:
        raise NotPossible("surface: the dense points agree nowhere; take more overlapping or sharper images")
    return cloud


def on_support(vertices: np.ndarray, faces: np.ndarray, support: np.ndarray | None, near: float) -> np.ndarray:
    """(f,) bool: faces that lie on the plane of support and look into it."""
    if support is None:
        return np.zeros(len(faces), bool)
    height = np.abs(vertices @ support[:3] + support[3])
    return (height[faces] < near).all(1) & (face_normals(vertices, faces) @ support[:3] < -0.7)


def _hollow(
    vertices: np.ndarray,
    faces: np.ndarray,
    measured: np.ndarray,
    support: np.ndarray | None,
    share_of_way: float,
    film: Film = membrane,
) -> np.ndarray:
    """Unmeasured vertices moved a share of the way to a film over the measured rims, or all of it where they look down
    on a support: there the hull is no more than how steeply the cameras looked.

    Args:
        vertices: (v, 3); faces: (f, 3).
        measured: (v,) bool, vertices that were measured or stand on the support.
        support: (4,) plane the object stands on, or None.
        share_of_way: that share, from 0 to 1.
        film: which film.
    """
    out = vertices.copy()
    if measured.any() and not measured.all():
        share, stretched = np.full(len(vertices), share_of_way), film(vertices, faces, measured)
        if support is not None:
            # a cut is jagged, and has walls below an overhang that the film spans
            hangs = vertex_normals(vertices, faces) @ support[:3] < OVERHANGS
            share[hangs | _lifted(vertices, stretched, faces, support)] = 1.0
        out[~measured] += (share[:, None] * (stretched - vertices))[~measured]
    return out


def _lifted(vertices: np.ndarray, film: np.ndarray, faces: np.ndarray, support: np.ndarray) -> np.ndarray:
    """(v,) bool: vertices (v, 3) that a film (v, 3) looking down on the support lifts. A film that dents a wall looks down, too, but goes inward."""
    up, way = support[:3], film - vertices
    lifts = way @ up > -OVERHANGS * np.linalg.norm(way, axis=1)
    return np.asarray(lifts & (vertex_normals(film, faces) @ up < OVERHANGS))


def _mesh(tetra: Tetrahedra, kind: np.ndarray, label: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces and the kind of every vertex."""
    used, faces = np.unique(surface_faces(tetra, label), return_inverse=True)
    return tetra.points[used].copy(), faces.reshape(-1, 3), kind[used]


def _beside(thinned: Thinned, surroundings: Cloud, seed: int) -> Thinned | None:
    """The surroundings about the object, no denser than it, as far as the tetrahedra reach."""
    low, high = thinned.xyz.min(0), thinned.xyz.max(0)
    reach = 0.7 * float(np.linalg.norm(high - low))
    near = np.flatnonzero(np.linalg.norm(surroundings.xyz - 0.5 * (low + high), axis=1) < reach)
    if len(near) < 200:
        return None
    return thin(surroundings.take(near), max(200, len(thinned.xyz) // 2), seed)


def _contact(thinned: Thinned, plane: np.ndarray) -> np.ndarray:
    """(k, 3) grid on the support below the object: what stands on a plane ends there."""
    from scipy.spatial import cKDTree

    foot = thinned.xyz - (thinned.xyz @ plane[:3] + plane[3])[:, None] * plane[:3]
    first = np.linalg.svd(plane[None, :3])[2][1]
    base = np.stack([first, np.cross(plane[:3], first)])
    flat = (foot - foot[0]) @ base.T
    h = 1.5 * thinned.spacing
    low, high = flat.min(0), flat.max(0)
    while np.prod((high - low) / h) > 40_000:
        h *= 1.5
    i, j = np.meshgrid(*(np.arange(a - 2 * h, b + 2 * h, h) for a, b in zip(low, high, strict=True)))
    grid = np.column_stack([i.ravel(), j.ravel()])
    grid = grid[cKDTree(flat).query(grid, distance_upper_bound=7 * h)[0] < 6 * h]
    return foot[0] + grid @ base


def _on_hull(given: _Given, tree: cKDTree, extent: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 3) on the hull where nothing was measured, and (m, 3) points within thin parts of it."""
    thinned, h = given.thinned, given.thinned.spacing
    step = max(1, len(thinned.xyz) // 8_000)
    silhouette, begin = hull_points(
        given.hull, thinned.xyz[::step], thinned.normal[::step], h, 1.2 * extent, 5, given.seed
    )
    if not len(silhouette):
        return silhouette, silhouette
    away = tree.query(silhouette, distance_upper_bound=12 * h)[0]
    # A plate seen from one side only: without points in it, no cut could make it thinner than the hull.
    thin_part = (away > 1.2 * h) & (np.linalg.norm(silhouette - begin, axis=1) < 16 * h)
    lower, upper = begin[thin_part], silhouette[thin_part]
    between = np.concatenate([lower + f * (upper - lower) for f in (0.25, 0.5, 0.75)])
    between = between[tree.query(between, distance_upper_bound=h)[0] > 0.5 * h]
    between = _one_per_cell(between, np.full(len(between), h))
    silhouette, away = silhouette[away > 1.2 * h], away[away > 1.2 * h]
    # Fine next to what was measured, where thin parts are, coarser far from it.
    return _one_per_cell(silhouette, np.clip(0.35 * away, h, 4 * h)), between


def _tetrahedra(given: _Given) -> tuple[Tetrahedra, np.ndarray]:
    """Tetrahedra, and the kind of each point."""
    from scipy.spatial import QhullError, cKDTree

    thinned, hull, more = given.thinned, given.hull, given.more
    h = thinned.spacing
    low, high = thinned.xyz.min(0), thinned.xyz.max(0)
    extent = float(np.linalg.norm(high - low))
    tree = cKDTree(thinned.xyz)
    rng = np.random.default_rng([given.seed, 13])
    silhouette, between = _on_hull(given, tree, extent)

    count = 6000
    within = low + (high - low) * rng.random((8 * count, 3))
    within = within[hull.value(within) < 0]
    within = within[tree.query(within, distance_upper_bound=3 * h)[0] > 2.5 * h][:count]
    within = np.concatenate([within, between])
    shown = silhouette[:0]
    if more is not None:
        within = np.concatenate([within, more.inside[tree.query(more.inside, distance_upper_bound=2 * h)[0] > h]])
        shown = more.outline[tree.query(more.outline, distance_upper_bound=2 * h)[0] > h]
        shown = _one_per_cell(shown, np.full(len(shown), h))
        low, high = np.minimum(low, more.outline.min(0)), np.maximum(high, more.outline.max(0))
        extent = float(np.linalg.norm(high - low))
    middle, radius = 0.5 * (low + high), 0.75 * extent
    ball = sphere(200)
    guard = np.concatenate([middle + radius * ball, middle + 2 * radius * ball[::4]])

    none = thinned.xyz[:0]
    contact = none if hull.support is None else _contact(thinned, hull.support)
    parts = {
        MEASURED: thinned.xyz,
        ON_HULL: silhouette,
        WITHIN: within,
        CONTACT: contact,
        BESIDE: none if given.beside is None else given.beside.xyz,
        GUARD: guard,
        SHOWN: shown,
        FLAT: _on_flat_sides(given, tree),
    }
    kind = np.concatenate([np.full(len(p), k) for k, p in parts.items()])
    everything = np.concatenate(list(parts.values()))
    everything = everything + 1e-7 * extent * rng.standard_normal(everything.shape)
    try:
        return tetrahedralise(everything), kind
    except QhullError as error:
        raise NotPossible("surface: the dense points lie in one plane; take images from more sides") from error


def _on_flat_sides(given: _Given, tree: cKDTree) -> np.ndarray:
    """(k, 3) places where flat sides may go on, off what was measured."""
    places = [side.places(side.goes_on) for side in given.sides]
    every = np.concatenate([given.thinned.xyz[:0], *places])
    return every[tree.query(every, distance_upper_bound=given.thinned.spacing)[0] > 0.8 * given.thinned.spacing]


def _one_per_cell(xyz: np.ndarray, size: np.ndarray) -> np.ndarray:
    """One point for each cell of its own level of an octree: sizes are rounded down to powers of two."""
    if len(xyz) == 0:
        return xyz
    level = np.floor(np.log2(size / size.min())).astype(np.int64)
    key = np.floor((xyz - xyz.min(0)) / (size.min() * 2.0**level)[:, None]).astype(np.int64)
    code = ((level * 8192 + key[:, 0]) * 8192 + key[:, 1]) * 8192 + key[:, 2]
    return xyz[np.sort(np.unique(code, return_index=True)[1])]


def _sight(given: _Given, tetra: Tetrahedra, kind: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What `sight_evidence` gives, and (t,) cost of calling outside what lies just behind measured points. Arguments as of `_costs`."""
    thinned, views, beside = given.thinned, given.views, given.beside
    h, n = thinned.spacing, len(thinned.xyz)
    # After averaging, a point is better than one measurement; neighbours still differ by a part of it.
    soft = np.maximum(0.5 * thinned.sigma, 0.05 * h)
    p, slot = np.nonzero(thinned.views >= 0)
    seen = (thinned.views >= 0).sum(1)
    centre = views.centres[thinned.views[p, slot]]
    into, free = sight_evidence(tetra, p, centre, soft[p], 2.0 / np.maximum(seen[p], 2))
    if beside is not None:
        p, slot = np.nonzero(beside.views >= 0)
        number = (beside.views >= 0).sum(1)[p]
        noise = np.maximum(0.5 * beside.sigma, 0.05 * h)[p]
        of_point = np.flatnonzero(kind == BESIDE)[p]
        other = sight_evidence(
            tetra, of_point, views.centres[beside.views[p, slot]], noise, 2.0 / np.maximum(number, 2)
        )
        into, free = into + other[0], free + other[1]

    sure = np.zeros(len(tetra.corners))
    depth = np.maximum(1.5 * thinned.sigma, 0.15 * h)
    of_point = tetrahedra_at_depth(tetra, np.arange(n), -thinned.normal, depth)
    confidence = np.minimum(seen, 3) / 3.0
    np.add.at(sure, of_point[of_point >= 0], confidence[of_point >= 0])
    return into, free, sure


def _costs(given: _Given, tetra: Tetrahedra, kind: np.ndarray) -> Costs:
    """What the cut pays. Arguments as of `_tetrahedra`, and what it gives."""
    hull, more, h = given.hull, given.more, given.thinned.spacing
    into, free, sure = _sight(given, tetra, kind)
    volume = tetra.volume
    middle = tetra.points[tetra.corners].mean(1)
    sky = hull.value(middle)
    if given.pull.straight:
        # an end that turns away from the Sun looks like sky
        sky = np.where(enclosed(given.sides, middle), np.minimum(sky, 0.0), sky)
    share = np.cbrt(volume) / h
    outside = np.where(sky > OFF_HULL, 2.0 * np.clip(share, 0.1, 10) ** 2, 0.0)
    guard = (kind[tetra.corners] == GUARD).any(1)
    outside = np.where(guard, 1e6, outside)
    space = np.where((sky <= 0.5) & ~guard, np.minimum(volume / h**3, 2000.0) * np.exp(-free), 0.0)
    both, before = AREA * np.minimum(tetra.facet_area / h**2, 200.0), None
    if given.pull.straight:
        before = np.where(in_front(given.sides, middle), space, 0.0)
        space = space - before
        outside = outside + given.pull.strength * before
        both = np.where(_on_sides(tetra, kind, given), STRAIGHT * both, both)
    pull = given.pull.strength * space
    shown = None
    if more is not None:
        in_hull = np.flatnonzero((sky <= 0.5) & ~guard)
        gain = inside_reward(more, hull, middle[in_hull], volume[in_hull], h)
        pull[in_hull] += gain * np.exp(-free[in_hull])
        shown = np.zeros(len(volume), bool)
        shown[in_hull] = gain > 0
    return Costs(outside, sure + pull, into, both, shown, space, before)


def _on_sides(tetra: Tetrahedra, kind: np.ndarray, given: _Given) -> np.ndarray:
    """(t, 4) bool: facets that lie where a flat side goes on."""
    side_points = np.flatnonzero(np.isin(kind, (FLAT, MEASURED)))
    near, beyond = 0.3 * given.thinned.spacing, (kind == FLAT)[tetra.corners]
    out = np.zeros(tetra.corners.shape, bool)
    for side in given.sides:
        there = np.zeros(len(kind), bool)
        there[side_points] = np.abs(side.height(tetra.points[side_points])) < near
        there[side_points] &= side.on(tetra.points[side_points], side.goes_on | side.measured)
        flat = there[tetra.corners]
        for k in range(4):
            others = [i for i in range(4) if i != k]
            out[:, k] |= flat[:, others].all(1) & beyond[:, others].any(1)
    return out
