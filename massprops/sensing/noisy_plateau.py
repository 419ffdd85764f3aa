"""Whether a gyroscope's axis ends at its range with noise on top, so that no two samples need be equal.

Rates of a body that turns are smooth: into an extreme and out of it they bend. A range that ends cuts them off: samples of one mean follow
each other, with a corner on either side. Both are asked at each corner, of the same samples: a polynomial against a parabola that ends in
the constant, by what they leave. A wheel that is driven, held and let go makes such a plateau as well, but hardly twice at one level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.errors import NotPossible

BY_CHANCE = 1e-9
"""Chance of such corners in smooth rates, below which they are the range's."""
FEWEST = 8
"""Samples of a plateau that are looked at."""
AVERAGED = 5
"""Samples over which rates are averaged to find where a plateau ends."""
SIDES = (6, 9, 14, 22, 35, 55, 90, 140)
"""Samples on either side of a corner that are tried: more show a smaller corner, fewer a body that turns fast."""
LONGEST = 1.0
"""Turn of the body [rad] over one side up to which its rates are the polynomial's."""
TERMS = 6
"""Of that polynomial: over 1 rad on either side it leaves less than a hundredth of what rates change by."""
TWICE = 2
"""Plateaus at one level that are asked for."""
ONE_LEVEL = 0.01
"""Part by which levels of the largest and of the smallest rate may differ where they are one range's."""
FAR = 4.0
"""Sigmas within which a plateau keeps its mean, its slope and its bend are none, and its ends are found."""
LEFT = 1.5
"""Rms over the noise that a corner may leave where it explains the samples."""
SHIFTS = np.arange(-3.0, 3.01, 0.25)
"""Where a corner is looked for, in samples from the plateau's end."""


@dataclass(frozen=True, kw_only=True)
class _Plateau:
    """Samples `begins` up to before `ends` of an axis at one level [rad/s]; odds: by how much corners are likelier than smooth rates, in
    log likelihood."""

    axis: str
    level: float
    begins: int
    ends: int
    odds: float


def refuse_plateaus(times: np.ndarray, w: np.ndarray, noise: np.ndarray) -> None:
    """Refuses rates (n, 3) [rad/s] at times (n,) [s] with plateaus at one level, the range of all axes and to both sides; noise: (3,)
    1-sigma of a sample, 0 where it is not known.

    Raises:
        NotPossible: naming the axis of the longest, the level and when.
    """
    if len(w) < 4 * FEWEST:
        return
    turn = float(np.max(np.linalg.norm(w, axis=1)) * np.median(np.diff(times)))
    sides = [n for n in SIDES if n * turn < LONGEST]
    every = [
        p
        for axis, values, sd in zip("xyz", w.T, noise, strict=True)
        for sign in (1.0, -1.0)
        for p in (_plateaus(axis, sign, values, float(sd), sides) if sd > 0.0 and sides else [])
    ]
    for one in every:
        alike = [p for p in every if abs(abs(p.level) - abs(one.level)) < ONE_LEVEL * abs(one.level)]
        if len(alike) >= TWICE and sum(p.odds for p in alike) > -np.log(BY_CHANCE):
            longest = max(alike, key=lambda p: p.ends - p.begins)
            raise NotPossible(
                f"imu0: the rate about {longest.axis} stays at {longest.level:.6g} rad/s from {times[longest.begins]:.4g} to "
                f"{times[longest.ends - 1]:.4g} s, one of {len(alike)} such plateaus that begin and end with a corner: the gyroscope is at "
                "the end of its range. Cut the record there, or record with a wider range"
            )


def _plateaus(axis: str, sign: float, values: np.ndarray, noise: float, sides: list[int]) -> list[_Plateau]:
    """The rows of samples at the largest rate of an axis, or at the smallest, that have two corners."""
    level, runs = _runs(sign * values, noise)
    out = []
    for begins, ends in runs:
        odds = _corners(sign * values, level, (begins, ends), noise, sides)
        if odds > 0.0:
            out.append(_Plateau(axis=axis, level=sign * level, begins=begins, ends=ends, odds=odds))
    return out


def _runs(values: np.ndarray, noise: float) -> tuple[float, list[tuple[int, int]]]:
    """The largest mean of a few samples, and first and one past the last of the rows that stay at it and keep it."""
    means = np.convolve(values, np.ones(FEWEST) / FEWEST, "valid")
    at = int(np.argmax(means))
    level = float(means[at])
    near = np.convolve(values, np.ones(AVERAGED) / AVERAGED, "valid") > level - 2.0 * FAR * noise / np.sqrt(AVERAGED)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int))).reshape(-1, 2)
    rows = [(int(a), int(b) + AVERAGED - 1) for a, b in edges if b - a + AVERAGED - 1 >= FEWEST]
    longest = max(rows, key=lambda r: r[1] - r[0], default=None)
    if longest is None:
        return level, []
    level = float(np.median(values[slice(*longest)]))
    rows = [_trimmed(values, level, row, noise) for row in rows]
    return level, [r for r in rows if r[1] - r[0] >= FEWEST and _is_flat(values[slice(*r)], level, noise)]


def _trimmed(values: np.ndarray, level: float, row: tuple[int, int], noise: float) -> tuple[int, int]:
    """A row without the ends that lie below its level."""
    within = np.flatnonzero(values[slice(*row)] > level - 3.0 * noise)
    return (row[0] + int(within[0]), row[0] + int(within[-1]) + 1) if len(within) else (row[0], row[0])


def _is_flat(values: np.ndarray, level: float, noise: float) -> bool:
    """Whether samples keep a mean, with no slope and no bend beyond their noise."""
    inside = values[1:-1]
    x = np.linspace(-1.0, 1.0, len(inside))
    X = np.linalg.qr(np.stack([np.ones_like(x), x, x**2], axis=1))[0]
    told = X.T @ (inside - level)
    mean = abs(float(np.mean(inside)) - level) < FAR * noise * np.sqrt(2.0 / len(inside))
    return bool(mean and (np.abs(told[1:]) < FAR * noise).all() and np.abs(inside - level).max() < 1.5 * FAR * noise)


def _corners(values: np.ndarray, level: float, run: tuple[int, int], noise: float, sides: list[int]) -> float:
    """By how much a plateau with corners is likelier than smooth rates, in log likelihood; 0 where an end of it is no corner."""
    begins, ends = run
    left = _corner(values[:ends], begins, level, noise, sides)
    right = _corner(values[begins:][::-1], len(values) - ends, level, noise, sides)
    return left + right if min(left, right) > 0.0 else 0.0


def _corner(values: np.ndarray, at: int, level: float, noise: float, sides: list[int]) -> float:
    """The best over widths of the log likelihood of a parabola that rises to a constant at sample `at`, over a polynomial's."""
    best = 0.0
    for side in sides:
        inside = min(side, len(values) - at)
        if at < side or inside < FEWEST // 2:
            continue
        window = values[at - side : at + inside] - level
        t = np.arange(-side, inside, dtype=float)
        X = np.linalg.qr(np.stack([t**k for k in range(TERMS)], axis=1) / float(side) ** np.arange(TERMS))[0]
        smooth = float(np.sum((window - X @ (X.T @ window)) ** 2))
        cut = min(_cut(window, t, shift) for shift in SHIFTS)
        if cut < LEFT**2 * noise**2 * len(window):
            best = max(best, 0.5 * len(window) * np.log(smooth / max(cut, 1e-300)))
    return best


def _cut(own: np.ndarray, t: np.ndarray, corner: float) -> float:
    """Sum of squares left by a parabola that rises to 0 at a corner and stays there; infinite if it does not rise."""
    before = np.minimum(t - corner, 0.0)
    X = np.stack([before, before**2], axis=1)
    x = np.linalg.lstsq(X, own, rcond=None)[0]
    return float(np.sum((own - X @ x) ** 2)) if x[0] > 0.0 else np.inf
