"""An object that was set down anew between photographs, in a room that stayed: which image shows which placement.

The cameras' poses come from the room and say nothing of the turn. The object's own features do: each is seen from many
directions, but in one placement only. Two images that look from like directions and yet share none of the object's
features show two placements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeGuard

import numpy as np

from massprops.dense.region import Region
from massprops.geometry.vectors import angles_deg

LIKE_DEG = 25.0
"""Angle between two directions of view below which one placement would show the same features."""
LEAST_PAIRS = 6
"""Pairs of like direction across a division without which it is not believed."""
MET = 0.6
"""Least share of each part's images that look from like directions as some image of the other."""
NEXT_DEG = 12.0
"""Angle within which one placement is sure to show the same features. Where only one part meets the other, pairs so near
across the division must share less than pairs of like direction within it, which are farther apart: next to a border of
one placement they share more."""
LEAST_COMPONENT = 0.3
"""Part of its largest component from which on a component of the dividing eigenvector has a sign."""
LEAST_SHARED = 3
"""Features in common with a placement's images, all together, that make an image one of them."""
NEIGHBOURS = 3
"""Decided images on each side, in the order of capture, that must show the same placement to decide one between them."""
PAUSE = 5.0
"""A pause this many times the usual one between two images is when hands were at work."""
LEAST_POINTS = 60
"""Sparse points on the object without which no division is looked for."""
FEW = 0.25
"""A division is believed where images of like direction share less than this part across it of what they share within
it. On two rendered sets of 36 + 36 and 30 + 30 photographs the medians were 12 within and 0 across."""
FLAT = 0.012
"""Half thickness of the plane of support among sparse points, in radii of the region."""


@dataclass(frozen=True)
class Placements:
    """label (n,) int, 0 for the placement that most images show, -1 for an image that shares no feature with any;
    handled (n,) int, other numbers where features say that hands turned the object in a pause between; known: whether there were
    features enough to tell."""

    label: np.ndarray
    handled: np.ndarray
    known: bool = True

    def turned_between(self, one: np.ndarray, other: np.ndarray) -> bool:
        """Whether a pause in which the object was turned parts the images `one` and `other`, (k,) and (m,) of them."""
        return not np.isin(self.handled[one], self.handled[other]).any()

    @property
    def count(self) -> int:
        """How many placements there are."""
        return int(self.label.max(initial=0)) + 1


def shared_features(views: int, obs_view: np.ndarray, obs_point: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(n, n) number of the object's points that two views both see; own (m,) bool says which points are its."""
    from scipy.sparse import coo_matrix

    use = own[obs_point]
    shape = (views, len(own))
    seen = coo_matrix((np.ones(int(use.sum())), (obs_view[use], obs_point[use])), shape=shape).tocsr()
    seen.data[:] = 1.0
    return np.asarray((seen @ seen.T).todense())


def divide(shared: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Labels (n,) of placements, all 0 where one explains everything, -1 for images that belong to none.

    The leading eigenvector of (features shared) less (half of what views of like direction share) divides the images;
    each part is then asked again.

    Args:
        shared: (n, n) of `shared_features`.
        direction: (n, 3) unit, from the object to each camera.
    """
    n = len(shared)
    label = np.zeros(n, int)
    parts = [np.arange(n)]
    done: list[np.ndarray] = []
    while parts:
        part = parts.pop()
        halves = _halves(shared[np.ix_(part, part)], direction[part])
        if halves is None:
            done.append(part)
        else:
            parts += [part[halves], part[~halves]]
    if len(done) == 1:
        return label
    for k, part in enumerate(sorted(done, key=lambda p: (-len(p), int(p[0])))):
        label[part] = k
    return _linked(_settled(label, shared), shared)


def _settled(label: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Each image with the placement that it shares most features with; -1 where it shares none with any."""
    shared_with_others = shared * ~np.eye(len(shared), dtype=bool)
    for _ in range(5):
        total = np.stack([shared_with_others[:, label == k].sum(1) for k in range(label.max() + 1)], axis=1)
        new = np.where(total.max(1) < LEAST_SHARED, -1, np.argmax(total, axis=1))
        if np.array_equal(new, label):
            break
        label = new
    return label


def _linked(label: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Labels (n,), -1 for images that hang together with each other only, and not with most of their placement: nothing
    but chance has put them there."""
    from scipy.sparse.csgraph import connected_components

    out = np.full(len(label), -1)
    for k in range(int(label.max(initial=-1)) + 1):
        part = np.flatnonzero(label == k)
        group = connected_components(shared[np.ix_(part, part)] >= LEAST_SHARED, directed=False)[1]
        core = group == np.bincount(group).argmax()
        for _ in range(len(part)):
            more = ~core & (shared[np.ix_(part, part[core])].sum(1) >= LEAST_SHARED)
            if not more.any():
                break
            core |= more
        out[part[core]] = k
    return out


def fill_undecided(label: np.ndarray, timestamp_ns: np.ndarray | None = None) -> np.ndarray:
    """Labels (n,) in the order of capture, with undecided images (-1) given the placement of their neighbours.

    An object is set down anew a few times, not between any two images: where the `NEIGHBOURS` decided images before and
    those after all show one placement, so does the image between them. Where the decided images of every placement follow
    each other, so do all of its images, and those between two placements are divided by the one long pause; those before the
    first and after the last decided one belong to these where no long pause parts them.

    Args:
        label: (n,) of `divide`.
        timestamp_ns: (n,) when each was taken, negative where nobody knows.
    """
    out = label.copy()
    decided = np.flatnonzero(label >= 0)
    runs = 1 + int(np.count_nonzero(np.diff(label[decided])))
    if len(decided) and runs == len(np.unique(label[decided])):
        for before, after in zip(decided[:-1], decided[1:], strict=True):
            out[before:after] = label[before]
            if label[before] != label[after]:
                cut = _long_pause(timestamp_ns, int(before), int(after))
                out[before + 1 : after] = -1
                if cut is not None:
                    out[before:cut], out[cut : after + 1] = label[before], label[after]
        # nobody touches it before the first image or after the last without a pause
        first, last = int(decided[0]), int(decided[-1])
        if _long_pauses(timestamp_ns, 0, first) == []:
            out[:first] = label[first]
        if _long_pauses(timestamp_ns, last, len(label) - 1) == []:
            out[last:] = label[last]
        return out
    for i in np.flatnonzero(label < 0):
        place = int(np.searchsorted(decided, i))
        near = label[decided[max(0, place - NEIGHBOURS) : place + NEIGHBOURS]]
        if len(near) >= NEIGHBOURS and (near == near[0]).all():
            out[i] = near[0]
    return out


def timed(timestamp_ns: np.ndarray | None) -> TypeGuard[np.ndarray]:
    """Whether it is known when each image was taken; timestamp_ns: (n,), negative where nobody knows. A film begins at 0."""
    return timestamp_ns is not None and not (timestamp_ns < 0).any()


def without_return(label: np.ndarray, timestamp_ns: np.ndarray | None) -> np.ndarray:
    """Labels (n,), in the order of capture, in which placements are one where the images show one, another and the first again.

    Nobody lays an object back exactly as it had lain: what shares no features with the rest, or hides its support otherwise, is a plain
    side of it. Of a chair and a figure filmed once about (Blender) 11 and 10 of 40 images were taken for a placement of their own. Fewer than
    `NEIGHBOURS` images in a row tell nothing.

    Args:
        label: (n,) of `divide` or `divide_by_occlusion`, -1 where undecided.
        timestamp_ns: (n,) when each was taken, negative where nobody knows; then the order is not known, either.
    """
    if not timed(timestamp_ns):
        return label
    decided = label[label >= 0]
    starts = np.flatnonzero(np.diff(decided, prepend=-1))
    lengths = np.diff([*starts, len(decided)])
    runs = decided[starts[lengths >= NEIGHBOURS]]
    group = np.arange(label.max(initial=0) + 1)
    for first, number in enumerate(runs):
        last = int(np.flatnonzero(runs == number)[-1])
        between = np.isin(group, group[runs[first : last + 1]])
        group[between] = group[between].min()
    if len(np.unique(group[runs])) == len(np.unique(runs)):
        return label
    out = np.where(label >= 0, group[label], -1)
    out[out >= 0] = _largest_first(out[out >= 0])
    return out


def small_ones_filled(label: np.ndarray, timestamp_ns: np.ndarray | None, least: int) -> np.ndarray:
    """Labels (n,) in which placements of fewer than `least` images are undecided, and given to their neighbours as in `fill_undecided`.

    A few images of a plain side share hardly a feature with the rest, and are no placement: nobody turns an object over and back
    between them. Where the neighbours do not agree their label stays.
    """
    count = np.bincount(label[label >= 0], minlength=1)
    small = (label >= 0) & (count[label] < least)
    if not small.any() or not (count >= least).any():
        return label
    filled = fill_undecided(np.where(small, -1, label), timestamp_ns)
    out = np.where(small & (filled >= 0), filled, label)
    out[out >= 0] = np.unique(out[out >= 0], return_inverse=True)[1]
    return out


def agreed_between_pauses(label: np.ndarray, other: np.ndarray, timestamp_ns: np.ndarray | None) -> np.ndarray:
    """Labels `other` (n,), in the order of capture, but one label for images between two long pauses that had one before: what most have.

    Hands are at work in a pause, not between any two images. What each image hides of its support tells two placements of a
    cup that lay next to each other apart in 47 of 56 images only.

    Args:
        label: (n,) before, -1 where undecided.
        timestamp_ns: (n,) when each was taken, negative where nobody knows.
    """
    out, cuts = other.copy(), _after_pauses(timestamp_ns, len(label))
    for begin, end in pairwise([0, *cuts, len(label)] if cuts else []):
        if label[begin] >= 0 and (label[begin:end] == label[begin]).all():
            votes = np.bincount(1 + other[begin:end])[1:]
            out[begin:end] = np.argmax(votes) if votes.any() else label[begin]
    return out


def _long_pause(timestamp_ns: np.ndarray | None, before: int, after: int) -> int | None:
    """The first image after the one long pause among images `before` to `after`, or None where there is none."""
    long = _long_pauses(timestamp_ns, before, after)
    return long[0] + 1 if long is not None and len(long) == 1 else None


def _after_pauses(timestamp_ns: np.ndarray | None, n: int) -> list[int]:
    """The first of n images after each long pause; none where nobody knows."""
    return [i + 1 for i in _long_pauses(timestamp_ns, 0, n - 1) or []]


def _long_pauses(timestamp_ns: np.ndarray | None, before: int, after: int) -> list[int] | None:
    """Those of images `before` to `after` that a long pause follows; None where nobody knows."""
    if not timed(timestamp_ns):
        return None
    pause = np.diff(timestamp_ns).astype(float)
    usual = max(float(np.median(pause)), 1.0)
    return [i for i in range(before, after) if pause[i] > PAUSE * usual]


def divide_at_pauses(shared: np.ndarray, direction: np.ndarray, timestamp_ns: np.ndarray | None) -> np.ndarray:
    """Labels (n,) of placements, in the order of capture, of an object with too few features for `divide`; all 0 without a long pause.

    Hands were at work in a long pause or they were not. If not, images of like direction before and after it share as many
    features of the object as those on the side that shows fewer.

    Args:
        shared: (n, n) of `shared_features`; direction: (n, 3) unit, from the object to each camera.
        timestamp_ns: (n,) when each was taken, negative where nobody knows.
    """
    n = len(shared)
    _, like = _pairs_of_like_direction(direction)
    cuts = _after_pauses(timestamp_ns, n)
    label, first = np.zeros(n, int), 0
    for cut, end in pairwise([*cuts, n]):
        before, after = np.arange(first, cut), np.arange(cut, end)
        label[after] = label[cut - 1]
        mean_within = min(_mean_shared(shared, like, side, side) for side in (before, after))
        pairs = int(like[np.ix_(before, after)].sum())
        if (
            mean_within * pairs >= LEAST_SHARED * LEAST_PAIRS
            and _mean_shared(shared, like, before, after) < FEW * mean_within
        ):
            label[after] += 1
            first = cut
    return _largest_first(label)


def _largest_first(label: np.ndarray) -> np.ndarray:
    """Labels (n,) numbered by how many images they have, the most first, of as many the lower."""
    _, index, count = np.unique(label, return_inverse=True, return_counts=True)
    place = np.empty(len(count), int)
    place[np.argsort(-count, kind="stable")] = np.arange(len(count))
    return place[index]


def _pairs_of_like_direction(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle (n, n) between directions of view (n, 3) [deg], and (n, n) bool, two images from like directions."""
    angle = angles_deg(direction)
    return angle, (angle < LIKE_DEG) & ~np.eye(len(direction), dtype=bool)


def _mean_shared(shared: np.ndarray, like: np.ndarray, one: np.ndarray, other: np.ndarray) -> float:
    """Mean number of features that pairs of like direction, an image of `one` and one of `other`, share; 0 without a pair."""
    at = np.ix_(one, other)
    return float(shared[at][like[at]].mean()) if like[at].any() else 0.0


def _halves(shared: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
    """(n,) bool division of the images into two placements, or None where the evidence is missing."""
    n = len(shared)
    if n < 8:
        return None
    angle, like = _pairs_of_like_direction(direction)
    # of two placements half of the like pairs and more share nothing: what shares something is within one
    some = shared[like & (shared > 0)]
    usual = float(np.median(some)) if len(some) else 0.0
    if usual < 3:
        return None
    affinity = np.minimum(shared, usual) - np.where(like, 0.5 * usual, 0.0)
    np.fill_diagonal(affinity, 0.0)
    # where one placement shows many features and another few, the leading eigenvector sees the first alone: weighed equally
    # all images have their part in it
    weight = np.sqrt(np.abs(affinity).sum(1))
    equal = affinity / np.maximum(np.outer(weight, weight), 1e-12)
    divisions = (_sides(a, shared) for a in (affinity, equal))
    return next((side for side in divisions if _is_division(side, shared, angle, like)), None)


def _is_division(side: np.ndarray, shared: np.ndarray, angle: np.ndarray, like: np.ndarray) -> bool:
    """Whether sides (n,) bool are two placements, by what images of like direction share within and across.

    Args:
        shared: (n, n) features in common; angle: (n, n) between directions of view [deg]; like: (n, n) bool, pairs of like
            direction.
    """
    if min(side.sum(), (~side).sum()) < 4:
        return False
    across = side[:, None] != side[None]
    # two sides of one placement meet at their border only; two placements are seen from the same directions
    met = (like & across).any(1)
    met_side, met_other = met[side].mean(), met[~side].mean()
    if max(met_side, met_other) < MET:
        return False
    # a placement of a few images is seen from some of the directions of the other
    near = like if min(met_side, met_other) >= MET else like & (angle < NEXT_DEG)
    between, within = shared[near & across], shared[like & ~across]
    if len(between) < 2 * LEAST_PAIRS or len(within) < 2 * LEAST_PAIRS:
        return False
    return bool(np.median(between) < FEW * np.median(within))


def _sides(affinity: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """(n,) bool: the sign of the leading eigenvector of affinities (n, n), and where it is next to zero, the side with whose
    decided images an image shares more features (n, n), the surest first.

    The eigenvector keeps to where the directions of two placements meet; along the rest of a long ring its sign is noise.
    """
    leading = np.linalg.eigh(affinity)[1][:, -1]
    side = np.where(np.abs(leading) > LEAST_COMPONENT * np.abs(leading).max(), np.sign(leading), 0.0)
    while (side == 0).any():
        drawn = np.where(side == 0, shared @ side, 0.0)
        surest = int(np.argmax(np.abs(drawn)))
        if drawn[surest] == 0:
            break
        side[surest] = np.sign(drawn[surest])
    return np.asarray(side > 0)


def on_object(xyz: np.ndarray, centres: np.ndarray, centre: np.ndarray, radius: float, seed: int = 0) -> np.ndarray:
    """(m,) bool: sparse points that rise from the plane below what the cameras look at.

    Args:
        xyz: (m, 3); centres: (n, 3) of the cameras.
        centre, radius: of the region the cameras look at.
        seed: of the plane's draws.
    """
    near = np.linalg.norm(xyz - centre, axis=1) < 0.8 * radius
    plane = _plane(xyz[np.linalg.norm(xyz - centre, axis=1) < 1.3 * radius], centres, FLAT * radius, seed)
    if plane is None:
        out: np.ndarray = near & (np.linalg.norm(xyz - centre, axis=1) < 0.5 * radius)
    else:
        out = near & (xyz @ plane[:3] + plane[3] > 3 * FLAT * radius)
    return out


def _plane(xyz: np.ndarray, centres: np.ndarray, tolerance: float, seed: int) -> np.ndarray | None:
    """The plane (4,) with most points on it, the cameras above it and next to nothing below; None without one."""
    if len(xyz) < 30:
        return None
    rng = np.random.default_rng([seed, 22])
    best, most = None, 0.1 * len(xyz)
    for _ in range(2000):
        a, b, c = xyz[rng.choice(len(xyz), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-12:
            continue
        normal = normal / length
        normal = normal * np.sign(np.median((centres - a) @ normal))
        height = (xyz - a) @ normal
        count = np.count_nonzero(np.abs(height) < tolerance)
        if count > most and np.mean(height < -2 * tolerance) < 0.05 and np.mean((centres - a) @ normal > 0) > 0.9:
            best, most = np.append(normal, -normal @ a), count
    return best


def given_placements(footage: dict[str, Any], names: Sequence[str]) -> Placements | None:
    """The placements as the user's inputs are divided, the one with most images first; None of one input.

    Args:
        footage: `footage.json` of the capture stage.
        names: of the registered views.
    """
    of = {f["name"]: f["placement"] for f in footage["frames"] if "placement" in f}
    if not of:
        return None
    placement_of_view = np.array([of[name] for name in names], int)
    return Placements(_largest_first(placement_of_view), np.zeros(len(placement_of_view), int))


def find_placements(
    xyz: np.ndarray,
    obs_view: np.ndarray,
    obs_point: np.ndarray,
    centres: np.ndarray,
    region: Region,
    seed: int = 0,
    timestamp_ns: np.ndarray | None = None,
) -> Placements:
    """The placements of a still object among images that share a room.

    Args:
        xyz: (m, 3) sparse points; obs_view, obs_point: (k,) which view saw which.
        centres: (n, 3) of the cameras.
        region: that the cameras look at.
        seed: of the plane's draws.
        timestamp_ns: (n,) when each image was taken, negative where nobody knows.
    """
    on_it = on_object(xyz, centres, region.centre, region.radius, seed)
    shared = shared_features(len(centres), obs_view, obs_point, on_it)
    direction = centres - region.centre
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    handled = divide_at_pauses(shared, direction, timestamp_ns)
    if on_it.sum() < LEAST_POINTS:
        return Placements(handled, handled, known=False)
    label = without_return(divide(shared, direction), timestamp_ns)
    # a plain object shows each image so few that a division of its images among all others stays unseen
    return Placements(label if label.any() else handled, handled)
