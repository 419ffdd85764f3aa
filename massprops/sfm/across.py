"""Two placements of one body laid onto each other by features that both saw.

An object turned over is seen from above both times, so that the two see what they have in common from directions 60 to
100 degrees apart, across which features do not match. The shapes know how: the images of both placements are drawn as one
camera between them would have taken them, on each placement's own first shape, and features are found there (viewpoint
invariant patches: Wu and others 2008). Where shape or paint say roughly how the second lies on the first, a feature of the
one has one place to be looked for in the other.

What is left is an adjustment of six numbers and the points' places: turn and shift of the second placement, with the poses
within each placement held, which the room gives (Triggs and others 2000, "Bundle adjustment", section 6). Features are
carried back to where they were in the photographs, so that errors of the first shapes do not enter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.dynamics.quaternion import nearest_rotation
from massprops.geometry import vectors
from massprops.geometry.rasterise import rasterise
from massprops.sfm.distinct import APART, RATIO, WIDEST, angles, unit
from massprops.sfm.features import FeatureOptions, extract
from massprops.surface.refine import smoothed_face_normals
from massprops.views import Views

FIRST_GATE_PX = 20.0
"""How far from its predicted place a feature is looked for at first: shapes laid onto each other by silhouettes and paint
are some degrees off, and first shapes some pixels wrong."""
TRIALS, MOST_MATCHES = 500, 2000
"""Triples of matches tried, with a sixth of them right one in 200 is; and matches drawn from all."""
AGREES_PX = 4.0
"""Places of matching features agree on a turn and shift within this: both shapes are some pixels wrong."""
AGREEING, ENOUGH_AGREE = 0.1, 0.3
"""Share of the matches that must agree, and from which on no further turn is tried: of a tin 0.89 at the right turn, 0.65 and 0.4 at 20 and 40 degrees from it, at most
0.05 at eight wrong ones."""
GATES_PX = (6.0, 4.0, 2.5)
"""How far from its predicted place a feature is looked for in the rounds of the adjustment."""
FAR = 1000.0
"""Distance of the camera that both are drawn for, and its focal length [px]."""
DRAWN, EVERY = 40, 2
"""Directions over the sphere from which both are drawn, and which of them where nothing is known yet."""
WIDEST_PX = 500.0
"""Size of the object in drawn images, at most."""
MOST = 300
"""Features of each drawn image, the largest first."""
OBLIQUE_DEG = 60.0
"""Angle up to which a photograph is drawn as from another direction."""
VIEWS = 2
"""Photographs of each placement that are drawn from each direction."""
FACING = 0.25
"""Cosine between surface and line of sight below which a photograph says nothing."""
ROOM_PX = 12
"""Margin of a drawn image."""
DEEPER_PX = 3.0
"""A surface this much behind what a photograph shows is hidden there."""
LEAST_TRACKS = 15
"""Points seen in both placements without which six numbers are not taken from them."""
ELSEWHERE_PX = 25.0
"""By how much predicted places are shifted to see how many features match by chance."""
OVER_CHANCE = 3.0
"""How many times as many must match in the right place."""
LEAST_COMPARED = 100
"""Matches, and matches within one placement, from which on their shares tell whether both saw the same surface."""
BORNE_OUT = 0.33
"""Part of the agreeing share to be expected below which features speak against a turn. A padlock of layered plates, laid the
wrong way round, has the same stripes (correlation of the paint .45) and 0.13 of its matches agreeing, where 0.77 were to be
expected; of a printed tin laid rightly 0.89 agree."""
SAME_SURFACE = 0.5
"""Agreeing matches, over those between the photographs of one placement, from which on both placements show the same side of a
body that has others alike. One is expected. Of a screwdriver with the same plate and hole on both sides of its handle, laid
half a turn wrong, 0.2 agreed, within 0.3 px; they differed by what is printed on the plates.
"""
LEAST_SCALE = 0.3
"""Least scale of the robust loss [px]."""
OUTLYING = 4.0
"""A track with a residual beyond this many robust standard deviations is wrong."""
INFLATION = 3.0
"""As for attitudes (`massprops.sfm.refine`): features that follow the light are wrong together."""


@dataclass(frozen=True)
class Side:
    """One placement.

    Attributes:
        views: n cameras of undistorted images; images: n (h, w) uint8; masks: n silhouettes (h, w) uint8.
        vertices: (v, 3); faces: (f, 3): its first shape.
        normals: (f, 3) of its faces; depths: n depth buffers (h, w) of it.
    """

    views: Views
    images: list[np.ndarray]
    masks: list[np.ndarray]
    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    depths: list[np.ndarray]

    def take(self, index: np.ndarray) -> Side:
        """The same by some of its photographs."""
        images, masks, depths = ([a[i] for i in index] for a in (self.images, self.masks, self.depths))
        return replace(self, views=self.views.take(index), images=images, masks=masks, depths=depths)

    def beside(self, other: Side, R: np.ndarray, t: np.ndarray) -> Side:
        """The same on a shape that has another placement's besides its own, which R x + t carries here."""
        vertices = np.concatenate([self.vertices, other.vertices @ R.T + t])
        faces = np.concatenate([self.faces, other.faces + len(self.vertices)])
        return side_of(self.views, self.images, self.masks, vertices, faces)

    @property
    def middle(self) -> np.ndarray:
        """(3,) of its shape."""
        return np.asarray(0.5 * (self.vertices.min(0) + self.vertices.max(0)))

    @property
    def directions(self) -> np.ndarray:
        """(n, 3) unit, from the object to each camera."""
        return vectors.unit(self.views.centres - self.middle)

    @property
    def pixel(self) -> float:
        """Size of a pixel at the object in the median view."""
        return float(np.median(np.linalg.norm(self.views.centres - self.middle, axis=1) / self.views.K[:, 0, 0]))


@dataclass(frozen=True)
class Laid:
    """How the second placement lies in the frame of the first: x there is R x + t of the second's.

    Attributes:
        R, t: (3, 3) and (3,).
        covariance: (6, 6) of a small turn [rad] about `about` (3,) and a shift.
        tracks: points seen in both; matches: across the two in the last round; chance: how many there would be by chance.
        rms_px: of the points' residuals.
    """

    R: np.ndarray
    t: np.ndarray
    covariance: np.ndarray
    about: np.ndarray
    tracks: int
    rms_px: float
    matches: int = 0
    chance: float = np.nan

    @property
    def over_chance(self) -> float:
        """Matches that are not there by chance."""
        return self.matches - self.chance


@dataclass(frozen=True)
class _Drawn:
    """Features of one photograph drawn from another direction.

    Attributes:
        view: the photograph; at: (k, 2) in the drawn image [px]; uv: (k, 2) in the photograph [px].
        units: (k, 128) descriptors.
    """

    view: int
    at: np.ndarray
    uv: np.ndarray
    xyz: np.ndarray
    units: np.ndarray


def side_of(
    views: Views, images: list[np.ndarray], masks: list[np.ndarray], vertices: np.ndarray, faces: np.ndarray
) -> Side:
    """A placement as its features are found.

    Args:
        views: n cameras; images, masks: n photographs and silhouettes (h, w) uint8, undistorted.
        vertices, faces: a first shape.
    """
    flat = replace(views, distortion=np.zeros_like(views.distortion))
    depths = [
        rasterise(vertices, faces, views.K[i], views.R[i], views.t[i], (m.shape[1], m.shape[0]))[0]
        for i, m in enumerate(masks)
    ]
    return Side(flat, images, masks, vertices, faces, smoothed_face_normals(vertices, faces), depths)


def lay(
    first: Side, second: Side, starts: Sequence[tuple[np.ndarray, np.ndarray]], anywhere: bool = True
) -> Laid | None:
    """The second placement laid onto the first by features; None where too few match.

    Args:
        starts: (R, t) of where it may lie roughly, x of the second placement is R x + t of the first.
        anywhere: where no features agree there, they are looked for in turns all over the sphere.
    """
    both = _Both(first, second)
    agreements = [agreed for R, t in starts if (agreed := both.agreed(R, t)) is not None]
    best = max(agreements, key=lambda a: a.count, default=None)
    if best is None and anywhere:
        best = both.anywhere()
    if best is None:
        return None
    R, t = best.R, best.t
    laid = None
    for gate in GATES_PX:
        tracks = _tracks(both.drawn(R, t), len(first.views), gate)
        laid = None if tracks is None else _adjusted(first, second, R, t, tracks)
        if laid is None:
            return None
        R, t = laid.R, laid.t
    drawn = both.drawn(R, t)
    matches = _count(drawn, GATES_PX[-1], np.zeros(2))
    around = ELSEWHERE_PX * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    chance = float(np.mean([_count(drawn, GATES_PX[-1], shift) for shift in around]))
    if laid is None or matches < OVER_CHANCE * chance:
        return None
    return replace(laid, matches=matches, chance=chance)


def contradicted(first: Side, second: Side, R: np.ndarray, t: np.ndarray, overlap: float) -> bool:
    """Whether the features that both placements would have in common speak against how the second is laid, x by R x + t.

    Where a turn has both see the same surface, its features must match as well as they do between every other photograph
    of one placement. A body whose sides look alike passes for itself turned round by its outline and by its paint.

    Args:
        overlap: share of the measured points of either that the other's photographs would show.
    """
    ratios = _borne_out(first, second, R, t)
    return ratios is not None and ratios[0] < BORNE_OUT * overlap


def same_surface(first: Side, second: Side, R: np.ndarray, t: np.ndarray) -> bool | None:
    """Whether as many features agree on how the second placement is laid, x by R x + t, as if both showed the same side; None of too
    few."""
    ratios = _borne_out(first, second, R, t)
    return None if ratios is None else ratios[1] > SAME_SURFACE


def _borne_out(first: Side, second: Side, R: np.ndarray, t: np.ndarray) -> tuple[float, float] | None:
    """Share and number of the matches between two placements that agree, each over that between every other photograph of
    the first; None of too few.
    """
    matches = _Both(first, second).matches(R, t)
    matches_within = _Both(*(first.take(np.arange(k, len(first.views), 2)) for k in (0, 1))).matches(
        np.eye(3), np.zeros(3)
    )
    if min(len(matches[0]), len(matches_within[0])) < LEAST_COMPARED:
        return None
    near = AGREES_PX * first.pixel
    agree, usual = (_consensus(*m, near, np.random.default_rng(51))[0] for m in (matches, matches_within))
    if not usual.any():
        return None
    return float(agree.mean() / usual.mean()), float(agree.sum() / usual.sum())


class _Agreed(NamedTuple):
    """How many matches agree on a turn and shift, what share of all that is, and R (3, 3), t (3,)."""

    count: int
    share: float
    R: np.ndarray
    t: np.ndarray


def _consensus(
    x: np.ndarray, y: np.ndarray, near: float, rng: np.random.Generator, least: float = 3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which of the matches x, y (k, 3) agree on a turn and a shift to within `near`, (k,) bool, and these (RANSAC).

    None does where fewer than `least` agree.
    """
    best, Q, u = np.zeros(len(x), bool), np.eye(3), np.zeros(3)
    for _ in range(TRIALS):
        three = rng.choice(len(x), 3, replace=False)
        Q, u = _rigid(x[three], y[three])
        agree = np.linalg.norm(y @ Q.T + u - x, axis=1) < near
        best = agree if agree.sum() > best.sum() else best
    for _ in range(4):
        if best.sum() < least:
            return np.zeros(len(x), bool), Q, u
        Q, u = _rigid(x[best], y[best])
        best = np.linalg.norm(y @ Q.T + u - x, axis=1) < near
    return best, Q, u


class _Both:
    """Two placements, drawn from common directions; what is drawn of the first is kept."""

    def __init__(self, first: Side, second: Side) -> None:
        self.first, self.second, self.camera = first, second, _Camera.of(first)
        self.of_first: dict[int, list[_Drawn]] = {}

    def drawn(self, R: np.ndarray, t: np.ndarray, coarse: bool = False) -> list[tuple[list[_Drawn], list[_Drawn]]]:
        """Features of both from directions from which both can be drawn, the second laid by R, t."""
        out = []
        for k, toward in enumerate(vectors.sphere(DRAWN)):
            if coarse and k % EVERY:
                continue
            one, other = _nearest(self.first.directions, toward), _nearest(self.second.directions, R.T @ toward)
            if len(one) and len(other):
                turn, shift = self.camera.toward(toward)
                if k not in self.of_first:
                    self.of_first[k] = _drawn(self.first, self.camera, one, turn, shift)
                there = _drawn(self.second, self.camera, other, turn @ R, turn @ t + shift)
                out.append((self.of_first[k], there))
        return out

    def anywhere(self) -> _Agreed | None:
        """The turn on which most matches agree, of some of which one is within 45 degrees of any (the icosahedron's)."""
        from scipy.spatial.transform import Rotation

        best = None
        for R in Rotation.create_group("I").as_matrix():
            agreed = self.agreed(R, self.first.middle - R @ self.second.middle, coarse=True)
            if agreed is not None and (best is None or agreed.count > best.count):
                best = agreed
                if agreed.share > ENOUGH_AGREE:
                    break
        return best

    def agreed(self, R: np.ndarray, t: np.ndarray, coarse: bool = False) -> _Agreed | None:
        """How many matches of places on the two shapes agree on a turn and a shift near these, and which (RANSAC).

        None of too few, or of no larger a share than agree by chance.
        """
        x, y = self.matches(R, t, coarse)
        if len(x) < LEAST_TRACKS:
            return None
        rng = np.random.default_rng(51)
        few = np.sort(rng.permutation(len(x))[:MOST_MATCHES])
        least = max(LEAST_TRACKS, AGREEING * len(few))
        best, Q, u = _consensus(x[few], y[few], AGREES_PX * self.camera.pixel, rng, least)
        if not best.any():
            return None
        return _Agreed(int(best.sum() * len(x) / len(few)), float(best.mean()), Q, u)

    def matches(self, R: np.ndarray, t: np.ndarray, coarse: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Places (k, 3) on either shape, each in its own frame, of features that match near where R, t lays them."""
        pairs = [
            (a.xyz[m[:, 0]], b.xyz[m[:, 1]])
            for one, other in self.drawn(R, t, coarse)
            for a in one
            for b in other
            for m in [_matched(a, b, FIRST_GATE_PX)]
        ]
        x, y = (np.concatenate([np.zeros((0, 3)), *(p[k] for p in pairs)]) for k in (0, 1))
        return x, y


def _rigid(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The turn and shift that carry places y (k, 3) onto x (k, 3) best (Kabsch 1976)."""
    a, b = x.mean(0), y.mean(0)
    Q = nearest_rotation((x - a).T @ (y - b))
    return Q, a - Q @ b


@dataclass(frozen=True)
class _Camera:
    """A far camera that draws both placements at the size of the photographs' pixels.

    Attributes:
        middle: (3,) place in the first placement's frame that it looks at.
        away: its distance; pixel: size of a pixel at the object [world units].
        n: width and height [px].
    """

    middle: np.ndarray
    away: float
    pixel: float
    n: int

    @staticmethod
    def of(first: Side) -> _Camera:
        """One that sees all of an object."""
        whole = float(np.linalg.norm(np.ptp(first.vertices, axis=0)))
        pixel = max(first.pixel, whole / WIDEST_PX)
        half = 0.5 * whole / pixel
        return _Camera(first.middle, FAR * pixel, pixel, 2 * int(half + ROOM_PX) + 1)

    @property
    def K(self) -> np.ndarray:
        """(3, 3) [px]."""
        return np.array([[FAR, 0, self.n // 2], [0, FAR, self.n // 2], [0, 0, 1]])

    def toward(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World to camera, (3, 3) and (3,), from a direction (3,) off the middle."""
        z = -direction
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        turn = np.stack([x, np.cross(z, x), z])
        return turn, np.array([0, 0, self.away]) - turn @ self.middle


def _nearest(directions: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """The views that see an object from next to a direction (3,)."""
    cosine = directions @ toward
    order = np.argsort(-cosine, kind="stable")[:VIEWS]
    return np.asarray(order[cosine[order] > np.cos(np.deg2rad(OBLIQUE_DEG))])


def _drawn(side: Side, camera: _Camera, chosen: np.ndarray, turn: np.ndarray, shift: np.ndarray) -> list[_Drawn]:
    """Photographs as another camera would take them, and their features.

    Args:
        chosen: numbers of photographs.
        turn, shift: (3, 3) and (3,) from the side's frame to the camera.
    """
    import cv2

    n, pixel = camera.n, camera.pixel
    depth, face = rasterise(side.vertices, side.faces, camera.K, turn, shift, (n, n))
    solid = np.flatnonzero(face.ravel() >= 0)
    v, u = np.divmod(solid, n)
    ray = np.column_stack([u, v, np.ones(len(u))]) @ np.linalg.inv(camera.K).T
    xyz = (ray * depth.ravel()[solid, None] - shift) @ turn
    normal = side.normals[face.ravel()[solid]]
    on_shape = np.full((n * n, 3), np.nan, np.float32)
    on_shape[solid] = xyz
    out = []
    for i in chosen.tolist():
        view = side.views
        c = xyz @ view.R[i].T + view.t[i]
        uv = c[:, :2] / c[:, 2:] @ view.K[i][:2, :2].T + view.K[i][:2, 2]
        to_camera = view.centres[i] - xyz
        facing = np.einsum("mi,mi->m", normal, to_camera) / np.linalg.norm(to_camera, axis=1)
        place = np.full((n * n, 2), -1e6, np.float32)
        place[solid] = uv
        place = place.reshape(n, n, 2)
        shown = cv2.remap(side.depths[i].astype(np.float32), place, None, cv2.INTER_NEAREST, borderValue=0)
        inside = cv2.remap(side.masks[i], place, None, cv2.INTER_NEAREST, borderValue=0) > 0
        region = np.zeros(n * n, bool)
        region[solid] = (facing > FACING) & (c[:, 2] < shown.ravel()[solid] + DEEPER_PX * pixel)
        image = cv2.remap(side.images[i], place, None, cv2.INTER_LINEAR, borderValue=0)
        xy, data = extract(image, region.reshape(n, n) & inside, FeatureOptions(MOST))
        if not len(xy):
            continue
        at = xy[:, :2].astype(np.float32) - np.float32(0.5)
        uv = cv2.remap(place, at[:, None], None, cv2.INTER_LINEAR, borderValue=-1e6).reshape(-1, 2)
        where = cv2.remap(on_shape.reshape(n, n, 3), at[:, None], None, cv2.INTER_NEAREST, borderValue=(np.nan,) * 3)
        where = where.reshape(-1, 3).astype(float)
        known = (uv > 0).all(1) & np.isfinite(where).all(1)
        out.append(_Drawn(i, at[known].astype(float), uv[known].astype(float), where[known], unit(data[known])))
    return out


def _count(drawn: list[tuple[list[_Drawn], list[_Drawn]]], gate: float, shift: np.ndarray) -> int:
    """Matches across the two placements when the second's features are looked for at shifted places."""
    return sum(len(_matched(a, b, gate, shift)) for one, other in drawn for a in one for b in other)


def _matched(a: _Drawn, b: _Drawn, gate: float, shift: np.ndarray | None = None) -> np.ndarray:
    """(m, 2) features of two drawn images that are each other's likest within the gate [px]."""
    at = b.at if shift is None else b.at + shift
    if not len(a.at) or not len(at):
        return np.zeros((0, 2), int)
    within = _distances(a.at, at) < gate
    cosine = np.where(within, a.units @ b.units.T, 0.0)
    there, back = _likest(cosine, at), _likest(cosine.T, a.at)
    rows = np.flatnonzero(there >= 0)
    rows = rows[back[there[rows]] == rows]
    return np.column_stack([rows, there[rows]])


def _distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k, l) between places (k, 2) and (l, 2)."""
    x, y = (a[:, None, i] - b[None, :, i] for i in (0, 1))
    return np.asarray(np.sqrt(x * x + y * y))


def _likest(cosine: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(k,) the one feature that is like each, by the cosine (k, l) between descriptors, else -1; at (l, 2): their places."""
    best = cosine.argmax(1)
    angle = angles(cosine.max(1))
    apart = _distances(at[best], at) > APART
    second = angles(np.where(apart, cosine, 0.0).max(1))
    return np.where((angle < WIDEST) & (angle < RATIO * second), best, -1)


@dataclass(frozen=True)
class _Tracks:
    """Observations of points seen in both placements: view, place uv and point of each; count of the points."""

    view: np.ndarray
    uv: np.ndarray
    point: np.ndarray
    count: int

    def keep(self, good: np.ndarray) -> _Tracks:
        """The points where good (count,) is true."""
        use = good[self.point]
        number = np.cumsum(good) - 1
        return _Tracks(self.view[use], self.uv[use], number[self.point[use]], int(good.sum()))


def _tracks(drawn: list[tuple[list[_Drawn], list[_Drawn]]], n: int, gate: float) -> _Tracks | None:
    """Tracks across the placements; None where they are too few. The second's views are numbered from n on."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    view, uv, links, before = [], [], [np.zeros((0, 2), int)], 0
    for one, other in drawn:
        group, start = [*one, *other], []
        for k, d in enumerate(group):
            start.append(before)
            view.append(np.full(len(d.at), d.view + (n if k >= len(one) else 0)))
            uv.append(d.uv)
            before += len(d.at)
        for a in range(len(group)):
            for b in range(a + 1, len(group)):
                links.append(_matched(group[a], group[b], gate) + [start[a], start[b]])
    if not before:
        return None
    pair = np.concatenate(links)
    graph = coo_matrix((np.ones(len(pair)), pair.T), shape=(before, before))
    point = connected_components(graph, directed=False)[1]
    where, size = np.concatenate(view), int(point.max()) + 1
    sides = [np.bincount(point[in_placement], minlength=size) for in_placement in (where < n, where >= n)]
    # a track with two features of one image is two
    code, count = np.unique(point.astype(np.int64) * (where.max() + 1) + where, return_counts=True)
    single = np.bincount(code // (where.max() + 1), count > 1, size) == 0
    good = (sides[0] > 0) & (sides[1] > 0) & single
    tracks = _Tracks(where, np.concatenate(uv), point, size).keep(good)
    return tracks if tracks.count >= LEAST_TRACKS else None


def _adjusted(first: Side, second: Side, R: np.ndarray, t: np.ndarray, tracks: _Tracks) -> Laid | None:
    """Turn, shift and points fitted to the tracks, wrong ones taken out; None where too few are left."""
    about = R @ second.middle + t
    for _ in range(4):
        problem = _Problem(first, second, about, tracks)
        R, t, residual, covariance = problem.solved(R, t)
        size = np.linalg.norm(residual, axis=1)
        sigma = max(mad_sigma(residual), LEAST_SCALE)
        worst = np.zeros(tracks.count)
        np.maximum.at(worst, tracks.point, size)
        good = worst < OUTLYING * sigma
        if good.sum() < LEAST_TRACKS:
            return None
        if good.all():
            break
        tracks = tracks.keep(good)
    rms = float(np.sqrt(np.mean(residual**2)))
    return Laid(R, t, INFLATION**2 * covariance, about, tracks.count, rms)


class _Problem:
    """Six numbers and the points, fitted to the tracks; x is a point in the frame of the first placement."""

    def __init__(self, first: Side, second: Side, about: np.ndarray, tracks: _Tracks) -> None:
        n = len(first.views)
        self.n, self.about, self.tracks = n, about, tracks
        joined = Views.joined([first.views, second.views])
        self.K, self.R, self.t = (getattr(joined, k)[tracks.view] for k in ("K", "R", "t"))
        self.of_second = tracks.view >= n

    def poses(self, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World to camera of each observation, (k, 3, 3) and (k, 3), the world being the first placement's."""
        turned = np.where(self.of_second[:, None, None], self.R @ R.T, self.R)
        return turned, np.where(self.of_second[:, None], self.t - np.einsum("kij,j->ki", turned, t), self.t)

    def triangulated(self, R: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(m, 3) places nearest to the rays of each point."""
        turned, shift = self.poses(R, t)
        uv = np.column_stack([self.tracks.uv, np.ones(len(self.tracks.uv))])
        ray = np.einsum("kji,kj->ki", turned, np.einsum("kij,kj->ki", np.linalg.inv(self.K), uv))
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        centre = -np.einsum("kji,kj->ki", turned, shift)
        across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
        normal = _sums(across, self.tracks.point, self.tracks.count)
        right = _sums(np.einsum("kij,kj->ki", across, centre - self.about), self.tracks.point, self.tracks.count)
        # two rays that are next to parallel meet near the object
        normal += 1e-6 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        return self.about + np.linalg.solve(normal, right[..., None])[..., 0]

    def residual(
        self, R: np.ndarray, t: np.ndarray, x: np.ndarray, slopes: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(k, 2) residuals [px], their derivatives (k, 2, 3) by the points and (k, 2, 6) by turn and shift."""
        turned, shift = self.poses(R, t)
        at = x[self.tracks.point]
        c = np.einsum("kij,kj->ki", turned, at) + shift
        z = np.where(c[:, 2] > 1e-9, c[:, 2], 1e-9)
        uv = np.einsum("kij,kj->ki", self.K[:, :2], c / z[:, None])
        value = uv - self.tracks.uv
        if not slopes:
            return value, np.zeros(0), np.zeros(0)
        inner = np.zeros((len(c), 2, 3))
        inner[:, 0, 0], inner[:, 1, 1] = self.K[:, 0, 0] / z, self.K[:, 1, 1] / z
        inner[:, :, 2] = -(uv - self.K[:, :2, 2]) / z[:, None]
        by_point = inner @ turned
        # the second placement turned and shifted is the point turned and shifted back
        cross = np.zeros((len(c), 3, 3))
        d = at - self.about
        cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = d[:, 2], -d[:, 1], d[:, 0]
        cross -= np.transpose(cross, (0, 2, 1))
        by_pose = -np.concatenate([by_point @ cross, by_point], axis=2)
        return value, by_point, np.where(self.of_second[:, None, None], by_pose, 0.0)

    def solved(self, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Turn, shift, residuals (k, 2) and the covariance (6, 6) of the first two (Gauss-Newton, Cauchy loss)."""
        from scipy.spatial.transform import Rotation

        x = self.triangulated(R, t)
        point, count = self.tracks.point, self.tracks.count
        reduced = np.eye(6)
        for _ in range(30):
            r, by_point, by_turn = self.residual(R, t, x, slopes=True)
            scale = max(mad_sigma(r), LEAST_SCALE)
            w = 1.0 / (1.0 + (np.linalg.norm(r, axis=1) / scale) ** 2)
            P = _sums(np.einsum("k,kai,kaj->kij", w, by_point, by_point), point, count)
            P += 1e-4 * np.trace(P, axis1=1, axis2=2)[:, None, None] * np.eye(3)
            C = _sums(np.einsum("k,kai,kaj->kij", w, by_point, by_turn), point, count)
            p = _sums(np.einsum("k,kai,ka->ki", w, by_point, r), point, count)
            solved = np.linalg.solve(P, np.concatenate([C, p[..., None]], axis=2))
            H = np.einsum("k,kai,kaj->ij", w, by_turn, by_turn) - np.einsum("mij,mik->jk", C, solved[:, :, :6])
            g = np.einsum("k,kai,ka->i", w, by_turn, r) - np.einsum("mij,mi->j", C, solved[:, :, 6])
            unit_ = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
            step = -unit_ * np.linalg.lstsq(H * unit_[:, None] * unit_, g * unit_, rcond=1e-10)[0]
            x = x - solved[:, :, 6] - solved[:, :, :6] @ step
            turn = Rotation.from_rotvec(step[:3]).as_matrix()
            R, t = turn @ R, turn @ (t - self.about) + self.about + step[3:]
            reduced = H
            if np.abs(step[:3]).max() < 1e-7:
                break
        r = self.residual(R, t, x)[0]
        free = max(2 * len(r) - 3 * count - 6, 1)
        variance = max(float((w[:, None] * r**2).sum()) / free, 1e-6)
        return R, t, r, variance * np.linalg.pinv(reduced)


def _sums(values: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, ...) of values (k, ...) over the members of each group."""
    flat = values.reshape(len(values), -1)
    out = np.stack([np.bincount(group, column, count) for column in flat.T], axis=1)
    return out.reshape(count, *values.shape[1:])
