"""Stage: dense points and silhouettes -> a closed mesh, which of its faces were measured, and its replicates."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from massprops.errors import NotPossible
from massprops.mass.confidence import OUTSIDE
from massprops.mass.integrals import face_areas, mesh_integrals
from massprops.mass.intervals import collapsed, valid_bodies
from massprops.run.job import Job
from massprops.run.placement_scenes import turned_over
from massprops.run.silhouettes_again import drawn_from_shapes, silhouettes_again
from massprops.run.stage_images import undistorted_frame, undistorted_mask, undistorted_sky

if TYPE_CHECKING:
    from massprops.surface.cloud import Cloud
    from massprops.surface.fill_by_motion import Balance
    from massprops.surface.hollow import Hollows
    from massprops.surface.outline_gaps import Gaps
    from massprops.surface.reconstruct import Surface
    from massprops.surface.spread import Joint
    from massprops.views import Views

READS = ("capture", "sfm", "shape", "silhouettes", "join", "dense")
OPTIONS = ("seed",)

FAR = 15.0
"""Spacings of the mesh beyond which a measured point is not on it."""
MOST_LOST = 0.03
"""Above this share of measured points that lie far off the mesh, a part of the body is missing in it."""
NOTHING_LEFT = 0.5
"""Above this share the mesh is not what was measured."""
MUCH_FILLED = 0.3
"""Share of filled area of a body before a black sky from which on it is asked where the body would not be lit, as sky before its never lit back may
have carved it. Of bodies of which .35 to .44 was filled in (Blender) a rock was 36 % too small, a bus 10 %, and a CubeSat 35 % too large; by the sky
that counts they are -1, +1 and +4 %. Of bodies that are measured nearly all round it would change little, and takes twice as long."""
CLEARLY = 2.0
"""Standard errors by which sky that counts only where the body would be lit must leave fewer pixels out. Of a bus of 40 small images, whose volume differs by
4 % between both, 3793 pixels were missed in place of 3738 or 3814, by what a seed had drawn; of two that it mended (rock 9 and foil 79, Blender) 50 and 38 %
fewer. Where more than `OUTSIDE` of the images show sky before what was measured, it is enough that it leaves out no more by as many: 30 % of the images of
foil 85 were called wrong, though its volume is .5 to .9 % off by either."""
MOST_FILLED = 0.6
"""Above this share of filled area the mesh is kept, but called partial."""
FOCAL_SIGMA = 0.003
"""Relative 1-sigma of a self-calibrated focal length when the structure from motion could not give its own."""

OPEN = 0.1
"""Share of the surface that nothing shows to be where it is, neither stereo, a support nor an outline, from which on it may be
the mouth of a hollow. A cup whose inside was dark had .22; a jug, a banana, a bottle and a box at most .04."""


class _Holes(NamedTuple):
    """Holes of a body.

    Attributes:
        count: dark places that may be the mouths of holes; behind: integrals (10,) of the space straight behind them.
        opened: holes that were opened; taken: volume that they took; unsure: integrals (10,) of the space of which their two
            mouths say different things.
    """

    count: int
    behind: np.ndarray
    opened: int
    taken: float
    unsure: np.ndarray


NO_HOLES = _Holes(0, np.zeros(10), 0, 0.0, np.zeros(10))


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What a closed surface is made from.

    Attributes:
        views, masks: cameras and their silhouettes; grey: their images where a body is before black sky, else none.
        sun: (n, 3) direction to it in each view's camera, of such a body; None where its brightness does not say.
        cloud: the body's points; table: those of the plane it stands on that lie within silhouettes.
        place: `join.json`; moving: nothing else is in the cloud.
        balance: where a free body's motion shows its centre of mass, or None.
    """

    views: Views
    masks: list[np.ndarray]
    grey: list[np.ndarray]
    sun: np.ndarray | None
    cloud: Cloud
    table: Cloud
    place: dict[str, Any]
    moving: bool
    balance: Balance | None


def lost_share(vertices: np.ndarray, xyz: np.ndarray, far: float) -> float:
    """Share of points (n, 3) that lie farther than `far` from every vertex (v, 3)."""
    from scipy.spatial import cKDTree

    return float(np.mean(cKDTree(vertices).query(xyz, distance_upper_bound=far)[0] > far))


def integrals_of_body(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Integrals (10,) of a closed mesh.

    Raises:
        NotPossible: no body has them, as the mesh folds over itself.
    """
    body = mesh_integrals(vertices, faces)
    if not valid_bodies(body[None])[0]:
        raise NotPossible(
            "surface: what closes the measured points folds over itself, so that it encloses no body: images were placed wrongly, or the object "
            "was not told from what is about it; a cloth or tiles that repeat mislead it: put a printed page under the object, and give "
            "--object X,Y with a pixel of it, or --masks"
        )
    return body


def run(job: Job) -> dict[str, Any]:
    """Writes surface.npz (see `_save`) and surface.json; masks/ too, where silhouettes were drawn from a shape."""
    from massprops.run.unjoined import underside_may_be_hollow, unjoined
    from massprops.surface.disagreement import holding
    from massprops.surface.hollow import hollowed
    from massprops.surface.outer import outer_integrals
    from massprops.surface.spread import ErrorSources, balancing, replicates, with_rivals
    from massprops.surface.through_holes import with_open_holes
    from massprops.views import Views

    views = Views.load(job.work("join") / "views.npz")
    place = json.loads((job.work("join") / "join.json").read_text())
    footage = json.loads((job.work("capture") / "footage.json").read_text())
    # what turns on a support is no free body: other things may stand there
    free = footage["motion"] == "tumbling" and place["support_plane"] is None
    seen = _evidence(job, views, place, footage, free)
    surface, masks, lit = _surface(job, seen)
    # what turns in the light changes on every side from view to view
    shown = [] if free else _grey(job, views)
    surface = _by_images(surface, views, shown, masks, place) if footage["motion"] == "static" else surface
    _draw_silhouettes_again(job, surface, views, masks, seen.moving)
    lost = _lost(surface)
    surface, holes = _opened(surface, views, shown) if shown else (surface, NO_HOLES)
    gaps = _outline_gaps(surface, views, masks, free, bool(seen.grey))
    balance = seen.balance
    sources = ErrorSources(
        _focal_sigma(job), gaps, free, balance is not None and surface.fill is not None, _joints(place), lit
    )
    rows, lengths = by_shape = replicates(surface, len(views), sources, seed=job.seed)
    body = integrals_of_body(surface.vertices, surface.faces)
    if balance is not None and sources.balanced:
        # cameras that drift take the centre along
        balance = balance.widened(gaps.drift * surface.hull.pixel)
        rng = np.random.default_rng([job.seed, 15])
        rows, lengths = balancing(rows, lengths, body, balance, rng)
        rows = with_rivals(rows, surface.rivals, rng)
    others = unjoined(job, place, _focal_sigma(job))
    underside_hollow = underside_may_be_hollow(place, others)
    hollow, behind = _hollows(surface, place, underside_hollow), _behind_sides(surface, gaps, place)
    empty, told = _may_be_empty(hollow, behind, holes, float(body[0]))
    rows = with_open_holes(hollowed(rows, body, empty, job.seed), holes.unsure, job.seed)
    rows, differing = holding(rows, body, [(other.body, other.rows) for other in others], job.seed)
    # what the body is within at most, where its replicates leave that open
    outer = outer_integrals(surface.hull, surface.vertices) if collapsed(valid_bodies(rows)) else np.zeros(10)
    _save(job, surface, (rows, lengths), by_shape if sources.balanced else (rows, lengths), outer)
    facts = _facts(surface, lost, dict(zip(views.names, gaps.overlap, strict=True)))
    facts["symmetric"] = _symmetric(job, views, masks, seen.cloud, surface, footage) if free else []
    facts |= told | {"camera_drift_px": gaps.drift}
    facts |= {"hollow_elsewhere": underside_hollow, "differing_placements": differing}
    for line in facts["warnings"]:
        job.warn(line)
    (job.out / "surface.json").write_text(json.dumps(facts, indent=1))
    return {k: facts[k] for k in ("watertight", "observed_fraction", "faces", "partial")}


def _evidence(job: Job, views: Views, place: dict[str, Any], footage: dict[str, Any], free: bool) -> Evidence:
    """What the stages before found; free: the body tumbles, and stands on nothing."""
    from massprops.surface.cloud import Cloud
    from massprops.surface.sharp_outlines import sharp_outlines
    from massprops.surface.unlit import spare_unlit, sun_of_views

    cloud, table = _without_support(job, views, Cloud.load(job.work("dense") / "points.npz"), place)
    masks = [undistorted_mask(job, views, i) for i in range(len(views))]
    grey = _grey(job, views) if free and _before_black_sky(footage) else []
    sun = sun_of_views(views, grey, cloud, job.seed) if grey and len(cloud) else None
    if sun is not None:
        skies = [undistorted_sky(job, views, i) for i in range(len(views))]
        masks = sharp_outlines(views, masks, skies, grey, cloud, sun)
        masks = spare_unlit(views, masks, grey, cloud, sun)
    return Evidence(
        views=views,
        masks=masks,
        grey=grey,
        sun=sun,
        cloud=cloud,
        table=table,
        place=place,
        moving=free or bool(footage["masks_given"]),
        balance=_balance(views, _extent(cloud, place), footage)
        if grey and (len(cloud) or _known_place(place))
        else None,
    )


Replicates = tuple[np.ndarray, np.ndarray]
"""Integrals (r, 10) and greatest lengths (r,)."""


def _save(job: Job, surface: Surface, drawn: Replicates, by_shape: Replicates, outer: np.ndarray) -> None:
    """Writes surface.npz; drawn: its replicates; by_shape: those that know nothing of the motion; outer (10,) integrals of what it is
    within at most."""
    np.savez(
        job.out / "surface.npz",
        vertices=surface.vertices,
        faces=surface.faces,
        observed=surface.observed,
        inferred=surface.inferred,
        replicate_integrals=drawn[0],
        replicate_length=drawn[1],
        shape_integrals=by_shape[0],
        shape_length=by_shape[1],
        outer_integrals=outer,
    )


def _lost(surface: Surface) -> float:
    """Share of the measured points that lie far from the mesh.

    Raises:
        NotPossible: nearly all of them.
    """
    lost = lost_share(surface.vertices, surface.cloud.xyz, FAR * surface.spacing)
    if lost > NOTHING_LEFT:
        raise NotPossible(
            f"surface: {100 * lost:.0f} % of the measured points are not on the closed surface that fits them best: no "
            "closed body was measured; give images with more overlap and from more sides"
        )
    return lost


def _by_images(
    surface: Surface, views: Views, grey: list[np.ndarray], masks: list[np.ndarray], place: dict[str, Any]
) -> Surface:
    """The surface of a still object, moved to where its images agree best, and its thin parts to their edges; grey: undistorted images
    (h, w); `place` is `join.json`."""
    from massprops.surface.edges import moved_to_edges
    from massprops.surface.photometric import moved_to_images

    if not surface.observed.any():
        return surface
    placement = np.zeros(len(views), np.int64)
    for number, joint in enumerate(_joints(place), start=1):
        placement[joint.first : joint.last + 1] = number
    surface = moved_to_images(surface, views, grey, masks, placement)
    # where an object lay on either side no one support tells what is its shade
    return surface if turned_over(place) else moved_to_edges(surface, views, grey, masks)


def _draw_silhouettes_again(job: Job, surface: Surface, views: Views, masks: list[np.ndarray], moving: bool) -> None:
    """Draws silhouettes from the surface, for the user: a surface must not be judged by silhouettes that were drawn from it.

    Args:
        moving: nothing else is in the cloud.
    """
    if not moving and drawn_from_shapes(job):
        silhouettes_again(job, views, (surface.vertices, surface.faces), masks, surface.cloud.xyz)


def _outline_gaps(surface: Surface, views: Views, masks: list[np.ndarray], free: bool, black: bool) -> Gaps:
    """How far outlines lie from the object's.

    Args:
        free: the body tumbles, so what was not measured was never seen lit.
        black: before a black sky, where the unlit side looks like the sky.
    """
    from massprops.surface.outline_gaps import outline_gaps

    lit = surface.observed if black else None
    gaps = outline_gaps(surface.vertices, surface.faces, views, masks, _reach(surface), lit)
    if not surface.observed.any():
        # a surface that outlines alone make lies on them
        return replace(gaps, offset=np.zeros(len(surface.faces)), drift=0.0)
    if free:
        return gaps
    # a silhouette cut by colour has no margin; it scatters with shadows and things behind, not with the cameras
    return replace(gaps, offset=np.where(surface.inferred, 0.0, gaps.middle), drift=0.0)


def _reach(surface: Surface) -> float:
    """Width of the bumps in which a surface is off (`error_modes`) [world units]."""
    from massprops.surface.error_modes import REACH
    from massprops.surface.length import model_length

    return REACH * model_length(surface.vertices, surface.faces, surface.observed)[0]


def _focal_sigma(job: Job) -> float:
    """Relative 1-sigma of the focal length."""
    focal = json.loads((job.work("sfm") / "sfm.json").read_text()).get("focal_sigma_relative")
    return FOCAL_SIGMA if focal is None else float(focal)


def _symmetric(
    job: Job, views: Views, masks: list[np.ndarray], cloud: Cloud, surface: Surface, footage: dict[str, Any]
) -> list[dict[str, Any]]:
    """Turns under which a free body looks the same, as `massprops.mass.symmetric` reads them."""
    from massprops.mass.integrals import central_inertia
    from massprops.mass.properties import principal_frame
    from massprops.surface.ambiguous import ambiguity
    from massprops.surface.cloud import Cloud
    from massprops.surface.symmetry import symmetries

    with np.load(job.work("dense") / "points.npz", allow_pickle=False) as z:
        colour = z["rgb"][Cloud(**{k: z[k] for k in Cloud.__dataclass_fields__}).is_finite]
    if len(colour) != len(cloud):
        return []
    _, centre, inertia = central_inertia(mesh_integrals(surface.vertices, surface.faces), 1.0)
    candidates = symmetries(cloud, colour, centre, principal_frame(inertia)[1], surface.hull.pixel, job.seed)
    in_time = footage["kind"] in ("video", "sequence", "stereo")
    out = []
    for one in (ambiguity(s, cloud, (surface.vertices, surface.faces), views, masks, in_time) for s in candidates):
        turn = one.symmetry
        out.append({
            "fold": turn.fold,
            "axis": turn.axis,
            "shape_share": turn.shape,
            "paint_share": turn.paint,
            "paint_by_chance": turn.chance[0],
            "images_alike": list(one.alike),
            "images_apart": list(one.apart),
            "common": None if one.common is None else one.common.tolist(),
            "together": None if one.together is None else one.together.tolist(),
        })  # fmt: skip
    return [one for one in out if one["images_alike"]]


def _joints(place: dict[str, Any]) -> list[Joint]:
    """How well the placements lie on the first; `place` is `join.json`."""
    from massprops.surface.spread import Joint

    records = [p["joint"] for p in place["joined"] if "joint" in p]
    return [
        Joint(j["views"][0], j["views"][1], np.array(j["about"], float), np.array(j["covariance"], float))
        for j in records
    ]


def _without_support(job: Job, views: Views, cloud: Cloud, place: dict[str, Any]) -> tuple[Cloud, Cloud]:
    """The body's points, and those of what it stands on; `place` is `join.json`.

    A silhouette may take in the shadow at the object's foot. Stereo measures the plane there all the same, and its lines
    of sight say that nothing is above it.
    """
    from massprops.capture.support import on_plane
    from massprops.run.placement_scenes import shown_as_support

    flat, rise = shown_as_support(job, views, cloud), place.get("support_rise")
    if rise is not None and len(cloud):
        flat |= on_plane(cloud.xyz, cloud.normal, np.array(place["support_plane"], float), float(rise))
    return cloud.take(np.flatnonzero(~flat)), cloud.take(np.flatnonzero(flat))


def _hollows(surface: Surface, place: dict[str, Any], underside_hollow: bool) -> Hollows:
    """What an underside that was not seen may hide. `place` is `join.json`; underside_hollow: of `on_support_hollows`."""
    from massprops.run.unjoined import on_support_hollows
    from massprops.surface.hollow import Hollows

    if place["support_plane"] is None:
        return Hollows(np.zeros(10), np.zeros(10))
    return on_support_hollows(surface, np.array(place["support_plane"], float), underside_hollow)


def _behind_sides(surface: Surface, gaps: Gaps, place: dict[str, Any]) -> np.ndarray:
    """Integrals (10,) of the space behind filled-in sides that may be empty, of an object that lay on something.

    Args:
        gaps: an outline that agrees shows that a filled side is where the object is, so there is no mouth.
        place: `join.json`.
    """
    from massprops.mass.confidence import FILLED
    from massprops.surface.behind_fill import behind_fill

    mesh = surface.vertices, surface.faces
    if turned_over(place):
        if _filled(surface) < FILLED:
            return np.zeros(10)
        return behind_fill(*mesh, surface.observed, surface.noise, surface.spacing)
    if place["support_plane"] is None or not surface.observed.any():
        return np.zeros(10)
    walls, area = surface.observed | surface.inferred | (gaps.distance < _reach(surface)), face_areas(*mesh)
    if area[~walls].sum() < OPEN * area.sum():
        return np.zeros(10)
    return behind_fill(*mesh, walls, surface.noise, surface.spacing, walls_alike=False)


def _opened(surface: Surface, views: Views, grey: list[np.ndarray]) -> tuple[Surface, _Holes]:
    """The surface with the holes opened that go through it, and what else may be holes; grey: undistorted images (h, w)."""
    from massprops.surface.holes import dark_places, straight_behind
    from massprops.surface.through_holes import opened, through_holes
    from massprops.surface.touching import parted

    places = dark_places(surface, views, grey)
    tubes, remaining_places = through_holes(surface, places)
    rest = opened(surface, tubes) if tubes else None
    if rest is None:
        return surface, _Holes(len(places), straight_behind(surface, places), 0, 0.0, np.zeros(10))
    vertices, faces, observed, inferred = rest
    vertices = parted(vertices, faces)
    taken = float(mesh_integrals(surface.vertices, surface.faces)[0] - mesh_integrals(vertices, faces)[0])
    holes = _Holes(
        len(remaining_places),
        straight_behind(surface, remaining_places),
        len(tubes),
        taken,
        np.sum([tube.unsure for tube in tubes], axis=0),
    )
    return replace(surface, vertices=vertices, faces=faces, observed=observed, inferred=inferred), holes


def _may_be_empty(
    hollow: Hollows, behind: np.ndarray, holes: _Holes, volume: float
) -> tuple[np.ndarray, dict[str, Any]]:
    """Integrals (10,) of the space that the intervals allow to be empty, the largest of three kinds as they may be the same
    space, and what `surface.json` says of them; behind: filled-in sides; volume: of the body."""
    shares = {"hollow_possible": hollow.possible[0] / volume, "hollow_likely": hollow.likely[0] / volume}
    shares["hollow_behind_fill"] = behind[0] / volume
    empty = max(hollow.likely, behind, holes.behind, key=lambda space: float(space[0]))
    opened = {"holes_opened": holes.opened, "holes_opened_share": holes.taken / volume}
    return empty, shares | {"holes": holes.count, "holes_possible": holes.behind[0] / volume} | opened


def _filled(surface: Surface) -> float:
    """Share of the surface that was neither measured nor closed at the support."""
    area = face_areas(surface.vertices, surface.faces)
    return float(area[~surface.observed & ~surface.inferred].sum() / area.sum())


def _before_black_sky(footage: dict[str, Any]) -> bool:
    """One still camera or rig before black sky: what is unlit is dark, and the Sun keeps its place."""
    one_mount = footage["kind"] == "stereo" or len(footage["cameras"]) == 1
    still = one_mount and not any(f.get("turn") for f in footage["frames"])
    return still and footage["background"] == "black" and not footage["masks_given"]


def _grey(job: Job, views: Views) -> list[np.ndarray]:
    """Undistorted images (h, w) of all views."""
    return [undistorted_frame(job, views, i, 0) for i in range(len(views))]


def _known_place(place: dict[str, Any]) -> tuple[np.ndarray, float] | None:
    """Middle (3,) and radius of a ball that holds a body of which no feature but its outlines tell where it is; `place` is `join.json`."""
    if place.get("middle") is None:
        return None
    return np.array(place["middle"], float), float(place["radius"])


def _extent(cloud: Cloud, place: dict[str, Any]) -> float:
    """How long the body is about [world units]; `place` is `join.json`."""
    if ball := _known_place(place):
        return 2 * ball[1]
    low, high = np.quantile(cloud.xyz, [0.01, 0.99], axis=0)
    return float(np.linalg.norm(high - low))


def _balance(views: Views, extent: float, footage: dict[str, Any]) -> Balance | None:
    """Where a free body's motion shows its centre of mass, by the images of the first camera; None where it does not."""
    from massprops.consistency.motion_side import centre_of_motion
    from massprops.sfm.attitude import clock
    from massprops.surface.fill_by_motion import Balance

    place = {f["name"]: int(f["index"]) for f in footage["frames"]}
    first = views.take(np.flatnonzero(views.of_first_camera))
    stamps = clock(first, np.array([place.get(n, i) for i, n in enumerate(first.names)]))[0]
    order = np.argsort(stamps, kind="stable")
    centre = centre_of_motion(stamps[order], first.R[order], first.t[order], extent)
    return None if centre is None else Balance(centre.place, centre.covariance)


def _surface(job: Job, seen: Evidence) -> tuple[Surface, list[np.ndarray], np.ndarray]:
    """The closed surface, its masks, and the places (k, 3) of parts that are lit at times and that it missed at first.

    Where it misses a part of a body before a black sky that silhouettes show when it is lit, it is made again without the sky that was seen
    there when it was not. That is taken where it holds more of the part and all in all misses less of the silhouettes: without sky about a
    dish, a boom elsewhere was lost.
    """
    from massprops.surface.silhouette_only import lit_at_times, spare_where_dark

    surface, masks = _closed(job, seen)
    if not seen.grey or not surface.observed.any() or surface.slope is not None:
        return surface, masks, np.zeros((0, 3))
    if surface.hull.outside_share > OUTSIDE or surface.share(~surface.observed) > MUCH_FILLED:
        surface, masks = _with_lit_sky(job, seen, surface, masks)
    lit = lit_at_times((surface.vertices, surface.faces), seen.views, masks, surface.hull, surface.spacing)
    if not len(lit):
        return surface, masks, lit
    again, spared = _closed(job, replace(seen, masks=spare_where_dark(seen.views, masks, lit)))
    near, far = (lost_share(s.vertices, lit, FAR * surface.spacing) for s in (again, surface))
    return (again, spared, lit) if near < far and _misses_less(seen, again, surface) else (surface, masks, lit)


def _with_lit_sky(
    job: Job, seen: Evidence, surface: Surface, masks: list[np.ndarray]
) -> tuple[Surface, list[np.ndarray]]:
    """The surface without the sky before sides that would not be lit, where that clearly misses less of the silhouettes, or where much of that
    sky lies before what was measured and it does not clearly miss more; else as it was given."""
    from massprops.surface.lit_sky import sky_where_lit

    if seen.sun is None:
        return surface, masks
    try:
        shown = sky_where_lit(seen.views, seen.masks, seen.grey, seen.cloud, seen.sun)
        again, shown = _closed(job, replace(seen, masks=shown))
    except NotPossible:
        return surface, masks
    # what was measured is there: sky before it is explained by darkness, or by nothing
    sigmas = -CLEARLY if surface.hull.outside_share > max(OUTSIDE, again.hull.outside_share) else CLEARLY
    return (again, shown) if _misses_less(seen, again, surface, sigmas) else (surface, masks)


def _misses_less(seen: Evidence, one: Surface, other: Surface, sigmas: float = 0.0) -> bool:
    """Whether one surface misses fewer of the silhouettes' pixels than the other, by so many standard errors of the mean over images."""
    from massprops.surface.silhouette_only import missed

    less, more = (
        np.array([np.count_nonzero(m) for m in missed((s.vertices, s.faces), seen.views, seen.masks)], float)
        for s in (one, other)
    )
    gain = more - less
    return bool(gain.mean() > sigmas * gain.std() / np.sqrt(len(gain)))


def _closed(job: Job, seen: Evidence) -> tuple[Surface, list[np.ndarray]]:
    """A closed surface, and its masks: of a body of which no feature but its outlines tell where it is, by its brightness if that explains
    it, and of its outlines alone where stereo measured nothing of it either."""
    from massprops.surface.cloud import Cloud
    from massprops.surface.outline_cloud import WIDE, surface_of_outlines
    from massprops.surface.plain_body import surface_by_brightness
    from massprops.surface.reconstruct import FILLED, STRETCHED, reconstruct_surface
    from massprops.surface.silhouette import shown_as_object
    from massprops.surface.unlit import spare_behind_light

    views, masks, place, ball = seen.views, seen.masks, seen.place, _known_place(seen.place)
    support = None if place["support_plane"] is None else np.array(place["support_plane"], float)
    fill = (STRETCHED if support is None and not seen.moving else FILLED) if seen.balance is None else seen.balance
    outlined = spare_behind_light(views, masks, seen.grey) if ball is not None and seen.grey else masks
    if ball is not None and seen.grey:
        lit = surface_by_brightness(views, outlined, seen.grey, ball, fill, job.seed, job.progress)
        if lit is not None:
            return lit, outlined
    beside = None
    if (job.work("join") / "other.npz").is_file():
        beside = Cloud.load(job.work("join") / "other.npz")
        beside = Cloud.joined([beside.take(np.flatnonzero(~shown_as_object(beside, views, masks))), seen.table])
    try:
        surface = reconstruct_surface(
            views,
            masks,
            seen.cloud,
            seed=job.seed,
            progress=job.progress,
            support=support,
            moving=seen.moving,
            surroundings=beside,
            fill=fill,
        )
        return surface, masks
    except NotPossible:
        if ball is None:
            raise
    return surface_of_outlines(views, outlined, ball[0], WIDE * ball[1], job.progress, support), outlined


def _facts(surface: Surface, lost: float, overlap: dict[str, float]) -> dict[str, Any]:
    """`surface.json`; lost: share of the measured points that the mesh misses; overlap: by image."""
    observed, inferred = surface.share(surface.observed), surface.share(surface.inferred)
    filled = 1 - observed - inferred
    warnings = []
    if surface.slope is not None:
        warnings.append(
            f"{100 * observed:.0f} % of the surface was measured by how bright it is, none by stereo: the body is taken to be of one paint"
        )
    if filled > 0.1:
        warnings.append(f"{100 * filled:.0f} % of the surface was not measured but filled from the silhouettes")
    if inferred > 0.02:
        warnings.append(f"{100 * inferred:.0f} % of the surface stood on its support, unseen, and was closed there")
    partial = None
    if filled > MOST_FILLED:
        partial = f"only {100 * observed:.0f} % of the surface was measured: the body is mostly filled in"
        warnings.append(partial)
    if lost > MOST_LOST:
        partial = (
            f"{100 * lost:.0f} % of the measured points are not on the mesh: a part with a thin connection is missing"
        )
        warnings.append(partial)
    return {
        "watertight": closed(surface.vertices, surface.faces),
        "observed_fraction": observed,
        "inferred_fraction": inferred,
        "area": float(face_areas(surface.vertices, surface.faces).sum()),
        "vertices": len(surface.vertices),
        "faces": len(surface.faces),
        "spacing": surface.spacing,
        "silhouette_overlap": float(np.nanmedian(list(overlap.values()))),
        "silhouette_overlap_by_image": {k: round(float(o), 4) for k, o in overlap.items() if np.isfinite(o)},
        "views_that_carve": surface.hull.need,
        "outside_share": surface.hull.outside_share,
        "slope_sigma": surface.slope,
        "fill": None if surface.fill is None else asdict(surface.fill),
        "warnings": warnings,
        "partial": partial,
    }


def closed(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether a mesh, vertices (v, 3) and faces (f, 3), is a volume: two faces at each edge, which run along it in opposite
    directions, and space within."""
    one, other = np.asarray(faces, np.int64), np.roll(np.asarray(faces, np.int64), -1, axis=1)
    there, back = (np.sort((a * len(vertices) + b).ravel()) for a, b in ((one, other), (other, one)))
    paired = len(there) > 0 and np.array_equal(there, back) and bool((np.diff(there) > 0).all())
    return paired and bool(mesh_integrals(vertices, faces)[0] > 0)
