"""Linear models with Gaussian blocks: their unknowns, and the marginal likelihood that each pays its freedom with.

Rows y = sum over blocks of C_k u_k + e, e of unit variance times a noise factor. A block's unknowns are normal with a
standard deviation that is given (`fixed`), that is one number found by evidence (`common`: MacKay 1992), or that is one
number for each unknown, drawn from a common heavy-tailed law (`sparse`: Student's t with one degree, as a scale mixture:
Tipping 2001). All are found together by expectation maximisation; the value returned is the marginal likelihood, for
sparse blocks its variational lower bound. Everything works on inner products, so rows are touched once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log
from typing import Literal

import numpy as np

from massprops.core.linalg import consecutive

DEGREES = 1.0
"""Of Student's law for sparse unknowns: Cauchy's, the customary choice for rare steps among many small ones."""
STEPS = 60
SMALL_GAIN, SPARSE_GAIN = 0.02, 0.005
"""Rise of the log evidence in a step at which the search for the sizes ends, and where there are sparse blocks."""
WIDE = 60
"""Unknowns of one size from which on these are set apart: as many as a latent torque has, not as an effect."""
FARTHEST = 3.0
"""Of a logarithm of a size, ahead of two steps."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """Unknowns that share a prior.

    Attributes:
        name: of the block; columns: (r, k) rows of a unit of each, over the noise; sd: (k,) or one number, where a
            search for them begins, or as it stays when `kind` is `fixed`. own: how many of a `sparse` block's unknowns, the first ones,
            have laws of their own, whose scales stay: `sd`.
    """

    name: str
    columns: np.ndarray
    sd: np.ndarray | float
    kind: Literal["fixed", "common", "sparse"] = "fixed"
    own: int = 0

    @property
    def count(self) -> int:
        return int(self.columns.shape[1])


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """What the rows say of all blocks.

    Attributes:
        evidence: log marginal likelihood of the rows over their noise.
        mean, covariance: of the unknowns by block; joint: (k, k) covariance of all, in the order of the blocks; sd: their prior
            standard deviations; noise: (g,) factors on the noise.
        residual: (r,) rows less what the unknowns explain, over the noise given.
    """

    evidence: float
    mean: dict[str, np.ndarray]
    covariance: dict[str, np.ndarray]
    joint: np.ndarray
    sd: dict[str, np.ndarray]
    noise: np.ndarray
    residual: np.ndarray

    @property
    def whole(self) -> np.ndarray:
        """(k,) the likeliest unknowns of all blocks."""
        return np.concatenate(list(self.mean.values()))

    @property
    def places(self) -> dict[str, slice]:
        """Where each block's unknowns stand among all."""
        return dict(zip(self.mean, consecutive(map(len, self.mean.values())), strict=True))

    def by_block(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """Numbers (k,) of all unknowns, by block."""
        return {name: values[place] for name, place in self.places.items()}

    def shifts(self, change: np.ndarray, at: np.ndarray) -> dict[str, np.ndarray]:
        """By how much the likeliest values of all unknowns move, by block, with a change (f,) of those at places (f,) of all."""
        return self.by_block(self.joint[:, at] @ np.linalg.solve(self.joint[np.ix_(at, at)], change))

    def square(self, change: np.ndarray, at: np.ndarray) -> float:
        """A change (f,) of the unknowns at places (f,) over their covariance, squared."""
        return float(change @ np.linalg.solve(self.joint[np.ix_(at, at)], change))

    def moved(self, change: np.ndarray, at: np.ndarray, blocks: list[Block]) -> Posterior:
        """The likeliest unknowns with those at places (f,) moved away from theirs by a change (f,), and what that costs; spreads
        stay."""
        shift = self.shifts(change, at)
        lost = np.add.reduce([b.columns @ shift[b.name] for b in blocks])
        return replace(
            self,
            evidence=self.evidence - 0.5 * self.square(change, at),
            mean={name: m + shift[name] for name, m in self.mean.items()},
            residual=self.residual - lost,
        )


@dataclass(frozen=True, kw_only=True)
class _Rows:
    """The rows as inner products, by noise factor.

    Attributes:
        X: (r, k) columns of all blocks; y: (r,); groups: which rows have each factor; G: (g, k, k) and by: (g, k) of each
            group's columns with themselves and with y; n: (g,) rows of each.
    """

    X: np.ndarray
    y: np.ndarray
    groups: list[np.ndarray | slice]
    G: np.ndarray
    by: np.ndarray
    n: np.ndarray


def _rows(blocks: list[Block], y: np.ndarray, group: np.ndarray | None) -> _Rows:
    X = np.concatenate([b.columns for b in blocks], axis=1)
    group = np.zeros(len(y), int) if group is None else group
    groups: list[np.ndarray | slice] = [np.flatnonzero(group == g) for g in range(int(group.max()) + 1)]
    if len(groups) == 1:
        groups = [slice(None)]  # no copy of the columns
    G, by = (
        np.stack([X[of_group].T @ X[of_group] for of_group in groups]),
        np.stack([X[of_group].T @ y[of_group] for of_group in groups]),
    )
    if not np.isfinite(G).all():
        raise FloatingPointError("the columns leave all bounds")
    return _Rows(X=X, y=y, groups=groups, G=G, by=by, n=np.array([len(y[of_group]) for of_group in groups]))


def solve(
    blocks: list[Block],
    y: np.ndarray,
    noise_rows: float,
    group: np.ndarray | None = None,
    steps: int = STEPS,
    noise: np.ndarray | None = None,
) -> Posterior:
    """Unknowns, sizes and noise of a linear model by expectation maximisation.

    Args:
        y: (r,) rows over the noise given; noise_rows: as how many rows that noise counts against the data's own word:
            the prior of a noise factor is inverse gamma about 1. group: (r,) which factor a row has, 0 to g - 1; noise: (g,) where the search for the
            factors begins.

    Raises:
        FloatingPointError, numpy.linalg.LinAlgError: the numbers leave all bounds.
    """
    search = _Search(_rows(blocks, y, group), blocks, noise_rows)
    best = _searched(search, search.begun(noise), steps)
    at, sd = best.sizes[: search.count], best.moved[: search.count]
    factor = (
        best.factor if best.factor is not None else _unknowns(search.rows, at, best.sizes[-len(search.rows.n) :])[3]
    )
    covariance = _covariance(factor, at)
    return Posterior(
        evidence=best.evidence,
        mean={b.name: best.mean[p] for b, p in search.places},
        covariance={b.name: covariance[p, p] for b, p in search.places},
        joint=covariance,
        sd={b.name: sd[p].copy() for b, p in search.places},
        noise=best.moved[-len(search.rows.n) :],
        residual=y - search.rows.X @ best.mean,
    )


def _searched(search: _Search, sizes: np.ndarray, steps: int) -> _Step:
    """The last step of a search from sizes (s,).

    Raises:
        FloatingPointError, numpy.linalg.LinAlgError: the numbers leave all bounds.
    """
    if search.plain:
        return search.by_kernel(sizes, steps)
    enough = SPARSE_GAIN if search.sparse else SMALL_GAIN
    best: _Step | None = None
    path: list[np.ndarray] = []
    for _ in range(steps):
        step = search.step(sizes)
        gain = np.inf if best is None else step.evidence - best.evidence
        if search.sparse and gain < -enough:  # too far: on from where the steps themselves led
            assert best is not None
            sizes, path = best.moved, []
            continue
        best = step
        if path and abs(gain) < enough:  # not ahead of two steps: there it may be small by chance
            break
        path = [*path[-1:], sizes]
        sizes = step.moved
        if search.sparse and len(path) == 2:
            sizes, path = _ahead(path[0], path[1], sizes), []
    assert best is not None
    return best


def _ahead(first: np.ndarray, second: np.ndarray, third: np.ndarray) -> np.ndarray:
    """Sizes (s,) ahead of three that steps of expectation maximisation led to, one after the other: in their logarithms, by the
    length that the change from step to step suggests (SQUAREM, scheme 3: Varadhan and Roland 2008). What a wheel does not need goes
    to nothing so slowly that the steps alone end up to ten short in log evidence."""
    step = np.log(second / first)
    change = np.log(third / second) - step
    length = max(1.0, float(np.linalg.norm(step)) / max(float(np.linalg.norm(change)), 1e-300))
    return np.asarray(first * np.exp(np.clip(2.0 * length * step + length**2 * change, -FARTHEST, FARTHEST)))


@dataclass(frozen=True)
class _Step:
    """A step of expectation maximisation. evidence, mean (k,), factor (k, k) or None: at sizes (s,); moved: (s,) sizes that it leads to."""

    evidence: float
    mean: np.ndarray
    factor: np.ndarray | None
    sizes: np.ndarray
    moved: np.ndarray


class _Search:
    """The search for sizes (s,): prior sd of all unknowns, the scale of each sparse block, and the noise factors (g,).

    Attributes:
        places: each block with the unknowns that are its.
    """

    def __init__(self, rows: _Rows, blocks: list[Block], noise_rows: float) -> None:
        self.places = list(zip(blocks, consecutive(b.count for b in blocks), strict=True))
        self.rows, self.noise_rows, self.count = rows, noise_rows, self.places[-1][1].stop
        self.sparse = [b.name for b in blocks if b.kind == "sparse"]
        self.squares: _Squares | None = None
        wide = [p for b, p in self.places if b.kind == "common" and b.count >= WIDE]
        self.wide = _Wide(rows.G[0], rows.by[0], wide[0]) if wide and len(rows.G) == 1 else None
        self.plain = not (wide or self.sparse) and len(rows.G) == 1

    def begun(self, noise: np.ndarray | None) -> np.ndarray:
        """(s,) the sizes that the blocks begin with."""
        sd = np.concatenate([np.broadcast_to(np.asarray(b.sd, float), b.count) for b, _ in self.places])
        scale = [float(np.mean(sd[p][b.own :] ** -2) ** -0.5) for b, p in self.places if b.kind == "sparse"]
        return np.concatenate([sd, scale, np.ones(len(self.rows.n)) if noise is None else noise])

    def by_kernel(self, sizes: np.ndarray, steps: int) -> _Step:
        """The last step of a `plain` search, one factor of the noise and no block that is sparse or wide, from sizes (s,).

        Raises:
            FloatingPointError: the numbers leave all bounds.
        """
        from massprops.diagnosis.size_kernel import searched

        rows, block = self.rows, np.full(self.count, -1)
        for number, (_, place) in enumerate((b, p) for b, p in self.places if b.kind == "common"):
            block[place] = number
        finite, evidence, mean, at, moved, factor = searched(
            rows.X, rows.y, rows.G[0], rows.by[0], block, sizes, float(self.noise_rows), steps, SMALL_GAIN
        )
        if not finite:
            raise FloatingPointError("the unknowns leave all bounds")
        return _Step(evidence, mean, factor, at, moved)

    def step(self, sizes: np.ndarray) -> _Step:
        """The unknowns and the evidence at sizes (s,), and where these move.

        Raises:
            FloatingPointError, numpy.linalg.LinAlgError: the numbers leave all bounds.
        """
        rows, believed = self.rows, self.noise_rows
        at, scale, noise = np.split(sizes, [self.count, self.count + len(self.sparse)])
        factor = None
        if self.wide is None:
            mean, variance, taken, factor = _unknowns(rows, at, noise)
            size = float(np.log(factor.diagonal()).sum())
        else:
            mean, variance, taken, size = self.wide.unknowns(at, float(noise[0]))
        self.squares = self.squares or _Squares.about(rows, mean)
        squares = self.squares.of(rows, mean)
        over = mean / at
        evidence = -0.5 * float(over @ over) - size
        for n, s, square in zip(rows.n.tolist(), noise.tolist(), squares.tolist(), strict=True):
            evidence -= (n + believed) * log(s) + 0.5 * (square + believed) / s**2 - 0.5 * believed
        moved, scales = at.copy(), dict(zip(self.sparse, scale.tolist(), strict=True))
        evidence += _moved_sizes(self.places, moved, scales, mean**2 + variance)
        noise = np.sqrt((squares + taken + believed) / (rows.n + believed))
        if not np.isfinite(evidence) or not np.isfinite(moved).all():
            raise FloatingPointError("the unknowns leave all bounds")
        return _Step(evidence, mean, factor, sizes, np.concatenate([moved, list(scales.values()), noise]))


class _Wide:
    """The unknowns of one noise factor where a wide block has a single size: along the axes of that block's own inner products, each of
    its unknowns is solved for by a division, which leaves a system of the others."""

    def __init__(self, G: np.ndarray, by: np.ndarray, own: slice) -> None:
        """G: (k, k) and by: (k,) inner products of all columns with themselves and with the rows; own: the wide block's."""
        rest = np.r_[: own.start, own.stop : len(by)]
        self.own, self.rest = own, rest
        value, self.axes = np.linalg.eigh(G[own, own])
        self.value = np.maximum(value, 0.0)
        self.across, self.by = self.axes.T @ G[own][:, rest], self.axes.T @ by[own]
        self.G, self.by_rest = G[np.ix_(rest, rest)], by[rest]

    def unknowns(self, sd: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray, float, float]:
        """As `_unknowns`, but the wide block's variances are their mean, and half the logarithm of the determinant stands in
        place of the factor."""
        from scipy.linalg.lapack import dpotrf, dpotrs, dtrtri

        size, r, over = float(sd[self.own.start]), sd[self.rest], noise**-2
        diagonal = 1.0 + size**2 * over * self.value
        across = (size * over) * self.across * r
        part = across / diagonal[:, None]
        whole = over * r[:, None] * self.G * r - across.T @ part
        whole[np.diag_indices(len(r))] += 1.0
        factor, failed = dpotrf(whole, lower=1)
        if failed:
            raise np.linalg.LinAlgError("the precision of the unknowns is not positive definite")
        y = (size * over) * self.by
        x = dpotrs(factor, over * r * self.by_rest - part.T @ y, lower=1)[0]
        inverse = dtrtri(factor, lower=1)[0]
        share, wide = (
            np.einsum("ij,ij->j", inverse, inverse),
            float(np.sum(1.0 / diagonal) + np.sum((part @ inverse.T) ** 2)),
        )
        mean, variance = np.empty(len(sd)), np.empty(len(sd))
        mean[self.rest], mean[self.own] = r * x, size * (self.axes @ ((y - across @ x) / diagonal))
        variance[self.rest], variance[self.own] = r**2 * share, size**2 * wide / len(y)
        taken = noise**2 * (len(sd) - float(share.sum()) - wide)
        return mean, variance, taken, float(np.log(factor.diagonal()).sum() + 0.5 * np.log(diagonal).sum())


@dataclass(frozen=True)
class _Squares:
    """The rows' squared residuals about unknowns mean (k,): squares (g,) there, by: (g, k) of each group's columns with them. So the
    rows are not touched again, and no large numbers stand against each other."""

    mean: np.ndarray
    squares: np.ndarray
    by: np.ndarray

    @staticmethod
    def about(rows: _Rows, mean: np.ndarray) -> _Squares:
        residual = rows.y - rows.X @ mean
        by_group = [residual[group] for group in rows.groups]
        by = np.stack(
            [rows.X[group].T @ group_residual for group, group_residual in zip(rows.groups, by_group, strict=True)]
        )
        return _Squares(mean, np.array([float(group_residual @ group_residual) for group_residual in by_group]), by)

    def of(self, rows: _Rows, mean: np.ndarray) -> np.ndarray:
        """(g,) at other unknowns (k,)."""
        d = mean - self.mean
        return np.maximum(self.squares + (rows.G @ d - 2.0 * self.by) @ d, 0.0)


def _unknowns(rows: _Rows, sd: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean (k,) and variance (k,) of the unknowns under prior sd (k,) and noise factors (g,), what of each group's squared
    residual they took up (g,), expectation maximisation's second moment, and the Cholesky factor (k, k) of their precision
    over the prior's."""
    from scipy.linalg.lapack import dpotrf, dpotrs, dtrtri

    G, by = rows.G[0] / noise[0] ** 2, rows.by[0] / noise[0] ** 2
    for gram, across, s in zip(rows.G[1:], rows.by[1:], noise[1:].tolist(), strict=True):
        G += gram / s**2
        by += across / s**2
    whole = sd[:, None] * G * sd
    whole.flat[:: len(sd) + 1] += 1.0
    if not np.isfinite(whole).all():
        raise FloatingPointError("the unknowns leave all bounds")
    # LAPACK itself: solved tens of thousands of times, mostly for a few unknowns
    factor, failed = dpotrf(whole, lower=1)
    if failed:
        raise np.linalg.LinAlgError("the precision of the unknowns is not positive definite")
    mean = sd * dpotrs(factor, sd * by, lower=1)[0]
    if len(rows.groups) == 1:
        # the variances alone: with one noise factor the trace of covariance and G follows from them
        inverse = dtrtri(factor, lower=1)[0]
        share = np.einsum("ij,ij->j", inverse, inverse)
        return mean, sd**2 * share, noise**2 * float(np.sum(1.0 - share)), factor
    covariance = _covariance(factor, sd)
    return mean, covariance.diagonal(), (rows.G * covariance).reshape(len(noise), -1).sum(axis=1), factor


def _covariance(factor: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """(k, k) of the unknowns, from the Cholesky factor (k, k) of their precision over that of the prior sd (k,)."""
    from scipy.linalg.lapack import dpotri

    half = dpotri(factor, lower=1)[0]
    whole = half + half.T
    whole.flat[:: len(sd) + 1] *= 0.5
    return sd[:, None] * whole * sd


def _moved_sizes(
    places: list[tuple[Block, slice]], sd: np.ndarray, scale: dict[str, float], second: np.ndarray
) -> float:
    """Moves the sizes `sd` (k,) and `scale` of common and sparse blocks, in place, to what the unknowns' second moments
    (k,) say; what sparse blocks add to the evidence before that."""
    from massprops.diagnosis.size_kernel import sparse_moved

    gained = 0.0
    for block, place in places:
        if block.kind == "common":
            sd[place] = np.sqrt(max(float(np.mean(second[place])), 1e-24))
        elif block.kind == "sparse":
            fixed = np.array(np.broadcast_to(np.asarray(block.sd, float), block.count)[: block.own])
            more, scale[block.name] = sparse_moved(sd[place], second[place], fixed, scale[block.name], DEGREES)
            gained += more
    return gained


def reduced(fixed: np.ndarray, sd: np.ndarray, columns: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inner products (k, k) and (k,) of columns (r, k) with themselves and with rows y (r,), once `fixed` columns (r, f)
    with prior sd (f,) have been marginalised."""
    A = fixed * sd
    H = A.T @ A + np.eye(len(sd))
    across = A.T @ columns
    solved = np.linalg.solve(H, np.column_stack([across, A.T @ y]))
    return columns.T @ columns - across.T @ solved[:, :-1], columns.T @ y - across.T @ solved[:, -1]
