"""What the compiled filter is given: the state as one vector, and which errors and channels there are.

Sizes in its files: N errors, m features, c cameras; ny channels of an epoch, each in its own unit ([px], [px/s], [rad], [rad/s] or
[m]), and nu of them that are measured; nd leading errors (`leading`), and nf of them without the inertia's.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

INERTIA = 2
"""Numbers that stand for the inertia: k1, k2; `body_axes` has five."""
RATE, ATTITUDE, RATIO, AXES, POSITION, VELOCITY, POINTS = 0, 3, 7, 9, 13, 16, 19
"""Where the state vector x (19 + 3 m,) has rates w 3, attitude q 4, ratios k 2, axes 4, position r 3, velocity v 3 and the
features, 3 each."""

Turn: TypeAlias = tuple[float, float, float, float]
"""Components of a quaternion."""
Carried: TypeAlias = tuple[float, float, float, float, float, float, float]
"""Rates 3 [rad/s] and attitude 4."""
Step: TypeAlias = tuple[float, np.ndarray]
"""dt [s], and the chaser over it (10,) as of `Steps`."""


class Rule(NamedTuple):
    """additive, axes_free, moving: which errors there are, as of `state.State` and `state.Settings`; attitude, rates,
    range: rows of these channels (3, 3, 1, or 0); disparity, flow: as of `state.Measurements`; gamma: distance of the sigma
    points in standard deviations; excess: weight of the mean's square in a covariance; gate [sigma]; largest_turn [rad];
    rounds: of linearisation in an update, 0 for the unscented one."""

    additive: bool
    axes_free: bool
    moving: bool
    attitude: int
    rates: int
    range: int
    disparity: bool
    flow: bool
    gamma: float
    excess: float
    gate: float
    largest_turn: float
    rounds: int


class Steps(NamedTuple):
    """dt: (n,) [s]; F: (n, 6, 6) of position and velocity; spin: (n, 4) on the left of q; noise: (N,) a second; chaser:
    (n, 10) its place from the planet's centre at the beginning, middle and end of a step, in its axes at the beginning [m],
    and mu [m^3/s^2]."""

    dt: np.ndarray
    F: np.ndarray
    spin: np.ndarray
    noise: np.ndarray
    chaser: np.ndarray


class Seen(NamedTuple):
    """z, variance: (n, ny); attitude: (n, 4); place: (n, 3) of the centre of mass where features are measured as if it
    stood still there, NaN elsewhere; eyes: (c, 16) fu fv cu cv, R and t of each camera; group: (ny,)."""

    z: np.ndarray
    variance: np.ndarray
    attitude: np.ndarray
    place: np.ndarray
    eyes: np.ndarray
    group: np.ndarray


class Record(NamedTuple):
    """Written at each epoch: mean (n, 19), sigma (n, N), block (n, b, b) of the leading errors, tally (n, 3): normalised
    innovation squared, used, gated."""

    mean: np.ndarray
    sigma: np.ndarray
    block: np.ndarray
    tally: np.ndarray


def leading(rule: Rule) -> int:
    """Errors of rates, attitude and inertia: those whose motion is not linear."""
    return (7 if rule.additive else 6) + INERTIA


def place_error(rule: Rule) -> int:
    """The first error of the position, whether there is one or not."""
    return leading(rule) + (3 if rule.axes_free else 0)


def point_error(rule: Rule) -> int:
    """The first error of the first feature."""
    return place_error(rule) + (6 if rule.moving else 0)


def ahead(rule: Rule) -> int:
    """Rows of measurements before the features'."""
    return rule.attitude + rule.rates + rule.range


def per_feature(cameras: int, rule: Rule) -> int:
    """Rows of one feature."""
    return 2 * cameras * (2 if rule.flow else 1) + (1 if rule.disparity else 0)
