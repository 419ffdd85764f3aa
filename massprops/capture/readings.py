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
from massprops.capture.pointed_at import chosen_points, piece_at
from massprops.capture.scene import Scene, seen_in
from massprops.capture.stand import HIGHEST, LOW, PARALLEL, Top, lowest_support, stand_top, turning_plate
from massprops.capture.support import (
    CAMERAS_ABOVE,
    LEAST_PIECE,
    MOST_BELOW,
    TOLERANCE,
    OnSupport,
    find_support,
    label_pieces,
    on_plane,
    split,
)
from massprops.geometry.projection import on_pixels

LIKE_WEIGHT, LIKE_SIZE = 0.3, 0.5
"""Another piece is of like size when it holds this share of the first one's weight about the middle of the views, and
this share of its extent. Neighbours on the cluttered bench tables hold 0.1 of it at most."""
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
        chosen = chosen_points(scene, piece, pointed)
        first = _as_split(scene, piece, chosen, plane)
    elif not first.member.any():
        return Found(first)
    if keep_support:
        return Found(first)
    top = stand_top(scene, first.member, plane, seed) if plane is not None else plate
    if top is not None and not pointed and _looked_below(scene, first, top):
        top = None
    moulding = top is not None and top.alike and top.narrow and not pointed
    if top is not None and not moulding:
        return _with_stand(scene, first, top, pointed)
    ledge = top is not None and moulding and top.height < LOW
    return Found(first, [] if pointed else _rivals(scene, first, piece, weight), ledge)


def _looked_below(scene: Scene, whole: OnSupport, top: Top) -> bool:
    """Whether the cameras look at what is below a level, deeper than what rises from it is high or half as wide: then that is no stand of it.

    The relief of a jug's lid (Blender), a twelfth of its height and of another blue in its shade, was taken for an object on a stand, while the
    cameras looked at a place nine times as deep below it, and 2.2 times half its width. Of a figure on a block they look at the middle of the figure.
    """
    rise = scene.xyz @ top.plane[:3] + top.plane[3]
    above = whole.member & (rise > 0)
    reach = max(np.percentile(rise[above], HIGHEST), 0.5 * _extent(scene.xyz[above], top.plane)[0])
    return bool(scene.region.centre @ top.plane[:3] + top.plane[3] < -reach)


def _bears(scene: Scene, plane: np.ndarray) -> bool:
    """Whether a plane (4,) may carry all that was measured: next to nothing lies below it, and the cameras above.

    A flat side that faces the cameras is the largest plane of images that show little of the table.
    """
    height = scene.xyz @ plane[:3] + plane[3]
    above = np.mean(scene.views.centres @ plane[:3] + plane[3] > 0)
    return bool(np.mean(height < -2 * TOLERANCE * scene.region.radius) < MOST_BELOW and above > CAMERAS_ABOVE)


def _as_split(scene: Scene, piece: np.ndarray, member: np.ndarray, plane: np.ndarray | None) -> OnSupport:
    """The chosen points as the object; the support and other large pieces as the surroundings."""
    count = np.bincount(piece[~member & (piece > 0)], minlength=piece.max() + 1)
    other = (count >= LEAST_PIECE)[piece] & ~member & (piece > 0)
    if plane is not None:
        other |= on_plane(scene.xyz, scene.normal, plane, TOLERANCE * scene.region.radius) & ~member
    return OnSupport(member, other, plane)


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


def _rivals(scene: Scene, found: OnSupport, piece: np.ndarray, weight: np.ndarray) -> list[Reading]:
    """The object and other pieces of like size and place; none where it is alone."""
    count_of_piece = np.bincount(piece[found.member & (piece > 0)], minlength=len(weight))
    if not count_of_piece.any():
        return []
    first = int(count_of_piece.argmax())
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
        uv, _ = seen_in(scene, i)
        member_pixels = uv[reading.member]
        shown.append(round(float(((member_pixels > 0) & (member_pixels < scene.views.size[i] - 1)).all(1).mean()), 2))
    return int(np.argmax(shown))


def picture(reading: Reading, scene: Scene, view: int, image: np.ndarray, width: int = 480) -> np.ndarray:
    """The image (h, w, 3) BGR, undistorted, with a reading's points laid over in green, `width` pixels wide."""
    import cv2

    uv, _ = seen_in(scene, view)
    factor = width / image.shape[1]
    out: np.ndarray = cv2.resize(image, (width, max(1, round(image.shape[0] * factor))), interpolation=cv2.INTER_AREA)
    mask = np.zeros((out.shape[0], out.shape[1]), np.uint8)
    _, rows, columns = on_pixels(factor * uv[reading.member], mask.shape)
    mask[rows, columns] = 1
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    out[mask > 0] = (0.55 * out[mask > 0] + 0.45 * np.array((96, 220, 110))).astype(np.uint8)
    return out
