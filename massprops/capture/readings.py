"""Which of what stands on the support is the object: as the user points, or as the cameras look; and what else it may be.

Two readings can fit the same points: an object, and the object with the stand, foam or plate that it stands on; or two
things of like size side by side. Nothing in the points decides between them, so both are named. Of another colour, a stand is
left out of what is measured; of the same colour, the two are measured as one thing, such as a machined part with its boss.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from massprops.capture.choice import Located
from massprops.capture.support import (
    CAMERAS_ABOVE,
    MOST_BELOW,
    TOLERANCE,
    OnSupport,
    axes,
    find_support,
    label_pieces,
    on_plane,
    planes,
    split,
    thin_cells,
)
from massprops.dense.region import Region
from massprops.errors import NotPossible
from massprops.geometry.projection import on_pixels, project
from massprops.views import Views

PARALLEL = 0.97
"""Cosine between normals of planes that are parallel."""
SLOPES = 0.5
"""A stand's top differs in height by at most this share of it. Planes through what scatters above a glossy table reach down to it: about a bottle's
foot (Blender, 4.5 degrees from its table) and beside a screwdriver (1.9 of its height). Foam 5 cm high that leans by 5 degrees under 10 cm has .17.
No leaning stand was measured."""
NEAR_PX = (3.0, 6.0, 12.0)
"""Distances from the pixel pointed at within which points are looked for, one after the other [px]."""
DEEP = 0.05
"""Points this much farther than the nearest, in radii of the region, lie behind it."""
LIKE_WEIGHT, LIKE_SIZE = 0.3, 0.5
"""Another piece is of like size when it holds this share of the first one's weight about the middle of the views, and
this share of its extent. Neighbours on the cluttered bench tables hold 0.1 of it at most."""
LEAST_UPPER = 0.1
"""Share of a piece's points that rise above a level within it, for that level to carry something."""
AROUND = 9
"""Of 12 sectors about the foot of what is carried, those in which a stand's top must reach beyond it."""
FOOT = 0.25
"""The foot: the lowest part of what is carried, of its height."""
WIDER = 1.25
"""A stand is nowhere this much wider than its top: a foam block, a plate, a plinth."""
ALIKE = 0.6
"""Overlap of the colours of stand and carried (Bhattacharyya) above which they may as well be one thing: a plate with its
handle, a machined part with its boss."""
APART = 1.25
"""Distance of the hues of stand and carried, in standard deviations within them, from which on both readings are shown however
alike their colours are in light and shade: 1.4, 2.8 and 5.5 for three plain pale figures on plain pale blocks (overlap of colours
.74, .81 and .78); within one thing at most 0.2 (shoe), 0.8 (plate and handle of a stamp), 1.1 (levels of a banana). Set between
these, as a needless question harms less than a stand that is taken in silently: at 2 the first figure was 276 % too large at
`medium`."""
HUE_FLOOR = 0.02
"""Least standard deviation of a hue: two steps in a hundred grey levels."""
FACING = 0.85
"""Cosine between a point's normal and a level's from which on the point may lie on it."""
NARROW = 0.25
"""Width of a ledge, over the radius of a disc as large as what rises from it, below which it is a moulding that follows the
object's outline: the sole of a shoe (Blender) has .19; a square about a disc reaches beyond it by .41 at least."""
LOW, HIGHEST = 0.5, 99.0
"""Height of a narrow ledge, over that of the whole (a percentile of its points), below which it may be a stand's after all: the sole
of a shoe lies at .2. Rims near the top of a jug (.94) and of a rock (.91) carry nothing that one would call an object."""
COLOUR_BINS = 8
LOWEST = 1.0
"""Percentile of heights at which a plate ends: what lies below it are wrong matches."""
LEDGE = 0.5
"""Points half-way between support and top, over those on the top, above which there is no ledge but a slope: 0.02 for
rendered blocks, 5 for a fringe of table points at the foot of a printed box."""


KEEP_SUPPORT = "--keep-support"
"""The option by which the user asks for the object with what it stands on."""


@dataclass(frozen=True)
class Reading:
    """One answer to what the object is.

    Attributes:
        what: in words.
        member: (n,) bool, its points.
        plane: (4,) what it stands on, or None.
        option: how the user asks for it.
        one_if_moved: if it was moved as a whole, it is one thing, and the other readings fall.
    """

    what: str
    member: np.ndarray
    plane: np.ndarray | None
    option: str
    one_if_moved: bool = False


@dataclass(frozen=True)
class Top:
    """A level on which something stands all about: plane (4,), whether what is below is of the same colour, whether the
    level is but a narrow rim that follows the outline of what is above it, and how high it lies, of the height of the whole."""

    plane: np.ndarray
    alike: bool
    narrow: bool
    height: float


@dataclass(frozen=True)
class Scene:
    """Dense points of the region: xyz, normal (n, 3), rgb (n, 3) uint8; the views and their region; size of a pixel at
    the object [units of the reconstruction]."""

    xyz: np.ndarray
    normal: np.ndarray
    rgb: np.ndarray
    views: Views
    region: Region
    pixel: float


@dataclass(frozen=True)
class Found:
    """The object, and the readings between which nothing decides, the one that is used first; none where one fits. `narrow_ledge`:
    a low and narrow ledge of its own colour runs all about it, and is taken for a part of it."""

    split: OnSupport
    readings: list[Reading] = field(default_factory=list)
    narrow_ledge: bool = False


def find_object(
    scene: Scene,
    pointed: Sequence[Located] = (),
    keep_support: bool = False,
    seed: int = 0,
    known: np.ndarray | None = None,
    turning: bool = False,
) -> Found:
    """The object among the points of a region.

    Args:
        scene: the points.
        pointed: what the user points at in these views.
        keep_support: what it stands on belongs to it, down to the lowest plane seen.
        seed: of the draws.
        known: (4,) support of another placement in the same room.
        turning: the camera stood still, and what was measured turned before it.

    Raises:
        NotPossible: the user points at the support or at nothing.
    """
    plane = find_support(scene.xyz, scene.normal, scene.views.centres, scene.region, seed)
    plate = turning_plate(scene, seed) if turning and plane is None and not keep_support else None
    if plate is not None and not plate.alike:
        plane = plate.plane
    if known is not None and (plane is None or plane[:3] @ known[:3] < PARALLEL) and _bears(scene, known):
        plane = known
    if keep_support and plane is not None:
        plane = lowest_support(scene, plane, seed)
    first = split(scene.xyz, scene.normal, plane, scene.region, scene.pixel)
    plane = first.plane
    piece, weight = label_pieces(scene.xyz, scene.normal, plane, scene.region, scene.pixel)
    if pointed:
        chosen = _chosen(scene, piece, plane, pointed)
        first = _as_split(scene, piece, chosen, plane)
    elif not first.member.any():
        return Found(first)
    if keep_support:
        return Found(first)
    top = stand_top(scene, first.member, plane, seed) if plane is not None else plate
    moulding = top is not None and top.alike and top.narrow and not pointed
    if top is not None and not moulding:
        return _with_stand(scene, first, top, pointed)
    ledge = top is not None and moulding and top.height < LOW
    return Found(first, [] if pointed else _rivals(scene, first, piece, weight), ledge)


def _bears(scene: Scene, plane: np.ndarray) -> bool:
    """Whether a plane (4,) may carry all that was measured: next to nothing lies below it, and the cameras above.

    A flat side that faces the cameras is the largest plane of images that show little of the table.
    """
    height = scene.xyz @ plane[:3] + plane[3]
    above = np.mean(scene.views.centres @ plane[:3] + plane[3] > 0)
    return bool(np.mean(height < -2 * TOLERANCE * scene.region.radius) < MOST_BELOW and above > CAMERAS_ABOVE)


def _as_split(scene: Scene, piece: np.ndarray, member: np.ndarray, plane: np.ndarray | None) -> OnSupport:
    """The chosen points as the object; the support and other large pieces as the surroundings."""
    from massprops.capture.support import LEAST_PIECE

    count = np.bincount(piece[~member & (piece > 0)], minlength=piece.max() + 1)
    other = (count >= LEAST_PIECE)[piece] & ~member & (piece > 0)
    if plane is not None:
        other |= on_plane(scene.xyz, scene.normal, plane, TOLERANCE * scene.region.radius) & ~member
    return OnSupport(member, other, plane)


# ---- what the user points at


def _chosen(scene: Scene, piece: np.ndarray, plane: np.ndarray | None, pointed: Sequence[Located]) -> np.ndarray:
    member = np.zeros(len(piece), bool)
    for one in pointed:
        if one.pointed.is_box:
            member |= _in_box(scene, piece, one)
        else:
            member |= piece == piece_at(scene, piece, one)
    return member


def _seen(scene: Scene, view: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) and depths (n,) of all points in one view; NaN behind the camera."""
    v = scene.views
    uv, z = project(scene.xyz, v.K[view], v.R[view], v.t[view])
    ahead = z > 1e-9
    return np.where(ahead[:, None], uv, np.nan), np.where(ahead, z, np.nan)


def piece_at(scene: Scene, piece: np.ndarray, at: Located) -> int:
    """The piece that a pixel shows.

    Args:
        scene: the points; piece: (n,) of `label_pieces`.
        at: the pixel.

    Raises:
        NotPossible: it shows the support or nothing that was measured.
    """
    uv, z = _seen(scene, at.view)
    away = np.hypot(*(uv - at.uv[0]).T)
    deep = DEEP * scene.region.radius
    front = 0
    for radius in NEAR_PX:
        near = np.flatnonzero(away < radius)
        if len(near) < 3:
            continue
        front = int(np.bincount(piece[near[z[near] < np.nanmin(z[near]) + deep]]).argmax())
        if front:
            return front
        break
    covers = [(np.nanmedian(z[piece == k]), k) for k in _outlines(piece, uv, at)]
    if covers:
        return min(covers)[1]
    what = "shows the background or what the object stands on"
    raise NotPossible(
        f"{at.pointed.option}: that pixel of {at.name} {what}: give a pixel on the object, or a rectangle round it "
        "with --box"
    )


def _outlines(piece: np.ndarray, uv: np.ndarray, at: Located) -> list[int]:
    """Pieces within whose convex outline the pixel lies: glossy and plain sides have no points of their own."""
    import cv2

    found = []
    for k in np.unique(piece[piece > 0]):
        own = uv[piece == k]
        own = own[np.isfinite(own).all(1)]
        if len(own) < 20:
            continue
        outline = cv2.convexHull(own.astype(np.float32))
        if cv2.pointPolygonTest(outline, tuple(float(v) for v in at.uv[0]), False) >= 0:
            found.append(int(k))
    return found


def _in_box(scene: Scene, piece: np.ndarray, at: Located) -> np.ndarray:
    """(n,) bool: the largest thing that lies in a rectangle of one view, and its other large parts there."""
    uv, _ = _seen(scene, at.view)
    low, high = at.uv.min(0), at.uv.max(0)
    inside = (piece > 0) & ((uv >= low) & (uv <= high)).all(1)
    count, whole = (np.bincount(piece[m], minlength=piece.max() + 1) for m in (inside, piece > 0))
    if not inside.any() or count.max() < 20:
        raise NotPossible(
            f"{at.pointed.option}: nothing that rises from its support was measured in that rectangle of {at.name}: "
            "draw it round the object"
        )
    # what lies behind the object shows a part only
    mostly = (count > 0.6 * np.maximum(whole, 1)) & (count >= 0.1 * count.max())
    mostly[int(count.argmax())] = True
    return inside & mostly[piece]


# ---- what it stands on


def lowest_support(scene: Scene, plane: np.ndarray, seed: int = 0) -> np.ndarray:
    """The lowest plane seen that is parallel to a support and below it, or the support itself."""
    few = thin_cells(scene.xyz, scene.region.radius / 150)
    xyz, normal = scene.xyz[few], scene.normal[few]
    middle = scene.region.centre
    best, depth = plane, 0.0
    for other in planes(xyz, normal, scene.region.radius, seed):
        below = float((other[:3] @ middle + other[3]) - (plane[:3] @ middle + plane[3]))
        parallel = other[:3] @ plane[:3] > PARALLEL
        if parallel and below > max(depth, 4 * TOLERANCE * scene.region.radius):
            best, depth = other, below
    return best


def stand_top(scene: Scene, member: np.ndarray, plane: np.ndarray | None, seed: int = 0) -> Top | None:
    """The level within a piece on which something else may stand, one of another colour first, then one that is no moulding; None where
    there is none.

    Args:
        scene: the points; member: (n,) bool, the piece.
        plane: (4,) what the piece stands on.
        seed: of the draws.
    """
    if plane is None or member.sum() < 500:
        return None
    own = np.flatnonzero(member)
    height = scene.xyz[own] @ plane[:3] + plane[3]
    facing = own[scene.normal[own] @ plane[:3] > FACING]
    if len(facing) < 200:
        return None
    radius = 0.5 * float(np.linalg.norm(np.ptp(scene.xyz[own], axis=0)))
    found = []
    for top in planes(scene.xyz[facing], scene.normal[facing], min(scene.region.radius, 2 * radius), seed):
        rise = scene.xyz[own] @ top[:3] + top[3]
        step = max(2 * TOLERANCE * scene.region.radius, 2 * scene.pixel)
        upper, lower, near = rise > step, rise < -step, np.abs(rise) < step
        if (
            top[:3] @ plane[:3] < PARALLEL
            or upper.mean() < LEAST_UPPER
            or np.median(height[near]) < step
            or _slopes(rise[near], height[near], float(top[:3] @ plane[:3]))
        ):
            continue
        level = own[near]
        if not _is_ledge(scene, level, plane):
            continue
        rgb = scene.rgb[own]
        alike = _colours_alike(rgb, upper, ~upper) >= ALIKE and _hues_apart(rgb[upper], rgb[~upper]) <= APART
        if _carried(scene, own, rise, step, top):
            worth = float(upper.mean() * lower.mean() + upper.mean())
            share = float(np.median(height[near]) / np.percentile(height, HIGHEST))
            narrow = _is_narrow(scene, own, rise, step, top)
            # the foot of a figure is a moulding too, and hides no stand below it
            found.append((not alike, not narrow, worth, Top(top, alike, narrow, share)))
    return max(found, key=lambda f: f[:3])[3] if found else None


def _slopes(rise: np.ndarray, height: np.ndarray, parallel: float) -> bool:
    """Whether a level lies so much higher on one side of itself than on the other that it is no top of a stand.

    Args:
        rise, height: (k,) of its points above the level and above the support; parallel: cosine between the normals of the two.
    """
    level = height - rise / parallel
    low, high = np.percentile(level, [5, 95])
    return bool(high - low > SLOPES * np.median(level))


def turning_plate(scene: Scene, seed: int = 0) -> Top | None:
    """The top of a turntable's plate on which something stands, one of another colour first, or None.

    Where the camera stays and things turn, stereo measures nothing of the room: what carries the plate is not seen, and
    the plate's rim lies below its top, so that the top is no support by `find_support`.

    Args:
        scene: the points of all that turns.
        seed: of the draws.
    """
    few = thin_cells(scene.xyz, scene.region.radius / 150)
    everyone = np.ones(len(scene.xyz), bool)
    found = []
    for plane in planes(scene.xyz[few], scene.normal[few], scene.region.radius, seed):
        if np.mean(scene.views.centres @ plane[:3] + plane[3] > 0) < CAMERAS_ABOVE:
            continue
        # down to the foot of the rim
        foot = np.append(plane[:3], plane[3] - np.percentile(scene.xyz @ plane[:3] + plane[3], LOWEST))
        top = stand_top(scene, everyone, foot, seed)
        if top is not None and not top.alike:
            return top
        found.append(top)
    return next((top for top in found if top is not None), None)


def _carried(scene: Scene, own: np.ndarray, rise: np.ndarray, step: float, top: np.ndarray) -> bool:
    """Whether a level reaches beyond the foot of what is above it, all about, and nothing below is wider."""
    level, lower = np.abs(rise) < step, rise < -step
    first, second = axes(top)
    x, y = scene.xyz[own] @ first, scene.xyz[own] @ second
    foot = _foot(rise, step)
    if foot.sum() < 20 or level.sum() < 50:
        return False
    middle = np.median(x[foot]), np.median(y[foot])
    away, turn = np.hypot(x - middle[0], y - middle[1]), np.arctan2(y - middle[1], x - middle[0])
    sector = np.floor((turn / (2 * np.pi) + 0.5) * 12).astype(int) % 12
    beyond = 0
    for k in range(12):
        here = sector == k
        reach = np.percentile(away[foot & here], 90) if (foot & here).sum() >= 3 else 0.0
        beyond += int((level & here & (away > 1.05 * reach)).sum() >= 3)
    if beyond < AROUND:
        return False
    centre = np.median(x[level]), np.median(y[level])
    out = np.hypot(x - centre[0], y - centre[1])
    return not lower.any() or np.percentile(out[lower], 95) < WIDER * np.percentile(out[level], 95)


def _foot(rise: np.ndarray, step: float) -> np.ndarray:
    """(k,) bool: the lowest part of what rises from a level, of points whose heights above it are `rise` (k,)."""
    upper = rise > step
    return np.asarray(upper & (rise < step + FOOT * np.percentile(rise[upper], 98)))


def _is_narrow(scene: Scene, own: np.ndarray, rise: np.ndarray, step: float, top: np.ndarray) -> bool:
    """Whether a level is a narrow rim about the foot of what is above it; arguments of `_carried`."""
    import cv2

    flat = (scene.xyz[own] @ np.stack(axes(top), axis=1)).astype(np.float32)
    level = flat[(np.abs(rise) < step) & (scene.normal[own] @ top[:3] > FACING)]
    foot = cv2.convexHull(_dense(flat[_foot(rise, step)], step))
    beyond = [-cv2.pointPolygonTest(foot, (float(x), float(y)), True) for x, y in level]
    radius = np.sqrt(cv2.contourArea(foot) / np.pi)
    return bool(np.percentile(np.maximum(beyond, 0.0), 95) < NARROW * radius)


STRAY = 0.2
"""Points of a cell, over those of the cell in which the median point lies, below which they are wrong matches: a few of them about a plain
grey figure on a plain grey block made its foot reach to the block's edge, and the ledge a moulding."""


def _dense(flat: np.ndarray, size: float) -> np.ndarray:
    """Those of the points (k, 2) that lie in cells of a grid of `size` with many others."""
    cell = np.floor(flat / size).astype(np.int64)
    _, which, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    own = count[which.ravel()]
    return flat[own >= STRAY * np.median(own)]


def _is_ledge(scene: Scene, level: np.ndarray, plane: np.ndarray) -> bool:
    """Whether points of a level (indices) end at a step down to the support, not in a slope.

    The support's own points about an object's foot come out a little high, and a tilted plane through them looks like the
    top of a thin stand.
    """
    first, second = axes(plane)
    flat = scene.xyz @ np.stack([first, second], axis=1)
    away = np.linalg.norm(flat - np.median(flat[level], axis=0), axis=1)
    height = scene.xyz @ plane[:3] + plane[3]
    top = float(np.median(height[level]))
    here = (away < np.percentile(away[level], 95)) & (scene.normal @ plane[:3] > FACING)
    between = here & (np.abs(height - 0.5 * top) < 0.15 * top)
    on_top = here & (np.abs(height - top) < 0.15 * top)
    return bool(between.sum() < LEDGE * max(on_top.sum(), 1))


def _colours_alike(rgb: np.ndarray, one: np.ndarray, other: np.ndarray) -> float:
    """Bhattacharyya coefficient of the colours of two sets of points, 0 to 1."""
    from scipy.ndimage import gaussian_filter

    cell = (rgb.astype(int) * COLOUR_BINS // 256) @ [COLOUR_BINS**2, COLOUR_BINS, 1]
    share = []
    for chosen in (one, other):
        count = np.bincount(cell[chosen], minlength=COLOUR_BINS**3).reshape((COLOUR_BINS,) * 3).astype(float)
        smooth = gaussian_filter(count, 0.5).ravel()
        share.append(smooth / max(smooth.sum(), 1e-9))
    return float(np.sqrt(share[0] * share[1]).sum())


def _hues_apart(one: np.ndarray, other: np.ndarray) -> float:
    """Mahalanobis distance between the middles of two sets of colours (n, 3) uint8 without their brightness: logarithms of
    red and green over blue, which light and shade leave as they are. Their covariance is the mean of both."""
    middle, spread = [], np.zeros((2, 2))
    for rgb in (one, other):
        level = np.log(rgb.astype(float) + 1)
        hue = level[:, :2] - level[:, 2:]
        middle.append(np.median(hue, axis=0))
        away = np.linalg.norm(hue - middle[-1], axis=1)
        # what is far off is a reflection or a wrong match
        spread += 0.5 * np.cov(hue[away <= np.percentile(away, 90)].T)
    off = middle[0] - middle[1]
    return float(np.sqrt(off @ np.linalg.solve(spread + HUE_FLOOR**2 * np.eye(2), off)))


def _with_stand(scene: Scene, whole: OnSupport, top: Top, pointed: Sequence[Located]) -> Found:
    """Object without its stand, the stand among the surroundings; with it where the user points at the stand. Of one colour,
    it is one thing first."""
    rise = scene.xyz @ top.plane[:3] + top.plane[3]
    step = max(1.5 * TOLERANCE * scene.region.radius, 1.5 * scene.pixel)
    upper = whole.member & (rise > step)
    alone = OnSupport(upper, whole.other | (whole.member & ~upper), top.plane)
    if not pointed and top.alike:
        return Found(
            whole,
            [
                Reading(
                    "one thing with a flat ledge all about it",
                    whole.member,
                    whole.plane,
                    "--object X,Y with a pixel below the ledge",
                    one_if_moved=True,
                ),
                Reading("what rises from that ledge", upper, top.plane, "--object X,Y with a pixel above the ledge"),
            ],
        )
    if not pointed:
        what, option = "the object without what it stands on", "--object X,Y with a pixel of the object"
        kept = Reading("the object with what it stands on", whole.member, whole.plane, KEEP_SUPPORT)
        return Found(alone, [Reading(what, upper, top.plane, option), kept])
    pixels = [p for p in pointed if not p.pointed.is_box]
    if not pixels:  # a rectangle round both says that both are meant
        return Found(whole)
    of = np.where(upper, 1, np.where(whole.member, 2, 0))
    hit = {piece_at(scene, of, p) for p in pixels}
    return Found(whole if 2 in hit else alone)


# ---- what stands beside it


def _rivals(scene: Scene, found: OnSupport, piece: np.ndarray, weight: np.ndarray) -> list[Reading]:
    """The object and other pieces of like size and place; none where it is alone."""
    own = np.bincount(piece[found.member & (piece > 0)], minlength=len(weight))
    if not own.any():
        return []
    first = int(own.argmax())
    out = [Reading("the thing most in the middle", found.member, found.plane, "--object X,Y with a pixel of it")]
    size = _extent(scene.xyz[piece == first], found.plane)
    for k in np.argsort(-weight, kind="stable"):
        if k == first or k == 0 or weight[k] < LIKE_WEIGHT * weight[first]:
            continue
        other = _extent(scene.xyz[piece == k], found.plane)
        like = LIKE_SIZE < other.max() / max(size.max(), 1e-12) < 1 / LIKE_SIZE and _apart(
            scene, piece, first, int(k), found
        )
        if like:
            out.append(Reading("another of like size", piece == k, found.plane, "--object X,Y with a pixel of it"))
    return out if len(out) > 1 else []


def _apart(scene: Scene, piece: np.ndarray, a: int, b: int, found: OnSupport) -> bool:
    """Whether two pieces are two things: the support shows between them. Parts of one thing are joined by a side on which
    nothing could be measured."""
    from scipy.spatial import cKDTree

    one, two = scene.xyz[piece == a], scene.xyz[piece == b]
    away, place = cKDTree(one).query(two)
    nearest = np.argsort(away, kind="stable")[: max(1, len(away) // 20)]
    gap = float(away[nearest[0]])
    if found.plane is None:
        return gap > 0.25 * float(min(_extent(one).max(), _extent(two).max()))
    middle = 0.5 * (two[nearest] + one[place[nearest]]).mean(0)
    held = scene.xyz[on_plane(scene.xyz, scene.normal, found.plane, TOLERANCE * scene.region.radius)]
    n = found.plane[:3]
    flat = held - middle - ((held - middle) @ n)[:, None] * n
    return int((np.linalg.norm(flat, axis=1) < 0.25 * gap).sum()) >= 3


def _extent(xyz: np.ndarray, plane: np.ndarray | None = None) -> np.ndarray:
    """(3,) lengths of points, largest first: above a plane and along the principal axes within it, or along all three."""
    middle = xyz - xyz.mean(0)
    low = np.zeros((0, 2))
    if plane is not None:
        height = middle @ plane[:3]
        low = np.percentile(height, [1, 99])[None]
        middle = middle - height[:, None] * plane[:3]
    turn = np.linalg.svd(middle[:: max(1, len(middle) // 5000)], full_matrices=False)[2][: 3 - len(low)]
    reach = np.concatenate([low, np.percentile(middle @ turn.T, [1, 99], axis=0).T])
    return np.sort(reach[:, 1] - reach[:, 0])[::-1]


def described(reading: Reading, scene: Scene, used: bool) -> dict[str, Any]:
    """A reading for `shape.json`: in words, its extent [units of the reconstruction], whether it is used, the option, and
    whether the object is that if it was moved as a whole."""
    return {
        "reading": reading.what,
        "extent": [float(v) for v in _extent(scene.xyz[reading.member], reading.plane)],
        "points": int(reading.member.sum()),
        "used": used,
        "option": reading.option,
        "one_if_moved": reading.one_if_moved,
    }


def best_view(reading: Reading, scene: Scene) -> int:
    """The view that shows most of a reading's points, the first of equal ones."""
    shown = []
    for i in range(len(scene.views)):
        uv, _ = _seen(scene, i)
        own = uv[reading.member]
        shown.append(round(float(((own > 0) & (own < scene.views.size[i] - 1)).all(1).mean()), 2))
    return int(np.argmax(shown))


def picture(reading: Reading, scene: Scene, view: int, image: np.ndarray, width: int = 480) -> np.ndarray:
    """The image (h, w, 3) BGR, undistorted, with a reading's points laid over in green, `width` pixels wide."""
    import cv2

    uv, _ = _seen(scene, view)
    factor = width / image.shape[1]
    out: np.ndarray = cv2.resize(image, (width, max(1, round(image.shape[0] * factor))), interpolation=cv2.INTER_AREA)
    mask = np.zeros((out.shape[0], out.shape[1]), np.uint8)
    _, rows, columns = on_pixels(factor * uv[reading.member], mask.shape)
    mask[rows, columns] = 1
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    out[mask > 0] = (0.55 * out[mask > 0] + 0.45 * np.array((96, 220, 110))).astype(np.uint8)
    return out
