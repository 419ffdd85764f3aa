"""What an object stands on that was measured with it: the lowest support, and the top of a stand within a piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.capture.scene import Scene
from massprops.capture.support import CAMERAS_ABOVE, TOLERANCE, axes, planes, thin_cells

PARALLEL = 0.97
"""Cosine between normals of planes that are parallel."""
SLOPES = 0.5
"""A stand's top differs in height by at most this share of it. Planes through what scatters above a glossy table reach down to it: about a bottle's
foot (Blender, 4.5 degrees from its table) and beside a screwdriver (1.9 of its height). Foam 5 cm high that leans by 5 degrees under 10 cm has .17.
No leaning stand was measured."""
LEAST_UPPER = 0.1
"""Share of a piece's points that rise above a level within it, for that level to carry something."""
AROUND = 9
"""Of 12 sectors about the foot of what is carried, those in which a stand's top must reach beyond it."""
FOOT = 0.25
"""The foot: the lowest part of what is carried, of its height."""
WIDER = 1.25
"""A stand is nowhere this much wider than its top: a foam block, a plate, a plinth."""
FLAT = 0.65
"""Share of what faces up beside the foot, within four times the height up to which points are on a level, that lies on it, from which on the
level is flat: of the plate of a photographed stamp and of a plain block (Blender) .95 and .90 to .98 lie there, of bananas side by side .40, of a
slope .25. Asked where colours do not tell a stand from what it carries."""
TILTED_DEG = 10.0
"""Angle between a level and the median point on it beside the foot from which on it is a slice of something round: 4 to 8 degrees on the plate of a
photographed stamp, 14 to 22 of bananas side by side, of which a seed in two found such a level, and 22 of a shoe (Blender)."""
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
STRAY = 0.2
"""Points of a cell, over those of the cell in which the median point lies, below which they are wrong matches: a few of them about a plain
grey figure on a plain grey block made its foot reach to the block's edge, and the ledge a moulding."""


@dataclass(frozen=True)
class Top:
    """A level on which something stands all about: plane (4,), whether what is below is of the same colour, whether the
    level is but a narrow rim that follows the outline of what is above it, and how high it lies, of the height of the whole."""

    plane: np.ndarray
    alike: bool
    narrow: bool
    height: float


def lowest_support(scene: Scene, plane: np.ndarray, seed: int = 0) -> np.ndarray:
    """The lowest plane (4,) seen that is parallel to a support (4,) and below it, or the support itself."""
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
    members = np.flatnonzero(member)
    height = scene.xyz[members] @ plane[:3] + plane[3]
    facing = members[scene.normal[members] @ plane[:3] > FACING]
    if len(facing) < 200:
        return None
    radius = 0.5 * float(np.linalg.norm(np.ptp(scene.xyz[members], axis=0)))
    tops = []
    for top in planes(scene.xyz[facing], scene.normal[facing], min(scene.region.radius, 2 * radius), seed):
        rise = scene.xyz[members] @ top[:3] + top[3]
        step = max(2 * TOLERANCE * scene.region.radius, 2 * scene.pixel)
        upper, lower, near = rise > step, rise < -step, np.abs(rise) < step
        if (
            top[:3] @ plane[:3] < PARALLEL
            or upper.mean() < LEAST_UPPER
            or np.median(height[near]) < step
            or _slopes(rise[near], height[near], float(top[:3] @ plane[:3]))
        ):
            continue
        level = members[near]
        if not _is_ledge(scene, level, plane):
            continue
        rgb = scene.rgb[members]
        alike = _colours_alike(rgb, upper, ~upper) >= ALIKE and _hues_apart(rgb[upper], rgb[~upper]) <= APART
        if _carried(scene, members, rise, step, top) and not (alike and _is_round(scene, members, rise, step, top)):
            worth = float(upper.mean() * lower.mean() + upper.mean())
            share = float(np.median(height[near]) / np.percentile(height, HIGHEST))
            narrow = _is_narrow(scene, members, rise, step, top)
            # the foot of a figure is a moulding too, and hides no stand below it
            tops.append((not alike, not narrow, worth, Top(top, alike, narrow, share)))
    return max(tops, key=lambda f: f[:3])[3] if tops else None


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
    tops = []
    for plane in planes(scene.xyz[few], scene.normal[few], scene.region.radius, seed):
        if np.mean(scene.views.centres @ plane[:3] + plane[3] > 0) < CAMERAS_ABOVE:
            continue
        # down to the foot of the rim
        foot = np.append(plane[:3], plane[3] - np.percentile(scene.xyz @ plane[:3] + plane[3], LOWEST))
        top = stand_top(scene, everyone, foot, seed)
        if top is not None and not top.alike:
            return top
        tops.append(top)
    return next((top for top in tops if top is not None), None)


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
    level = (np.abs(rise) < step) & (scene.normal[own] @ top[:3] > FACING)
    beyond, radius = _beyond_foot(scene, own, rise, step, top, level)
    return bool(np.percentile(np.maximum(beyond, 0.0), 95) < NARROW * radius)


def _is_round(scene: Scene, own: np.ndarray, rise: np.ndarray, step: float, top: np.ndarray) -> bool:
    """Whether what faces up beside the foot of what is above a level does not lie on the level, or faces other ways than it; arguments of
    `_carried`."""
    near = (np.abs(rise) < 4 * step) & (scene.normal[own] @ top[:3] > FACING)
    beside = _beyond_foot(scene, own, rise, step, top, near)[0] > 0
    on = beside & (np.abs(rise[near]) < step)
    if on.sum() < FLAT * max(beside.sum(), 1):
        return True
    return bool(np.median(scene.normal[own][near][on] @ top[:3]) < np.cos(np.deg2rad(TILTED_DEG)))


def _beyond_foot(
    scene: Scene, own: np.ndarray, rise: np.ndarray, step: float, top: np.ndarray, chosen: np.ndarray
) -> tuple[np.ndarray, float]:
    """How far beyond the foot of what is above a level those `chosen` (k,) bool of its points lie, negative within it, and the radius of a disc
    as large as the foot; other arguments of `_carried`."""
    import cv2

    flat = (scene.xyz[own] @ np.stack(axes(top), axis=1)).astype(np.float32)
    foot = cv2.convexHull(_dense(flat[_foot(rise, step)], step))
    beyond = [-cv2.pointPolygonTest(foot, (float(x), float(y)), True) for x, y in flat[chosen]]
    return np.array(beyond), float(np.sqrt(cv2.contourArea(foot) / np.pi))


def _dense(flat: np.ndarray, size: float) -> np.ndarray:
    """Those of the points (k, 2) that lie in cells of a grid of `size` with many others."""
    cell = np.floor(flat / size).astype(np.int64)
    _, which, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    count_in_cell = count[which.ravel()]
    return flat[count_in_cell >= STRAY * np.median(count_in_cell)]


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
