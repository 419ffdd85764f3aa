"""Whether the images of a video follow each other as a turning body or a walking camera lets them."""

from __future__ import annotations

import numpy as np


def largest_jump(R: np.ndarray, times: np.ndarray) -> float:
    """Largest change of the turning rate between neighbouring pairs of steps, in units of the median rate.

    Images that overlap enough to be matched are a few degrees apart, and a free body's rate changes between them by a
    small part of itself (a turn of 0.1 rad changes by the square of that). A part linked the wrong way round throws
    the attitude by tens of degrees for good; one image that is held by few points is off by a few, and the next is not.

    Args:
        R: (n, 3, 3) world to camera; times: (n,) ascending, any unit.

    Returns:
        0 with fewer than five images.
    """
    if len(times) < 5:
        return 0.0
    change, usual = _changes(R, times)
    return float(change.max() / usual)


def steady_stretch(R: np.ndarray, times: np.ndarray, core: np.ndarray) -> np.ndarray:
    """(n,) bool: the images about those of `core` (n,) bool up to the first jump on either side.

    Args:
        R: (n, 3, 3) world to camera; times: (n,) ascending, any unit.
    """
    keep, inside = np.ones(len(times), bool), np.flatnonzero(core)
    while np.count_nonzero(keep) >= 5 and len(inside):
        kept = np.flatnonzero(keep)
        change, usual = _changes(R[kept], times[kept])
        if change.max() < usual:
            break
        at = kept[int(np.argmax(change)) + 2]
        if at < inside[len(inside) // 2]:
            keep[: max(1, min(at + 1, inside[0]))] = False
        else:
            keep[min(len(keep) - 1, max(at, inside[-1] + 1)) :] = False
        keep |= core
        if np.array_equal(np.flatnonzero(keep), kept):
            return core.copy()
    return keep


def stretches(R: np.ndarray, times: np.ndarray) -> list[np.ndarray]:
    """Numbers of the images between jumps, the longest stretch first; the image at a jump belongs to none.

    Args:
        R: (n, 3, 3) world to camera; times: (n,) ascending, any unit.
    """
    out, remaining = [], [np.arange(len(times))]
    while remaining:
        own = remaining.pop()
        if len(own) >= 5:
            change, usual = _changes(R[own], times[own])
            if change.max() >= usual:
                at = int(np.argmax(change)) + 2
                remaining += [own[:at], own[at + 1 :]]
                continue
        out.append(own)
    return sorted(out, key=lambda own: (-len(own), own[0]))


def _changes(R: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, float]:
    """(n - 4,) changes of the turning rate between chords of two steps, and the median rate."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(R[2:] @ R[:-2].transpose(0, 2, 1)).as_rotvec()
    rate = turn / (times[2:] - times[:-2]).astype(float)[:, None]
    usual = max(float(np.median(np.linalg.norm(rate, axis=1))), 1e-12)
    return np.linalg.norm(rate[2:] - rate[:-2], axis=1), usual
