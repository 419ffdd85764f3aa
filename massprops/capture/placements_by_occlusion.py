"""Placements of an object without features, by what it hides of its support, in the order of capture.

A plain object gives no feature of its own to tell its placements by. But what stands in one place hides one part of its
support: the hull of what the first half of the images hides predicts what their other half hides. If the object was
moved in between, two hulls predict it better than one.
"""

from __future__ import annotations

import numpy as np

from massprops.capture.occlusion import LEAST_AGREEMENT, Occlusion, Voxels, explained, hull
from massprops.capture.placements import PAUSE, timed

LEAST_IMAGES = 8
"""Images of a placement: half of them must make a hull (`occlusion.LEAST_HIDDEN`) and half of them test it."""
BETTER = 0.015
"""Rise of the predicted intersection over union that a division must bring. Set on one plain cup, turned over and moved by
its own width: .039 at the right place, .049 at the best. Of a flat plate no hull explains enough to be divided."""
LEAST_GAIN = 4.0
"""Where hulls explain little, standard errors by which those before and after a long pause must explain more than as many images
taken by turns. Of a plain banana on glossy tiles, turned over in a pause, they explain .55 and .35, one hull for both .21."""


def predicted_agreement(grid: Voxels, maps: Occlusion, member: np.ndarray) -> np.ndarray:
    """(k,) how well the hull of every other image of `member` (k,) explains what each image hides."""
    out = np.zeros(len(member))
    odd = np.arange(len(member)) % 2 == 1
    for tested in (odd, ~odd):
        out[tested] = explained(grid, maps, hull(grid, member[~tested]), member[tested])
    return out


def _by_turns(grid: Voxels, maps: Occlusion, part: np.ndarray) -> np.ndarray:
    """(k,) how well hulls of half of the images `part` (k,), taken by turns, explain what each image hides."""
    out = np.zeros(len(part))
    for k in (0, 1):
        out[k::2] = predicted_agreement(grid, maps, part[k::2])
    return out


def divide_by_occlusion(grid: Voxels, maps: Occlusion, timestamp_ns: np.ndarray | None = None) -> np.ndarray:
    """(n,) placement that each image shows, in the order of capture; all 0 where one explains as much as several.

    Args:
        grid: what n views say of the space above the support, in the order of capture; maps: of these views.
        timestamp_ns: (n,) when each was taken, negative where nobody knows: where a few pauses are much longer than
            the others, the object was moved in one of them.
    """
    everyone = np.arange(len(grid.shown))
    divided, todo = [], [(everyone, predicted_agreement(grid, maps, everyone))]
    while todo:
        part, score = todo.pop()
        best: tuple[float, np.ndarray, np.ndarray, int] | None = None
        cuts, paused = _cuts(part, timestamp_ns)
        by_turns = _by_turns(grid, maps, part) if paused else score
        for cut in cuts:
            first, second = (predicted_agreement(grid, maps, p) for p in (part[:cut], part[cut:]))
            both = np.concatenate([first, second])
            rise = float(both.mean() - score.mean())
            sound = min(first.mean(), second.mean()) > LEAST_AGREEMENT
            if paused and not sound:
                gain = both - by_turns
                sound = gain.mean() > LEAST_GAIN * gain.std() / np.sqrt(len(gain))
            if sound and rise > BETTER and (best is None or rise > best[0]):
                best = (rise, first, second, cut)
        if best is None:
            divided.append(part)
        else:
            _, first, second, cut = best
            todo += [(part[:cut], first), (part[cut:], second)]
    label = np.zeros(len(everyone), int)
    for k, part in enumerate(sorted(divided, key=lambda p: (-len(p), int(p[0])))):
        label[part] = k
    return label


def _cuts(part: np.ndarray, timestamp_ns: np.ndarray | None) -> tuple[list[int], bool]:
    """Where images `part` (consecutive) may be divided: at long pauses where there are some, else anywhere; and whether
    there are."""
    anywhere = list(range(LEAST_IMAGES, len(part) - LEAST_IMAGES + 1))
    times = None if timestamp_ns is None else timestamp_ns[part]
    if not timed(times):
        return anywhere, False
    pause = np.diff(times)
    long = [cut for cut in anywhere if pause[cut - 1] > PAUSE * max(float(np.median(pause)), 1.0)]
    return long or anywhere, bool(long)
