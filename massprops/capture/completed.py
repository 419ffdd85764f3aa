"""Parts that the measured shape lacks and that all images show: found by the votes of half of the images, and kept where
the other half agrees better with them.

A dark or thin part has no stereo points, so the shape that stereo measured ends where it begins. All images show it before
the support all the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.capture.from_shape import beyond_band
from massprops.capture.occlusion import boundary_of
from massprops.capture.support_evidence import Looked, drawn_in, learned, wide_picture
from massprops.capture.support_picture import SupportPicture
from massprops.capture.votes import Lattice, counted, lattice_on, vote
from massprops.surface.refine import fair
from massprops.views import Views

WIDER = 2.0
"""Size of the space that is searched, over that of the measured shape."""
MOST_CUBES = 2_500_000
CUBE = 1.5
"""Side of a cube [px]."""
BESIDE = 3.0
"""Cubes this near to a point of something else that stands there are its own [cubes]."""
LEAST_CUBES, FAIR = 30, 10
"""Cubes of a part, and steps in which it is made smooth."""
LEAST_GAIN = 3.0
"""Standard errors by which the images left out must agree better with a part. Chosen while looking at a padlock."""


@dataclass(frozen=True)
class PlacementEvidence:
    """What n images say of one placement.

    Attributes:
        seen: the images.
        picture: of the support.
        log_odds: (n, h, w) float32 of something before the support; 0 where nothing is known.
        drawn: (n, h, w) bool, silhouettes of the measured shape.
    """

    seen: Looked
    picture: SupportPicture
    log_odds: np.ndarray
    drawn: np.ndarray

    @property
    def views(self) -> Views:
        """Of the images, in the size in which they are looked at."""
        return self.seen.views


def evidence_of(seen: Looked) -> PlacementEvidence:
    """What the images show beside a measured shape."""
    picture = wide_picture(seen)
    support_evidence = learned(seen, (picture,))
    odds = [support_evidence.log_odds(seen.views, i, seen.image(i)) for i in range(len(seen.views))]
    return PlacementEvidence(
        seen, picture, _stacked([o for o in odds if o is not None], 0.0), _stacked(seen.drawn, False)
    )


def _stacked(maps: list[np.ndarray], beyond: float) -> np.ndarray:
    """(n, h, w) of maps whose sizes may differ, the smaller ones filled up."""
    h, w = (max(m.shape[k] for m in maps) for k in (0, 1))
    return np.stack([
        np.pad(m, ((0, h - m.shape[0]), (0, w - m.shape[1])), constant_values=beyond) for m in maps
    ])  # fmt: skip


@dataclass(frozen=True)
class Part:
    """A part that the measured shape lacks: vertices (v, 3), faces (f, 3) of its cubes' boundary, and (n,) how much better
    each image agrees with the shape and such a part as the other half of the images found it [log odds]."""

    vertices: np.ndarray
    faces: np.ndarray
    gain: np.ndarray

    @property
    def sure(self) -> bool:
        """Whether the images that did not find it agree better with it."""
        error = float(np.std(self.gain)) / np.sqrt(len(self.gain))
        return bool(np.mean(self.gain) > LEAST_GAIN * error) and bool(np.median(self.gain) > 0)


def missing_parts(
    evidence: PlacementEvidence, plane: np.ndarray, vertices: np.ndarray, standing: np.ndarray, pixel: float
) -> list[Part]:
    """What the votes find beside a measured shape and hanging together with it.

    Args:
        evidence: what the images show; plane: (4,) support; vertices: (v, 3) of the shape.
        standing: (m, 3) points of other things; pixel: at the object.
    """
    from scipy.ndimage import binary_dilation, find_objects, generate_binary_structure, label

    lattice = lattice_on(plane, vertices, WIDER, CUBE * pixel, MOST_CUBES)
    # what falls on the measured shape may be hidden by that alone
    votes = np.where(evidence.drawn, 0.0, vote(evidence.log_odds)).astype(np.float32)
    halves, outside = counted(lattice, evidence.views, votes, np.stack([beyond_band(d) for d in evidence.drawn]))
    full = generate_binary_structure(3, 3)
    piece, number = label((halves.sum(0) > 0) & outside & ~_near(lattice, standing), full)
    count = np.bincount(piece.ravel(), minlength=number + 1)
    touch = np.bincount(piece[binary_dilation(~outside, full)], minlength=number + 1) > 0
    out = []
    for k, box in enumerate(find_objects(piece), 1):
        if count[k] >= LEAST_CUBES and touch[k]:
            in_piece, voted = piece[box] == k, halves[(slice(None), *box)] > 0
            here = lattice.part(box)
            gain = np.zeros(len(evidence.views))
            for i in range(len(gain)):
                gain[i] = _gain(evidence, i, here, in_piece & voted[1 - i % 2])
            vertices, faces = boundary_of(here.origin, here.steps, in_piece)
            # features are looked for on it, and cubes face along their axes only
            out.append(Part(fair(vertices, faces, np.zeros(len(vertices), bool), FAIR), faces, gain))
    return out


def _near(lattice: Lattice, xyz: np.ndarray) -> np.ndarray:
    """(a, b, c) bool: cubes near points (m, 3)."""
    from scipy.ndimage import distance_transform_edt

    free = np.ones(lattice.shape, bool)
    at, there = lattice.nearest(xyz)
    free[tuple(at[there].T)] = False
    if free.all():
        return ~free
    return np.asarray(distance_transform_edt(free) < BESIDE)


def _gain(evidence: PlacementEvidence, i: int, lattice: Lattice, solid: np.ndarray) -> float:
    """By how much view i agrees better with some cubes beside the measured shape than without."""
    if not solid.any():
        return 0.0
    vertices, faces = boundary_of(lattice.origin, lattice.steps, solid)
    drawn = drawn_in(evidence.views, i, vertices, faces)
    h, w = drawn.shape
    return float(evidence.log_odds[i, :h, :w][drawn & ~evidence.drawn[i, :h, :w]].sum())
