"""Silhouettes drawn from a shape and refined by the image: shape first, silhouettes second.

The shape says where the object surely is and where other things surely are; between the two the image decides, by
colour and edges (Boykov and Jolly 2001; colours learned again from the answer as in Rother, Kolmogorov, Blake 2004).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.capture.colours import BINS, colour_cells, without_small_gaps
from massprops.core.robust import mad_sigma
from massprops.geometry.projection import on_pixels, pixels_of
from massprops.views import distort

BAND = 0.03
"""Band about the drawn outline that the image decides, in equivalent diameters of the silhouette. On two rendered
table-top scenes 6 px in 200 took the intersection over union from .967 to .983; wider bands took in neighbours."""
LEAST_BAND = 3
LEAST_DIFFERENCE = 12.0
"""Grey levels within which two colours are alike whatever the rest of the image says."""
NEAR_OTHER = 4
"""A pixel this near to one of the surroundings' measured points shows them [px]."""
UNKNOWN = 0.15
"""Distance from the shape, in equivalent diameters, within which an unmeasured pixel may be the object's."""
FAR = 0.6
"""The same for a pixel where the surroundings are known and do not show, or may not and the colour is the object's: of 15 photographs of
bananas the first shape lacked a side that reached .4 from it."""
WORK = 560
"""Longer side of the crop on which colours are separated [px]."""
ITS_OWN, FAINTEST = 0.95, 1e-5
"""Share of the object's points among all of a colour from which the colour is the object's alone, and least frequency of
the colour among its points."""
LEAST_PART = 0.02
"""A part that a silhouette may lack, of its area."""
OTHERS = 1.0
"""Logarithm of how much more often a colour occurs surely beside the object than within it, from which on a pixel within the shape
is not held there: stereo in the shade below an object and the closure of a first shape reach beyond it. Of nine rendered things the
overlap of silhouettes rose on a plain jug (.968 to .985) and a chair (worst .93 to .94), fell on a grey part by .001, and was the
same on the others; with 0 the jug had .987, with 2 .982."""
ROUNDS = 2
PRIOR, COLOUR, SMOOTH, HIDDEN = 1.0, 0.5, 3.0, 0.5
"""Weights of nearness to the drawn outline, of colour, of edges, and of surroundings that do not show."""


@dataclass(frozen=True)
class Trimap:
    """What the measured points say of each pixel before the image is asked.

    Attributes:
        drawn: (h, w) bool, the shape's silhouette, its gaps filled where the surroundings would show through and do not.
        surely: (h, w) bool, the object; not in such gaps.
        away: (h, w) bool, surely not.
        hidden: (h, w) bool, the surroundings lie there and do not show: something is before them.
        evidence: (h, w) float32, log odds of something before the support by its picture of all images; None where that
            tells nothing beside the shape.
        own_coloured: (h, w) bool of `shows_object_colours`; None where that is not known.
    """

    drawn: np.ndarray
    surely: np.ndarray
    away: np.ndarray
    hidden: np.ndarray
    evidence: np.ndarray | None = None
    own_coloured: np.ndarray | None = None


def trimap(
    depth: np.ndarray,
    uv: np.ndarray,
    z: np.ndarray,
    shows: np.ndarray,
    closed: bool = False,
    own_coloured: np.ndarray | None = None,
) -> Trimap:
    """Object, surroundings and what the image has to decide.

    Args:
        depth: (h, w) of the shape, infinite where it is not.
        uv: (m, 2) pixels and z (m,) depths of points that are not the object's, in front of the camera.
        shows: (m,) bool, the image has the point's colour there (`shows_points`).
        closed: the shape is the body's whole surface, made with all images; then nothing of it is farther off than the band,
            and its gaps are the body's.
        own_coloured: (h, w) bool of `shows_object_colours`, or None.
    """
    import cv2

    h, w = depth.shape
    drawn = np.isfinite(depth)
    size, band = equivalent_diameter(drawn), outline_band(drawn)
    there, i, j = on_pixels(uv, (h, w))
    z, shows = z[there], shows[there]
    before = z < depth[i, j]
    count = []
    for chosen in (before & shows, before & ~shows):
        dots = np.zeros((h, w), np.float32)
        np.add.at(dots, (i[chosen], j[chosen]), 1.0)
        count.append(cv2.boxFilter(dots, -1, (2 * NEAR_OTHER + 1,) * 2, normalize=False))
    # one point alone may be wrong
    other, hidden = (count[0] > 2.5) & (count[0] > count[1]), (count[1] > 2.5) & (count[1] > count[0])
    shape = drawn
    # what all images leave open in the whole body is open
    drawn = drawn if closed else _without_gaps(drawn, other, size)
    # a gap may be a plain wall behind the object, which has no points either: the image decides by its colours
    gap = cv2.dilate((drawn & ~shape).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    solid = drawn.astype(np.uint8)
    surely = (cv2.distanceTransform(solid, cv2.DIST_L2, 5) > band) & ~gap
    outside = cv2.distanceTransform(1 - solid, cv2.DIST_L2, 5) if drawn.any() else np.full((h, w), np.inf)
    enclosed = np.zeros_like(drawn) if closed else ~_reached(~drawn)
    perhaps = hidden if own_coloured is None else hidden | own_coloured
    reach = band if closed else np.where(perhaps, FAR * size, UNKNOWN * size)
    away = ((outside > reach) & ~enclosed) | (other & (outside > band))
    return Trimap(drawn, surely, away, hidden & ~away, own_coloured=own_coloured)


def shows_points(image: np.ndarray, uv: np.ndarray, bgr: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """(m,) bool: whether the image has the colour of each point where it projects.

    A point of the table behind a side of the object that was not measured projects onto the object: it does not show.

    Args:
        image: (h, w, 3) uint8.
        uv: (m, 2) pixels; bgr: (m, 3) colours as other images show them.
        apart: (h, w) bool, far from the object: there the exposure and the usual difference are learned.
    """
    import cv2

    h, w = image.shape[:2]
    smooth = cv2.GaussianBlur(image, (0, 0), 1.5).astype(np.float32)
    j, i = np.clip(np.rint(uv).astype(int), 0, [w - 1, h - 1]).T
    seen, wanted = smooth[i, j], bgr.astype(np.float32)
    calm = apart[i, j]
    if calm.sum() < 200:
        return np.ones(len(uv), bool)
    gain = np.clip(np.median(seen[calm], axis=0) / np.maximum(np.median(wanted[calm], axis=0), 1.0), 0.5, 2.0)
    off = np.abs(seen - gain * wanted).max(axis=1)
    # the surroundings themselves differ by gloss and by how sharply their texture is drawn
    return off < max(2.0 * float(np.percentile(off[calm], 80)), LEAST_DIFFERENCE)


def _without_gaps(drawn: np.ndarray, other: np.ndarray, size: float) -> np.ndarray:
    """The silhouette with the gaps filled in which the surroundings do not show, though they do all about it.

    Nothing can be measured on a glossy or plain side: a gap in the shape is no gap in the object.
    """
    import cv2

    solid = drawn.astype(np.uint8)
    ring = cv2.dilate(solid, np.ones((3, 3), np.uint8), iterations=max(3, round(0.2 * size))) > 0
    ring &= _reached(~drawn)
    if not ring.any() or other[ring].mean() < 0.5:
        return drawn
    count, piece = cv2.connectedComponents((~drawn & ~_reached(~drawn)).astype(np.uint8), connectivity=4)
    share = np.bincount(piece.ravel(), other.ravel(), count) / np.maximum(
        np.bincount(piece.ravel(), minlength=count), 1
    )
    gap = share < 0.5 * other[ring].mean()
    gap[0] = False
    return drawn | gap[piece]


def _reached(free: np.ndarray) -> np.ndarray:
    """(h, w) bool: what of `free` hangs together with the image's border."""
    import cv2

    _, piece = cv2.connectedComponents(np.pad(free, 1, constant_values=True).astype(np.uint8), connectivity=4)
    return (piece == piece[0, 0])[1:-1, 1:-1]


def far_from(depth: np.ndarray) -> np.ndarray:
    """(h, w) bool: farther from the shape's silhouette than anything of the object may reach."""
    import cv2

    drawn = np.isfinite(depth)
    if not drawn.any():
        return np.ones(depth.shape, bool)
    away = cv2.distanceTransform((~drawn).astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(away > 2 * UNKNOWN * equivalent_diameter(drawn))


def outline_band(drawn: np.ndarray) -> int:
    """Pixels about a drawn silhouette (h, w) bool that the image itself decides."""
    return max(LEAST_BAND, round(BAND * equivalent_diameter(drawn)))


def beyond_band(drawn: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels off a drawn silhouette and off the band about it."""
    import cv2

    return np.asarray(cv2.distanceTransform((~drawn).astype(np.uint8), cv2.DIST_L2, 5) > outline_band(drawn))


def equivalent_diameter(mask: np.ndarray) -> float:
    """Diameter of the disc of the area of a mask (h, w) bool [px]."""
    return float(np.sqrt(4.0 / np.pi * np.count_nonzero(mask)))


def refine(image: np.ndarray, known: Trimap) -> np.ndarray:
    """The silhouette (h, w) bool whose edges are the image's.

    Args:
        image: (h, w, 3) uint8, undistorted.
        known: of `trimap`.
    """
    import cv2

    drawn, surely, away = known.drawn, known.surely, known.away
    if not surely.any() or not away.any() or (surely | away).all():
        return drawn
    rows, columns = np.flatnonzero((~away).any(1)), np.flatnonzero((~away).any(0))
    pad = round(0.15 * max(np.ptp(rows), np.ptp(columns))) + 4
    top, left = max(rows[0] - pad, 0), max(columns[0] - pad, 0)
    part = (slice(top, rows[-1] + pad + 1), slice(left, columns[-1] + pad + 1))
    crop = image[part]
    factor = min(1.0, WORK / max(crop.shape[:2]))
    size = (max(8, round(crop.shape[1] * factor)), max(8, round(crop.shape[0] * factor)))
    small = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)

    def reduced(mask: np.ndarray) -> np.ndarray:
        return cv2.resize(mask[part].astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.5

    evidence = None if known.evidence is None else cv2.resize(known.evidence[part], size, interpolation=cv2.INTER_AREA)
    reduced_known = Trimap(reduced(drawn), reduced(surely), reduced(away), reduced(known.hidden), evidence)
    silhouette = _cut(small, reduced_known).astype(np.float32)
    out = np.zeros(drawn.shape, bool)
    back = (crop.shape[1], crop.shape[0])
    out[part] = cv2.resize(silhouette, back, interpolation=cv2.INTER_LINEAR) > 0.5
    return _held(out, surely)


def shows_object_colours(image: np.ndarray, painted: Paint, evidence: np.ndarray) -> np.ndarray:
    """(h, w) bool: what has colours that are more the object's than the surroundings', and the support's picture does not show there.

    Args:
        image: (h, w, 3) uint8; evidence: (h, w) log odds of something before the support, 0 where its picture does not tell.
    """
    import cv2

    object_like = (painted.share[colour_cells(image)] > 0.5) & (evidence >= 0.0)
    side = 2 * LEAST_BAND + 1
    # specks of noise have any colour
    return cv2.morphologyEx(object_like.astype(np.uint8), cv2.MORPH_OPEN, np.ones((side, side), np.uint8)) > 0


@dataclass(frozen=True)
class Paint:
    """share: (BINS**3,) of the object's among all measured points of a colour, object's and surroundings', 0 where none
    has it."""

    share: np.ndarray

    @staticmethod
    def learn(own: np.ndarray, other: np.ndarray) -> Paint:
        """From the colours (n, 3) and (m, 3) uint8 BGR of the object's points and of the surroundings', of all images."""
        from scipy.ndimage import gaussian_filter

        density = []
        for bgr in (own, other):
            cells = colour_cells(bgr[:, None]).ravel() if len(bgr) else np.zeros(0, int)
            count = np.bincount(cells, minlength=BINS**3).reshape((BINS,) * 3) / max(len(cells), 1)
            density.append(gaussian_filter(count, 1.0).ravel())
        seen = density[0] > FAINTEST
        return Paint(np.where(seen, density[0] / np.maximum(density[0] + density[1], 1e-30), 0.0))


def unsure(image: np.ndarray, found: np.ndarray, painted: Paint, away: np.ndarray) -> np.ndarray:
    """(h, w) bool: what has the object's colours and no others', hangs together with the silhouette, and is not in it.

    It may be a part of the object that no stereo has measured, such as a handle seen in one image only, or another thing of
    its colour: the image does not say which. No stereo measures a black cloth or a shadow, so what is surely not the object
    in the image says as well which colours are others'.

    Args:
        image: (h, w, 3) uint8, undistorted; found: (h, w) bool of `refine`.
        painted: of the object and its surroundings.
        away: (h, w) bool: surely not the object.
    """
    import cv2

    size = equivalent_diameter(found)
    side = max(3, round(2 * BAND * size) | 1)
    cells = colour_cells(image)
    # an unmeasured part may reach far, so that its colours are rarer away from the object, and not absent there
    here = Paint.learn(image[found], image[away]).share[cells] > 0.5
    alike = ((painted.share[cells] > ITS_OWN) & here & ~found).astype(np.uint8)
    # along the outline a fringe always has the object's colours
    alike = cv2.morphologyEx(alike, cv2.MORPH_OPEN, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    grown = cv2.dilate(alike, np.ones((side, side), np.uint8)) > 0
    count, piece, stats, _ = cv2.connectedComponentsWithStats((grown & ~found).astype(np.uint8), connectivity=8)
    near = cv2.dilate(found.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    touches = np.bincount(piece[near], minlength=count) > 0
    keep = touches & (stats[:, cv2.CC_STAT_AREA] > LEAST_PART * np.count_nonzero(found))
    keep[0] = False
    return np.asarray(keep[piece])


def _cut(image: np.ndarray, known: Trimap) -> np.ndarray:
    """Labels of least cost by colour, by edges and by nearness to the drawn outline; colours learned again in rounds."""
    import cv2
    import maxflow

    drawn, surely, away = known.drawn, known.surely, known.away
    solid = drawn.astype(np.uint8)
    signed = cv2.distanceTransform(solid, cv2.DIST_L2, 5) - cv2.distanceTransform(1 - solid, cv2.DIST_L2, 5)
    band = max(LEAST_BAND, BAND * equivalent_diameter(drawn))
    # a gap in the shape is no evidence of a gap in the object
    prior = np.where(drawn | _reached(~drawn), PRIOR * np.clip(signed / band, -1.0, 1.0), 0.0)
    prior[known.hidden & ~drawn] = HIDDEN
    cells = colour_cells(image)
    across, down = _edges(image)
    odds = _log_odds(cells, surely, away)
    surely = surely & (odds > -OTHERS)
    on_object = drawn
    for k in range(ROUNDS):
        if k:
            odds = _log_odds(cells, on_object, ~on_object)
        weight = prior + COLOUR * odds
        if known.evidence is not None:
            weight = weight + known.evidence
        weight[surely], weight[away] = 50.0, -50.0
        graph = maxflow.Graph[float]()
        nodes = graph.add_grid_nodes(drawn.shape)
        for pair, structure in ((across, [[0, 0, 0], [0, 0, 1], [0, 0, 0]]), (down, [[0, 0, 0], [0, 0, 0], [0, 1, 0]])):
            graph.add_grid_edges(nodes, pair, structure=np.array(structure), symmetric=True)
        graph.add_grid_tedges(nodes, np.maximum(weight, 0), np.maximum(-weight, 0))
        graph.maxflow()
        on_object = ~graph.get_grid_segments(nodes)
    return on_object


def _log_odds(cells: np.ndarray, own: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(h, w) logarithm of how much more often a pixel's colour occurs in the object than beside it, within +-3."""
    from scipy.ndimage import gaussian_filter

    density = []
    for mask in (own, other):
        count = np.bincount(cells[mask], minlength=BINS**3).reshape((BINS,) * 3).astype(np.float64)
        smooth = gaussian_filter(count, 0.8).ravel()
        density.append((smooth + 1e-2) / (smooth.sum() + 1e-2 * BINS**3))
    return np.clip(np.log(density[0] / density[1]), -3.0, 3.0)[cells]


def _edges(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cost of an outline between each pixel and its right and lower neighbour: low where the colours differ."""
    import cv2

    smooth = cv2.GaussianBlur(image, (0, 0), 0.7).astype(np.float32)
    out = []
    for axis in (1, 0):
        step = np.diff(smooth, axis=axis, append=np.take(smooth, [-1], axis=axis))
        square = (step**2).sum(axis=2)
        out.append(0.2 + SMOOTH * np.exp(-square / max(2.0 * float(square.mean()), 1.0)))
    return out[0], out[1]


def _held(found: np.ndarray, surely: np.ndarray) -> np.ndarray:
    """Pieces that hold sure pixels, specks and pinholes removed."""
    import cv2

    found = cv2.morphologyEx(found.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, piece, _, _ = cv2.connectedComponentsWithStats(found, connectivity=8)
    sure = np.bincount(piece[surely], minlength=count)
    keep = sure >= max(3, 0.02 * sure[1:].max(initial=0))
    keep[0] = False
    return without_small_gaps(keep[piece], 0.001)


def share_covered(
    mask: np.ndarray, margin_px: int, points: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray
) -> float | None:
    """Share of the points (n, 3) in an undistorted view that fall on a mask (h, w) bool or within a margin of it; None of no point."""
    import cv2

    side = 2 * margin_px + 1
    near = cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    there, rows, columns = pixels_of(points, K, R, t, mask.shape)
    return float(near[rows, columns].mean()) if len(there) else None


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of two masks (h, w) bool, 1 where both are empty."""
    union = np.count_nonzero(a | b)
    return 1.0 if union == 0 else float(np.count_nonzero(a & b) / union)


def agreement(solid: np.ndarray, known: Trimap) -> float:
    """How far a silhouette (h, w) bool found in an image agrees with the one that was drawn, in intersection over union.

    A shape may lack a part that the image shows, and is there all the same if all of it has the object's colours and no support shows: of
    a photographed stamp seven images gave a shape without its handle, which one of them shows. A body shifted by a small share of its
    size loses that share once there, and twice in intersection over union.
    """
    together = overlap(solid, known.drawn)
    if known.own_coloured is None or not known.drawn.any():
        return together
    return max(together, 2.0 * float(known.own_coloured[known.drawn].mean()) - 1.0)


def shows_support(known: Trimap) -> bool:
    """Whether nothing was drawn, or most of it has the support's picture, and not the object's colours: the image was placed where its
    object is not.

    Of an image of a shoe (Blender) that a tiled floor placed one tile off none had its colours, and 0.88 the floor's picture; of right
    ones of it, of six more rendered things, a stamp and bananas 0.40 and more, and at most 0.12.
    """
    drawn = known.drawn
    if not drawn.any():
        return True
    if known.evidence is None or known.own_coloured is None:
        return False
    return bool(known.own_coloured[drawn].mean() < 0.5 < (known.evidence[drawn] < 0).mean())


LEAST_AGREEMENT, BELOW = 0.87, 6.0
"""A view shows the object elsewhere when its image agrees with the drawn silhouette by less than this, and by less than
the median of all views by more than this many of their scatters. In footage with moved objects, good views agreed by
0.94 and more, bad ones by 0.87 and less."""


def moved(agreement: np.ndarray, bare: np.ndarray) -> np.ndarray:
    """(n,) bool: views whose own silhouette is not the shape's.

    Args:
        agreement: (n,) of `agreement`; bare: (n,) bool of `shows_support`, which says nothing of an object that looks like its support.
    """
    middle = float(np.median(agreement))
    scatter = max(mad_sigma(agreement - middle), 0.01)
    out = (agreement < LEAST_AGREEMENT) & (agreement < middle - BELOW * scatter)
    return out if bare.mean() > 0.5 else out | bare


def to_stored(found: np.ndarray, K: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """(h, w) uint8 of 0 and 255: a silhouette (h, w) bool of the undistorted view in the geometry of the stored frame, whose lens
    K (3, 3) and distortion (4,) are."""
    return np.where(distort(found.astype(np.float32), K, distortion) > 0.5, 255, 0).astype(np.uint8)
