"""What a sigma point would measure, as plain loops, to be compiled by numba; see `correction`."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import product, to_body, turn_between
from massprops.estimators.filters.components import feature_motion, image
from massprops.estimators.filters.rule import AXES, POINTS, POSITION, VELOCITY, Rule, Turn, ahead, per_feature


def axes_in_reference(x: np.ndarray) -> Turn:
    """The attitude of the measured body frame in a state x (19 + 3 m,)."""
    return product(x[3], x[4], x[5], x[6], x[AXES], x[AXES + 1], x[AXES + 2], x[AXES + 3])


def sight_of_sensors(h: np.ndarray, x: np.ndarray, mid: Turn, rule: Rule) -> None:
    """Predicted attitude, as a turn from mid [rad], rates [rad/s] and range [m] of x (POINTS + 3 m,), into h (ny,)."""
    o = 0
    if rule.attitude:
        s = axes_in_reference(x)
        a = turn_between(mid[0], mid[1], mid[2], mid[3], s[0], s[1], s[2], s[3])
        h[0], h[1], h[2] = a[0], a[1], a[2]
        o = 3
    if rule.rates:
        a = to_body(x[AXES], x[AXES + 1], x[AXES + 2], x[AXES + 3], x[0], x[1], x[2])
        h[o], h[o + 1], h[o + 2] = a[0], a[1], a[2]
        o += 3
    if rule.range:
        h[o] = np.sqrt(x[POSITION] ** 2 + x[POSITION + 1] ** 2 + x[POSITION + 2] ** 2)


def sight(
    h: np.ndarray, used: np.ndarray, first: int, x: np.ndarray, eyes: np.ndarray, mid: Turn, still: bool, rule: Rule
) -> None:
    """Predicted measurements from feature `first` on (and the sensors' when it is 0), into h (ny,).

    used: (m,) features that are measured; x: (POINTS + 3 m,); eyes: (c, 16) cameras; mid, still: as of `correction.sigma_rows`.
    """
    if first == 0 and ahead(rule) > 0:
        sight_of_sensors(h, x, mid, rule)
    cams, flow, disparity = eyes.shape[0], rule.flow, rule.disparity
    per = per_feature(cams, rule)
    for i in range(first, used.shape[0]):
        if not used[i]:
            continue
        o, p = ahead(rule) + per * i, POINTS + 3 * i
        a, b, d, da, db, dd = feature_motion(x[3], x[4], x[5], x[6], x[0], x[1], x[2], x[p], x[p + 1], x[p + 2])
        if not still:
            da, db, dd = da + x[VELOCITY], db + x[VELOCITY + 1], dd + x[VELOCITY + 2]
        a, b, d = a + x[POSITION], b + x[POSITION + 1], d + x[POSITION + 2]
        for c in range(cams):
            seen = image(eyes, c, a, b, d, da, db, dd)
            h[o + 2 * c], h[o + 2 * c + 1] = seen[0], seen[1]
            if flow:
                f = o + 2 * cams + (1 if disparity else 0) + 2 * c
                h[f], h[f + 1] = seen[2], seen[3]
        if disparity:
            h[o + 2 * cams] = h[o + 2] - h[o]
