"""The longest run of a film's images that one free motion explains, where one motion does not explain all.

A mapper may take near for far from some image on: from there the body seems to slow down, to stand and to turn back. From image to image
that is no jump, but no free body does so. What lies on one side of such a place fits one motion, and that tells where the rest belongs.
"""

from __future__ import annotations

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.sfm.free_motion import Piece, fit_rotation

SHORTEST = 8
"""Images that a free motion is looked for in: eleven numbers and few images fit whatever comes."""

FOLLOWS = 3.0
"""How far an image may be off the motion through those beside it, over the largest root mean square that a motion may leave."""


def longest_free_run(piece: Piece, most_rms: float) -> np.ndarray:
    """Places (k,) in the piece of the images that follow each other by one free motion; none where there are fewer than `SHORTEST`.

    The piece is halved until its parts fit a motion; each such part is then drawn on to both sides as far as images follow it.

    Args:
        piece: in the order of time.
        most_rms: root mean square deviation that a motion may leave [rad].
    """
    best, waiting = np.zeros(0, int), [np.arange(len(piece.times))]
    while waiting:
        run = waiting.pop()
        # what another run has taken in is not looked at again
        if len(run) < SHORTEST or np.isin(run, best).all():
            continue
        grown = _grown(piece, run, most_rms)
        if len(grown) > len(best):
            best = grown
        if not len(grown):
            waiting += np.array_split(run, 2)
    return best


def _grown(piece: Piece, run: np.ndarray, most_rms: float) -> np.ndarray:
    """The run and the images beside it that follow its motion; none where it has none."""
    size = 0
    while len(run) > size:
        size = len(run)
        off = _off(piece, run)
        if not mad_sigma(off[run].ravel()) < most_rms:
            return run[:0]
        follows = np.linalg.norm(off, axis=1) < FOLLOWS * most_rms
        away = np.flatnonzero(~follows)
        middle = int(np.median(run))
        low = away[away < middle].max(initial=-1) + 1
        high = away[away > middle].min(initial=len(follows))
        # a motion is known about its own images: no farther than by half as many at a time
        low, high = max(low, run[0] - size // 4 - 1), min(high, run[-1] + size // 4 + 2)
        run = np.arange(low, high)
    return run


def _off(piece: Piece, run: np.ndarray) -> np.ndarray:
    """(n, 3) turns of all images off the motion through those of the run [rad]; infinite where that cannot be followed so far."""
    from scipy.spatial.transform import Rotation

    motion = fit_rotation([Piece(piece.times[run], piece.R[run], piece.t[run])], robust=True).motion
    predicted = motion.attitudes(piece.times)[0]
    followed, out = np.isfinite(predicted).all(axis=(1, 2)), np.full((len(predicted), 3), np.inf)
    apart = predicted[followed].transpose(0, 2, 1) @ piece.R[followed]
    out[followed] = Rotation.from_matrix(apart).as_rotvec() if followed.any() else 0.0
    return out
