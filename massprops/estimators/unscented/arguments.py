"""What the compiled filter is given and what it writes, as tuples of arrays; see `state` for units and frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Quaternion = tuple[float, float, float, float]


class Moving(NamedTuple):
    """The state, changed in place. Fields as of `State`."""

    w: np.ndarray
    q: np.ndarray
    k: np.ndarray
    axes: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    features: np.ndarray
    P: np.ndarray


class Epochs(NamedTuple):
    """What differs from epoch to epoch, fields as of `Measurements`; attitude and pinned are always there."""

    dt: np.ndarray
    transition: np.ndarray
    spin: np.ndarray
    z: np.ndarray
    variance: np.ndarray
    attitude: np.ndarray
    pinned: np.ndarray


class Channels(NamedTuple):
    """How measurements follow from a state: c cameras' lens (c, 4), turn (c, 3, 3) and shift (c, 3); the group of each
    measurement (ny,); channels of attitude, rates and range; the rest as of `Measurements`."""

    lens: np.ndarray
    turn: np.ndarray
    shift: np.ndarray
    group: np.ndarray
    reference: np.ndarray
    disparity: bool
    flow: bool
    extras: tuple[int, int, int]


class Rule(NamedTuple):
    """Numbers of the filter.

    Attributes:
        noise: (N,) process noise per second. gamma: distance of the sigma points. excess: of the first one's weight.
        gate, largest_turn, additive: as of `Settings`; axes, moving: whether they are in the error.
    """

    noise: np.ndarray
    gamma: float
    excess: float
    gate: float
    largest_turn: float
    additive: bool
    axes: bool
    moving: bool


class Record(NamedTuple):
    """What is noted of each epoch: mean (n, 19), sigma (n, N), leading block (n, b, b), tally (n, 3): normalised
    innovation squared, used, gated."""

    mean: np.ndarray
    sigma: np.ndarray
    block: np.ndarray
    tally: np.ndarray


class Residual(NamedTuple):
    """Innovations of an epoch, the sigma points' mean offset, their own variance and the noise, (nu,) each."""

    value: np.ndarray
    mean: np.ndarray
    spread: np.ndarray
    noise: np.ndarray
