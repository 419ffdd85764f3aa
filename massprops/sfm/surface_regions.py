"""Regions of a surface whose features may err alike: a highlight, a shadow's edge or a mirrored sky takes those of one side with it."""

from __future__ import annotations

import numpy as np

REGIONS = 12
"""More cut the side that slides in two, fewer leave a spread that is itself a guess."""


def regions(xyz: np.ndarray, count: np.ndarray) -> np.ndarray:
    """(m,) the region of each point (m, 3), numbered from 0: the heaviest is halved across its longest side until there
    are `REGIONS`; count: (m,) observations of each point."""
    label = np.zeros(len(xyz), int)
    for new in range(1, REGIONS):
        weight = np.bincount(label, count, minlength=new)
        in_region = np.flatnonzero(label == int(np.argmax(weight)))
        if len(in_region) < 2:
            break
        axis = int(np.argmax(np.ptp(xyz[in_region], axis=0)))
        order = in_region[np.argsort(xyz[in_region, axis], kind="stable")]
        half = int(np.searchsorted(np.cumsum(count[order]), 0.5 * count[order].sum()))
        label[order[min(max(half, 1), len(order) - 1) :]] = new
    return label
