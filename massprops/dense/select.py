"""Which views get a depth map, and against which others each is matched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from massprops.geometry.vectors import angles_deg
from massprops.views import Views

MOST_REFERENCES = 40
"""Whole depth maps: beyond it the sphere of directions around a body is seen every few degrees already."""

MOST_FURTHER = 60
"""Further views by default, which are matched only where the whole depth maps agreed on nothing."""

SOURCES = 4
BEST_ANGLE, NARROW, WIDE = 10.0, 3.0, 26.0
"""Angle between two lines of sight [deg]: below NARROW depth is not told, above WIDE surfaces look too different."""
FEW_SEEN = 20
"""Sparse points without which a view's own do not bound its depths."""


class Sparse(Protocol):
    """Sparse points: xyz (m, 3) and their observations, obs_view and obs_point (k,): which view saw which point."""

    @property
    def xyz(self) -> np.ndarray: ...
    @property
    def obs_view(self) -> np.ndarray: ...
    @property
    def obs_point(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Selection:
    """reference (r,) view indices; whole (r,) bool: which of them get a whole depth map; sources: per reference (s,)
    view indices; depths (r, 2) nearest, farthest."""

    reference: np.ndarray
    whole: np.ndarray
    sources: tuple[np.ndarray, ...]
    depths: np.ndarray


def shared_points(n: int, obs_view: np.ndarray, obs_point: np.ndarray) -> np.ndarray:
    """(n, n) number of sparse points that two views have in common."""
    from scipy.sparse import coo_matrix

    points = int(obs_point.max(initial=-1)) + 1
    seen = coo_matrix((np.ones(len(obs_view), np.float32), (obs_view, obs_point)), shape=(n, points)).tocsr()
    return np.asarray((seen @ seen.T).todense())


def seen_points(sparse: Sparse, i: int) -> np.ndarray:
    """(k, 3) sparse points that view i saw."""
    return sparse.xyz[sparse.obs_point[sparse.obs_view == i]]


def select_views(views: Views, sparse: Sparse, most: int = 0) -> Selection:
    """References spread over the sphere of directions, each with its best sources.

    Args:
        views: registered views.
        sparse: points and which view saw which.
        most: largest number of references, the first `MOST_REFERENCES` of them whole; 0 for the default.

    Returns:
        references in the order of their index; views without two usable sources are left out.
    """
    n = len(views)
    common = shared_points(n, sparse.obs_view, sparse.obs_point)
    centre = np.median(sparse.xyz, axis=0)
    angle = angles_deg(views.centres - centre)
    sources = [_sources(i, common[i], angle) for i in range(n)]
    able = np.array([len(s) >= 2 for s in sources])
    chosen = _spread(angle, able, most or MOST_REFERENCES + MOST_FURTHER)
    whole = np.isin(np.sort(chosen), chosen[:MOST_REFERENCES])
    reference = np.sort(chosen)
    depths = np.zeros((len(reference), 2))
    for k, i in enumerate(reference):
        mine = seen_points(sparse, i)
        if len(mine) < FEW_SEEN:
            mine = sparse.xyz  # what it saw does not say how deep it may see
        z = (mine @ views.R[i].T + views.t[i])[:, 2]
        z = z[z > 0]
        low, high = np.percentile(z, [1, 99]) if len(z) > 5 else (0.5, 2.0)
        pad = 0.15 * (high - low) + 0.01 * high
        depths[k] = max(low - pad, 0.2 * low), high + pad
    return Selection(reference, whole, tuple(sources[i] for i in reference), depths)


def _sources(i: int, common: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Up to SOURCES views that share points with view i at a useful angle, and lie in different directions from it."""
    a = angle[i]
    usable = (a >= NARROW) & (a <= WIDE) & (common >= 15)
    usable[i] = False
    if usable.sum() < 2:
        usable = (a >= 0.4 * NARROW) & (a <= 1.5 * WIDE) & (common >= 8)
        usable[i] = False
    if usable.sum() < 2:
        # placed by what is about the object: of 54 photographs of a printed tin, 11 shared less with any neighbour
        usable = (a >= NARROW) & (a <= 1.5 * WIDE)
        usable[i] = False
        common = common + 1.0
    score = np.where(usable, common * np.exp(-(((a - BEST_ANGLE) / 8.0) ** 2)), 0.0)
    chosen: list[int] = []
    for _ in range(SOURCES):
        best = int(np.argmax(score))
        if score[best] <= 0:
            break
        chosen.append(best)
        score[best] = 0.0
        # a neighbour of a chosen source tells the same again
        score *= 1.0 - 0.6 * np.exp(-((angle[best] / 4.0) ** 2))
    return np.array(chosen, dtype=np.int64)


def _spread(angle: np.ndarray, able: np.ndarray, most: int) -> np.ndarray:
    """Farthest-point choice of at most `most` able views, in the order of choice; deterministic."""
    pool = np.flatnonzero(able)
    if len(pool) == 0:
        return pool
    chosen = [int(pool[0])]
    nearest = angle[pool[0], pool].copy()
    nearest[0] = -1.0
    while len(chosen) < min(most, len(pool)):
        best = int(np.argmax(nearest))
        chosen.append(int(pool[best]))
        nearest = np.minimum(nearest, angle[pool[best], pool])
        nearest[best] = -1.0
    return np.array(chosen)
