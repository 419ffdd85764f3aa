"""One silhouette drawn from a shape and refined by its image, for the stages that know a shape."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massprops.capture.before import hidden_share
from massprops.capture.from_shape import (
    Paint,
    Trimap,
    beyond_band,
    far_from,
    refine,
    share_covered,
    shows_object_colours,
    shows_points,
    to_stored,
    trimap,
    unsure,
)
from massprops.geometry.projection import project
from massprops.views import AMBIGUOUS, Views

if TYPE_CHECKING:
    from massprops.capture.support_evidence import SupportEvidence

DRAWN = "drawn from the shape, refined by the images"
"""How silhouettes were found, as `silhouettes.json` says it, where nothing but the shape told of them."""
EVIDENCE = "support_evidence.npz"
"""File of a placement's `SupportEvidence`."""
MARGIN_PX = 2
"""A point this near to a silhouette may belong to it."""


@dataclass(frozen=True)
class Visible:
    """What a view may show, in the frame of its camera's pose.

    Attributes:
        vertices, faces: (v, 3), (f, 3) of the object's shape; measured: the faces that were, None where all were.
        own, own_colour: (n, 3) the object's dense points and their colours, uint8 BGR.
        other, other_colour: (m, 3) those of what is not the object.
        painted: colours of the object, which tell what a silhouette may lack; None where none was measured.
        closed: the shape is the body's whole surface.
        support: what all images say of what is before the support; None of a thing that stands on none.
    """

    vertices: np.ndarray
    faces: np.ndarray
    measured: np.ndarray | None
    own: np.ndarray
    own_colour: np.ndarray
    other: np.ndarray
    other_colour: np.ndarray
    painted: Paint | None = None
    closed: bool = False
    support: SupportEvidence | None = None

    def moved(self, R: np.ndarray, t: np.ndarray) -> Visible:
        """The same after x -> R x + t."""
        vertices, object_points, other = (x @ R.T + t for x in (self.vertices, self.own, self.other))
        support = None if self.support is None else self.support.moved(R, t)
        return replace(self, vertices=vertices, own=object_points, other=other, support=support)

    def with_shape(self, other: Visible) -> Visible:
        """The same with another placement's shape of the object put to its own."""
        behind = len(self.vertices)
        faces = np.concatenate([self.faces, other.faces + behind])
        kept = [self.faces if self.measured is None else self.measured]
        kept.append((other.faces if other.measured is None else other.measured) + behind)
        return replace(
            self,
            vertices=np.concatenate([self.vertices, other.vertices]),
            faces=faces,
            measured=None if self.measured is None and other.measured is None else np.concatenate(kept),
        )


def learned_paint(folders: list[Path]) -> Paint | None:
    """Colours of the object and of what is about it over all its placements; None of no placement."""
    if not folders:
        return None
    other = [np.load(folder / "other_colour.npy", allow_pickle=False)[:, ::-1] for folder in folders]
    return Paint.learn(np.concatenate([own_points(folder)[1] for folder in folders]), np.concatenate(other))


def scene_in(folder: Path, painted: Paint | None) -> Visible:
    """What `shape` has written of a placement into its folder."""
    with np.load(folder / "shape.npz", allow_pickle=False) as z:
        vertices, faces = z["vertices"], z["faces"]
        measured = faces[: int(z["measured"])] if "measured" in z.files else None
    support = support_in(folder)
    return Visible(vertices, faces, measured, *own_points(folder), *surroundings(folder), painted, support=support)


def support_in(folder: Path) -> SupportEvidence | None:
    """What `shape` has written of what the images of a placement say of its support."""
    from massprops.capture.support_evidence import SupportEvidence

    return SupportEvidence.load(folder / EVIDENCE) if (folder / EVIDENCE).is_file() else None


def own_points(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """The object's dense points (n, 3) and their colours (n, 3) BGR."""
    with np.load(folder / "object.npz", allow_pickle=False) as z:
        xyz = z["xyz"]
    return xyz, np.load(folder / "colour.npy", allow_pickle=False)[:, ::-1]


def surroundings(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of what is not the object and their colours (n, 3) BGR: of a plain one all of its known support."""
    with np.load(folder / "other.npz", allow_pickle=False) as z:
        xyz = z["xyz"]
    colour = np.load(folder / "other_colour.npy", allow_pickle=False)[:, ::-1]
    if not (folder / "support.npz").is_file():
        return xyz, colour
    with np.load(folder / "support.npz", allow_pickle=False) as z:
        return np.concatenate([xyz, z["xyz"]]), np.concatenate([colour, z["colour"]])


def drawn_silhouette(image: np.ndarray, views: Views, i: int, shown: Visible) -> tuple[np.ndarray, Trimap, float]:
    """The silhouette (h, w) uint8 of view i without its lens's distortion: 255 object, 0 background, 128 perhaps; what was
    known of its pixels before; and the share of the object's points that something hides.

    Args:
        image: (h, w, 3) uint8 of that view.
    """
    from massprops.geometry.rasterise import rasterise

    K, R, t = views.K[i], views.R[i], views.t[i]
    size = image.shape[1], image.shape[0]
    depth, _ = rasterise(shown.vertices, shown.faces, K, R, t, size)
    uv, z = project(shown.other, K, R, t)
    ahead = z > 0
    uv, z = uv[ahead], z[ahead]
    at, deep = project(shown.own, K, R, t)
    far = far_from(depth)
    colours = np.concatenate([shown.other_colour[ahead], shown.own_colour])
    seen = shows_points(image, np.concatenate([uv, at]), colours, far)
    evidence = None if shown.support is None else shown.support.log_odds(views, i, image)
    own_coloured = None
    # of a closed shape nothing is farther off than its band
    if evidence is not None and shown.painted is not None and not shown.closed:
        own_coloured = shows_object_colours(image, shown.painted, evidence)
    known = trimap(depth, uv, z, seen[: len(uv)], shown.closed, own_coloured)
    if shown.measured is not None:
        # what the votes of all images put to the shape is a hull, and no point of it is sure
        sure = np.isfinite(rasterise(shown.vertices, shown.measured, K, R, t, size)[0])
        known = replace(known, surely=known.surely & sure)
    if evidence is not None:
        # a table shines, so that far off the shape nothing needs to stand where it looks different
        far = beyond_band(known.drawn)
        known = replace(known, evidence=np.where(far, np.minimum(evidence, 0.0), evidence))
    solid = refine(image, known)
    mask = np.where(solid, 255, 0).astype(np.uint8)
    if shown.painted is not None:
        mask[unsure(image, solid, shown.painted, far)] = AMBIGUOUS
    return mask, known, hidden_share(depth, at, deep, seen[len(uv) :])


def stored(mask: np.ndarray, views: Views, i: int) -> np.ndarray:
    """A silhouette (h, w) of `drawn_silhouette` in the geometry of the stored frame."""
    lens = views.K[i], views.distortion[i]
    out = to_stored(mask == 255, *lens)
    out[(to_stored(mask > 0, *lens) > 0) & (out == 0)] = AMBIGUOUS
    return out


def outside(views: Views, i: int, mask: np.ndarray, points: np.ndarray) -> float:
    """Share of the object's points (n, 3) that view i sees beside a silhouette (h, w) uint8."""
    covered = share_covered(mask > 0, MARGIN_PX, points, views.K[i], views.R[i], views.t[i])
    return 0.0 if covered is None else 1.0 - covered
