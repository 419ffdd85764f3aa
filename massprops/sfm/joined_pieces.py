"""The models into which a film of a free body falls, joined by the motion that they have in common.

In the Earth's shadow, or where the body turns its plain side, some tens of degrees are missing, across which too few
features match. The free motion tells how the models lie to each other (`massprops.sfm.free_motion`), to a degree or two;
surface that both saw obliquely is then looked for where it should be (`massprops.sfm.oblique_patches`,
`massprops.sfm.feature_candidates`). A model is joined only where points set aside agree with where that puts it
(`massprops.sfm.consensus`).
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pycolmap
from scipy.spatial import cKDTree

from massprops.errors import InputError, NotPossible
from massprops.sfm.assembled import STAYS, Part, Sighting, Similarity, assemble
from massprops.sfm.attempt import FEWEST, ModelInputs
from massprops.sfm.consensus import AGREES_PX, LEAST_POINTS, Agreement, Candidates, Spread, agreement, is_significant
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.distinct import unit
from massprops.sfm.feature_candidates import feature_candidates
from massprops.sfm.features import read_mask
from massprops.sfm.footage import FootageRecord
from massprops.sfm.free_motion import Piece, fit_centres, fit_rotation
from massprops.sfm.oblique_patches import Grey, patch_candidates
from massprops.sfm.points import SparsePoints, projected
from massprops.sfm.refine import Effort, adjust, remove_outliers
from massprops.sfm.turned import turn_image
from massprops.views import Views

MOST_RMS_DEG = 1.0
"""Attitudes that are farther off a free motion than this are no free body's, or of models that are wrong: 0.03 and 0.17 where
they were right."""

TURN_DEG, TURN_SIGMAS = 0.5, 5.0
"""Least standard deviation of the turn that the motion predicts, and by how much its own is too small: attitudes of one model
are wrong together; turns of 0.2 to 2.9 degrees were off with stated 0.08 to 0.6."""

SIZE, SIZE_SIGMAS = 0.005, 3.0
"""The same of the size."""

SHIFT = 0.06
"""Standard deviation of the predicted place, in radii of the body."""

WRONG_TURNS, WRONG_DEG, WRONG_POINTS = 5, 25.0, 400
"""Wrong placements with which that of the motion is compared, by how much they are turned, and points by which they are tried:
more than the motion may be off, and little enough that as much of the surface is seen by both."""

REACH, NEAR = 0.12, 0.04
"""How far from its predicted place a point is looked for, in radii of the body as the images show it: before both are adjusted
together, and after."""


@dataclass(frozen=True)
class _Laid:
    """Views, their COLMAP numbers `ids`, the points that they saw, and the piece `owner` (n,) of each; a point belongs to one."""

    views: Views
    ids: tuple[int, ...]
    points: SparsePoints
    owner: np.ndarray

    def of_point(self) -> np.ndarray:
        """(m,) the piece of each point."""
        out = np.zeros(len(self.points.xyz), int)
        out[self.points.obs_point] = self.owner[self.points.obs_view]
        return out

    def at(self, to: Sequence[Similarity], pieces: Sequence[int]) -> _Laid:
        """The views of some pieces with what they saw, each piece where it goes."""
        index = np.flatnonzero(np.isin(self.owner, pieces))
        views, points, owner = self.views.take(index), self.points.of_views(index), self.owner[index]
        part = replace(self, views=views, points=points, owner=owner, ids=tuple(self.ids[i] for i in index.tolist()))
        R, t, xyz, of_point = views.R.copy(), views.t.copy(), points.xyz.copy(), part.of_point()
        for k in pieces:
            scale, C, shift = to[k]
            of_piece = owner == k
            R[of_piece] = views.R[of_piece] @ C.T
            t[of_piece] = scale * views.t[of_piece] - R[of_piece] @ shift
            xyz[of_point == k] = scale * points.xyz[of_point == k] @ C.T + shift
        return replace(part, views=replace(views, R=R, t=t), points=replace(points, xyz=xyz))


def join_pieces(
    model: pycolmap.Reconstruction, apart: Sequence[pycolmap.Reconstruction], given: ModelInputs
) -> pycolmap.Reconstruction:
    """The model with the images of those `apart` that the motion leads to and whose surface bears it out; itself where none
    is."""
    owners = _owners([model, *apart])
    if len(owners) < 2:
        return model
    ids = [piece_images for _, piece_images in owners]
    try:
        pieces = assemble([Part(m, piece_images, STAYS) for m, piece_images in owners])
        # at first as they are: with another focal length than its own a piece fits badly
        mapping = given.found.mapping
        adjust(pieces, not mapping.fixed_intrinsics, False, 1.0, mapping.threads, Effort(), mapping.constant)
        _adjust(pieces, given)
        joined = _joined(pieces, ids, given)
    except NotPossible:
        return model
    return model if joined is None else joined


def _owners(models: Sequence[pycolmap.Reconstruction]) -> list[tuple[pycolmap.Reconstruction, frozenset[int]]]:
    """Each model with the images that no earlier one has, where these are enough."""
    out: list[tuple[pycolmap.Reconstruction, frozenset[int]]] = []
    taken: set[int] = set()
    for m in models:
        new_images = frozenset(m.reg_image_ids()) - taken
        if len(new_images) >= FEWEST:
            out.append((m, new_images))
            taken |= new_images
    return out


def _adjust(model: pycolmap.Reconstruction, given: ModelInputs) -> None:
    """Adjusts all pieces, in place, with the one camera that took them.

    Raises:
        NotPossible: too little is left.
    """
    mapping = given.found.mapping
    for _ in range(2):
        loss = remove_outliers(model, given.options.refine, 2.0)
        adjust(model, not mapping.fixed_intrinsics, False, loss, mapping.threads, Effort(), mapping.constant)
    remove_outliers(model, given.options.refine, 2.0)


def _laid(model: pycolmap.Reconstruction, ids: Sequence[frozenset[int]]) -> _Laid:
    """A model whose points each belong to one piece."""
    views, numbers = to_views(model)
    owner = np.array([next(k for k, piece_images in enumerate(ids) if i in piece_images) for i in numbers], int)
    return _Laid(views, tuple(numbers), to_points(model, numbers), owner)


def _placed(laid: _Laid, given: ModelInputs) -> tuple[list[Similarity], list[Spread]] | None:
    """Where each piece lies in the first, by the motion, and how well that is known; None where they have no free motion in
    common."""
    clock = given.footage.times
    time = np.array([clock[n] for n in laid.views.names])
    pieces, middles, radii = [], [], []
    for k in range(laid.owner.max() + 1):
        in_piece = np.flatnonzero(laid.owner == k)
        in_piece = in_piece[np.argsort(time[in_piece])]
        xyz = laid.points.of_views(in_piece).xyz
        if len(in_piece) < FEWEST or len(xyz) < LEAST_POINTS:
            return None
        middle = np.median(xyz, axis=0)
        R, t = laid.views.R[in_piece], laid.views.t[in_piece]
        # about the middle of what was seen: an error of the attitude then moves nothing
        pieces.append(Piece(time[in_piece], R, t + R @ middle))
        middles.append(middle)
        radii.append(_radius(xyz))
    rotation = fit_rotation(pieces)
    if not rotation.rms < np.deg2rad(MOST_RMS_DEG):
        return None
    centres = fit_centres(pieces, rotation, radii[0] / float(np.median(pieces[0].t[:, 2])))
    to, spread = [STAYS], [Spread(0.0, 0.0, 0.0)]
    for k in range(1, len(pieces)):
        scale, C = float(centres.scale[k]), rotation.C[k]
        to.append(Similarity(scale, C, middles[0] + centres.shift[k] - scale * C @ middles[k]))
        turn = max(np.deg2rad(TURN_DEG), TURN_SIGMAS * float(rotation.sigma[k]))
        spread.append(Spread(turn, max(SIZE, SIZE_SIGMAS * float(centres.sigma[k])), SHIFT * radii[0]))
    return (to, spread) if np.all(centres.scale > 0) else None


def _radius(xyz: np.ndarray) -> float:
    return float(np.quantile(np.linalg.norm(xyz - np.median(xyz, axis=0), axis=1), 0.9))


def _joined(
    model: pycolmap.Reconstruction, ids: Sequence[frozenset[int]], given: ModelInputs
) -> pycolmap.Reconstruction | None:
    """The first piece with those that its surface bears out, one after the other; None where it bears out none."""
    # the adjustment may have taken images out
    remaining_images = frozenset(model.reg_image_ids())
    ids = [piece_images & remaining_images for piece_images in ids if len(piece_images & remaining_images) >= FEWEST]
    if len(ids) < 2:
        return None
    model = assemble([Part(model, piece_images, STAYS) for piece_images in ids])
    laid = _laid(model, ids)
    placed = _placed(laid, given)
    if placed is None:
        return None
    to, spread = placed
    rng, look = np.random.default_rng([given.options.seed, 43]), _Look(given)
    inside, sightings, tried = [0], list[Sighting](), set[tuple[int, int]]()
    open_ = _by_gap(laid, inside, given.footage)
    while open_:
        k = open_[0]
        tried.add((k, len(inside)))
        both = laid.at(to, [*inside, k])
        second = both.owner == k
        candidates = look.candidates(both, second, REACH)
        consensus = agreement(both.views, both.points, second, candidates, spread[k], rng)
        if (
            consensus is not None
            and consensus.beyond_chance
            and is_significant(consensus, _wrong(laid, to, [*inside, k], look, spread[k], rng))
        ):
            to[k] = Similarity(consensus.scale, consensus.R, consensus.t).after(to[k])
            sightings += _sightings(both, candidates.take(np.flatnonzero(consensus.agree)))
            inside.append(k)
        # what is refused may still be tied to a piece that comes in later
        open_ = [k for k in _by_gap(laid, inside, given.footage) if (k, len(inside)) not in tried]
    if len(inside) < 2:
        return None
    whole = assemble([Part(model, ids[k], to[k]) for k in inside], _numbered(sightings, inside))
    _adjust(whole, given)
    return _looked_again(whole, [ids[k] for k in inside], look, given)


def _wrong(
    laid: _Laid, to: Sequence[Similarity], pieces: Sequence[int], look: _Look, spread: Spread, rng: np.random.Generator
) -> list[Agreement | None]:
    """What candidates agree on where the last of the pieces is turned by much about the middle of the body."""
    from scipy.spatial.transform import Rotation

    k, out = pieces[-1], list[Agreement | None]()
    middle = np.median(laid.at(to, pieces).points.xyz, axis=0)
    for _ in range(WRONG_TURNS):
        axis = rng.standard_normal(3)
        R = Rotation.from_rotvec(np.deg2rad(WRONG_DEG) * axis / np.linalg.norm(axis)).as_matrix()
        turned = list(to)
        turned[k] = Similarity(1.0, R, middle - R @ middle).after(to[k])
        both = laid.at(turned, pieces)
        second = both.owner == k
        candidates = look.candidates(both, second, REACH).some(WRONG_POINTS, rng)
        out.append(agreement(both.views, both.points, second, candidates, spread, rng))
    return out


def _by_gap(laid: _Laid, inside: Sequence[int], footage: FootageRecord) -> list[int]:
    """The pieces that are not inside, the one nearest in time to any that is first."""
    order = {f.name: i for i, f in enumerate(footage.frames)}
    place = np.array([order[n] for n in laid.views.names])
    there = place[np.isin(laid.owner, inside)]
    gap = {
        k: int(np.abs(place[laid.owner == k][:, None] - there).min())
        for k in range(laid.owner.max() + 1)
        if k not in inside
    }
    return sorted(gap, key=lambda k: (gap[k], k))


def _looked_again(
    whole: pycolmap.Reconstruction, ids: Sequence[frozenset[int]], look: _Look, given: ModelInputs
) -> pycolmap.Reconstruction | None:
    """The joined model with what its pieces see of each other looked for once more, nearer to where it now should be; None where
    that holds them together too little.

    Raises:
        NotPossible: too little is left.
    """
    present = [piece_images & set(whole.reg_image_ids()) for piece_images in ids]
    parts = [Part(whole, piece_images, STAYS) for piece_images in present]
    split = assemble(parts)
    laid = _laid(split, present)
    pieces, sightings = list(range(len(ids))), list[Sighting]()
    for k in pieces[1:]:
        second = laid.owner == k
        candidates = look.candidates(laid, second, NEAR)
        uv = projected(laid.views, candidates.view, laid.points.xyz[candidates.point])
        near = np.flatnonzero(np.linalg.norm(uv - candidates.uv, axis=1) < AGREES_PX)
        sightings += _sightings(laid, candidates.take(near))
    together = Part(split, frozenset[int]().union(*present), STAYS)
    joined = assemble([together], [s._replace(part=0) for s in _once(sightings)])
    _adjust(joined, given)
    return joined if _tied(joined, present) else None


def _tied(model: pycolmap.Reconstruction, ids: Sequence[frozenset[int]]) -> bool:
    """Whether every piece shares enough points with the others."""
    remaining_images = set(model.reg_image_ids())
    shared = np.zeros(len(ids), int)
    for point in model.points3D.values():
        seen = {e.image_id for e in point.track.elements}
        inside = [k for k, piece_images in enumerate(ids) if piece_images & seen]
        if len(inside) > 1:
            shared[inside] += 1
    return bool(np.all(shared >= LEAST_POINTS)) and all(piece_images & remaining_images for piece_images in ids)


def _sightings(laid: _Laid, candidates: Candidates) -> list[Sighting]:
    part = laid.of_point()
    return [
        Sighting(int(part[p]), int(laid.points.id[p]), laid.ids[v], uv)
        for p, v, uv in zip(candidates.point.tolist(), candidates.view.tolist(), candidates.uv, strict=True)
    ]


def _once(sightings: Sequence[Sighting]) -> list[Sighting]:
    """Of several places for one point in one image the first."""
    out: dict[tuple[int, int, int], Sighting] = {}
    for s in sightings:
        out.setdefault((s.part, s.point, s.image), s)
    return list(out.values())


def _numbered(sightings: Sequence[Sighting], inside: Sequence[int]) -> list[Sighting]:
    return [s._replace(part=inside.index(s.part)) for s in _once(sightings)]


class _Look:
    """Where points of one piece are seen by another: by their features, and by patches of the surface about them."""

    def __init__(self, given: ModelInputs) -> None:
        self.footage = given.footage
        self.frames = {f.name: f for f in given.footage.frames}
        self.features = {n: (k[:, :2].astype(float) - 0.5, unit(d)) for n, (k, d) in given.found.features.items()}

    def candidates(self, laid: _Laid, second: np.ndarray, reach: float) -> Candidates:
        """Of the points of both sides, seen by views `second` (n,) bool and by the others.

        Args:
            reach: how far from its place each is looked for, in radii of the body.
        """
        views, points = laid.views, laid.points
        depth = float(np.median(np.einsum("ni,ni->n", views.R[:, 2], np.median(points.xyz, axis=0) - views.centres)))
        px = max(4, round(reach * _radius(points.xyz) / depth * float(views.K[0, 0, 0])))
        looks, features = self._looks(views, points), [self.features[n] for n in views.names]
        grey = self._grey(views)
        all_candidates = [
            feature_candidates(views, points, of_side, px, looks, features) for of_side in (second, ~second)
        ]
        all_candidates += [patch_candidates(views, points, of_side, px, grey) for of_side in (second, ~second)]
        return Candidates.joined(all_candidates)

    def _looks(self, views: Views, points: SparsePoints) -> np.ndarray:
        """(k, 128) unit descriptors of the observations; nan where they are no feature."""
        out = np.full((len(points.obs_view), 128), np.nan)
        for i, name in enumerate(views.names):
            of_view = np.flatnonzero(points.obs_view == i)
            places, described = self.features[name]
            if len(of_view) and len(places):
                away, nearest = cKDTree(places).query(points.obs_uv[of_view])
                out[of_view[away < 0.01]] = described[nearest[away < 0.01]]
        return out

    def _grey(self, views: Views) -> Grey:
        """The images as their camera's are turned, black outside the silhouettes."""

        def grey(i: int) -> np.ndarray:
            frame = self.frames[views.names[i]]
            path = self.footage.image(frame.name)
            image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
            if image is None:
                raise InputError(f"{path}: not a readable image; run the capture stage again")
            mask = read_mask(self.footage, frame.name, self.footage.size(frame))
            if mask is not None:
                image[mask == 0] = 0
            return turn_image(image, frame.turn).astype(np.float32)

        return grey
