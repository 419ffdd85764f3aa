"""Sparse regression over groups of columns: which terms the rows ask for, how surely, and whether parts of them agree.

Every model has the base columns (inertia, momentum at the start, sensor), marginalised. Models compare by Schwarz's
criterion with the noise marginalised (Kass and Wasserman 1995: the evidence under a prior that is worth one row), and pay
for each group they pick: all kinds of groups are equally likely, so are the groups of a kind and the subsets of a group's
terms. A beam of models grows group by group; needless terms leave, and groups are exchanged for others.
The probability of a term is the share of the models' evidence that holds it (Hoeting et al. 1999), and no more than how
often parts of the record, drawn in blocks of time, choose it (Meinshausen and Buhlmann 2010). The search in a part begins
with the models of the whole: by itself it misses some that are likelier than the one it ends at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from massprops.diagnosis import criteria

BEAM = 10
MOST_GROUPS = 4
BLOCKS = 20
DRAWS, KEPT = 16, 0.75
"""Of the blocks, to ask parts of the record one by one."""
SAME = 3
"""Models of the same kinds of terms in a beam."""
EXCHANGES = 6
"""Rounds in which groups of the best model are exchanged."""
LIKELIER_THAN_NOT = 0.5
WINDOW = 15.0
"""Log evidence behind the best model at which another no longer counts."""


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Rows, base columns and candidates as inner products by block of time.

    Attributes:
        G: (blocks, f + k + 1, f + k + 1) of base columns (over their prior), candidates and the rows; base: f.
        rows: numbers per block; noise_rows: as how many the stated noise counts.
        groups: columns of each group, as indices among the candidates; least: groups that may not be negative; kinds: of
            the groups, equal numbers for one kind.
    """

    G: np.ndarray
    base: int
    rows: np.ndarray
    noise_rows: float
    groups: tuple[tuple[int, ...], ...]
    least: tuple[bool, ...]
    kinds: tuple[int, ...]

    @cached_property
    def prices(self) -> np.ndarray:
        """(groups,) what each costs a model: the logarithm of kinds, groups of its kind, and subsets of its terms."""
        many = np.bincount(self.kinds)
        sizes = [len(g) for g in self.groups]
        subsets = np.log(2.0 ** np.array(sizes) - 1.0)
        return np.asarray(np.log(np.count_nonzero(many)) + np.log(many[list(self.kinds)]) + subsets)


@dataclass(frozen=True)
class Found:
    """A model: columns by index, its score, and the groups it came from."""

    columns: tuple[int, ...]
    score: float
    groups: tuple[int, ...] = ()


def regression_of(
    fixed: np.ndarray, sd: np.ndarray, candidates: np.ndarray, y: np.ndarray, noise_rows: float,
    groups: tuple[tuple[int, ...], ...], least: tuple[bool, ...], kinds: tuple[int, ...],
) -> Regression:  # fmt: skip
    """The inner products of rows over their noise, three numbers a row in time order.

    Args:
        fixed: (r, f) with prior sd (f,); candidates: (r, k); y: (r,).
    """
    A = np.concatenate([fixed * sd, candidates, y[:, None]], axis=1)
    block = np.minimum(np.arange(len(y)) // 3 * BLOCKS // (len(y) // 3), BLOCKS - 1)
    G = np.stack([A[block == b].T @ A[block == b] for b in range(BLOCKS)])
    rows = np.bincount(block, minlength=BLOCKS)
    return Regression(
        G=G, base=fixed.shape[1], rows=rows, noise_rows=noise_rows, groups=groups, least=least, kinds=kinds
    )


@dataclass(frozen=True)
class _Reduced:
    """Inner products (k + 1, k + 1) of candidates and rows once the base is marginalised; n numbers."""

    G: np.ndarray
    n: float
    noise_rows: float

    def score(self, columns: tuple[int, ...]) -> tuple[float, np.ndarray]:
        """Log evidence of a model, and its coefficients."""
        residual_square, x = float(self.G[-1, -1]), np.zeros(0)
        if columns:
            chosen = np.array(columns)
            M, b = self.G[np.ix_(chosen, chosen)], self.G[chosen, -1]
            scale = np.sqrt(np.maximum(np.diag(M), 1e-300))
            U = M / scale[:, None] / scale + 1e-9 * np.eye(len(chosen))
            x = np.linalg.solve(U, b / scale) / scale
            residual_square -= float(b @ x)
        count = self.n + self.noise_rows
        fit = -0.5 * count * np.log((max(residual_square, 0.0) + self.noise_rows) / count)
        return float(fit - 0.5 * len(columns) * np.log(self.n)), x


def _reduced(r: Regression, use: np.ndarray) -> _Reduced:
    G = r.G[use].sum(axis=0)
    f = r.base
    H = G[:f, :f] + np.eye(f)
    rest = G[f:, f:] - G[f:, :f] @ np.linalg.solve(H, G[:f, f:])
    return _Reduced(rest, float(r.rows[use].sum()), r.noise_rows)


def search(
    r: Regression, use: np.ndarray | None = None, known: Iterable[Found] = (), beam: int = BEAM, most: int = MOST_GROUPS
) -> list[Found]:
    """Models by their score, the best first, needless terms pruned; the empty model is among them.

    Args:
        use: the blocks of the record that count, a bool each; known: models to begin with beside those that grow.
    """
    reduced = _reduced(r, np.ones(len(r.rows), bool) if use is None else use)
    empty = Found((), reduced.score(())[0])
    seen: dict[tuple[int, ...], Found] = {(): empty}
    _keep(seen, [replace(m, score=_score(reduced, r, m.columns, m.groups)) for m in known if np.isfinite(m.score)])
    level = [empty]
    for _ in range(most):
        grown: dict[tuple[int, ...], Found] = {}
        for model in level:
            for g in range(len(r.groups)):
                if g in model.groups:
                    continue
                groups = tuple(sorted((*model.groups, g)))
                if groups not in grown:
                    grown[groups] = _whole(reduced, r, groups)
        best = _different(sorted(grown.values(), key=lambda m: -m.score), r, beam)
        pruned = [_pruned(reduced, r, m) for m in best]
        gained = max((m.score for m in pruned), default=-np.inf) > max(m.score for m in seen.values()) + 1e-9
        _keep(seen, pruned)
        level = best
        if not gained:
            break
    for _ in range(EXCHANGES):
        top = max(seen.values(), key=lambda m: m.score)
        others = sorted((_whole(reduced, r, g) for g in _exchanged(r, top)), key=lambda m: -m.score)
        pruned = [_pruned(reduced, r, m) for m in others[:beam]]
        _keep(seen, pruned)
        if max((m.score for m in pruned), default=-np.inf) <= top.score:
            break
    return sorted(seen.values(), key=lambda m: -m.score)


def _whole(reduced: _Reduced, r: Regression, groups: tuple[int, ...]) -> Found:
    """The model of all terms of some groups."""
    columns = tuple(c for k in groups for c in r.groups[k])
    return Found(columns, _score(reduced, r, columns, groups), groups)


def _score(reduced: _Reduced, r: Regression, columns: tuple[int, ...], groups: tuple[int, ...]) -> float:
    """Log evidence of a model less what its groups cost."""
    return reduced.score(columns)[0] - float(r.prices[list(groups)].sum())


def _keep(seen: dict[tuple[int, ...], Found], models: list[Found]) -> None:
    for m in models:
        if m.columns not in seen or m.score > seen[m.columns].score:
            seen[m.columns] = m


def _different(models: list[Found], r: Regression, beam: int) -> list[Found]:
    """The first of the models, no more than `SAME` of the same kinds: many moments near the best one crowd all else out."""
    count: dict[tuple[int, ...], int] = {}
    out = []
    for m in models:
        key = tuple(sorted(r.kinds[g] for g in m.groups))
        count[key] = count.get(key, 0) + 1
        if count[key] <= SAME:
            out.append(m)
        if len(out) == beam:
            break
    return out


def _exchanged(r: Regression, model: Found) -> list[tuple[int, ...]]:
    """The model's groups with one of them, or two of one kind, in exchange for any other."""
    outs: list[tuple[int, ...]] = [(g,) for g in model.groups]
    outs += [(a, b) for a, b in combinations(model.groups, 2) if r.kinds[a] == r.kinds[b]]
    every = [g for g in range(len(r.groups)) if g not in model.groups]
    return [tuple(sorted((*(k for k in model.groups if k not in out), g))) for out in outs for g in every]


def _pruned(reduced: _Reduced, r: Regression, model: Found) -> Found:
    """The model without the terms that it is better off without; worthless with a coefficient of the wrong sign."""
    columns, groups = list(model.columns), model.groups

    def value(c: list[int]) -> float:
        return _score(reduced, r, tuple(c), tuple(g for g in groups if set(r.groups[g]) & set(c)))

    score = value(columns)
    while len(columns) > 1:
        best, fewer = max(_without(columns, 1, value))
        if best <= score and len(columns) > 2:  # two terms may hold each other up
            best, fewer = max(_without(columns, 2, value))
        if best <= score:
            break
        score, columns = best, fewer
    kept = tuple(columns)
    x = reduced.score(kept)[1]
    for g in groups:
        for c, v in zip(kept, x, strict=True):
            if r.least[g] and c in r.groups[g] and v < 0:
                return Found(kept, -np.inf, groups)
    return Found(kept, score, tuple(g for g in groups if set(r.groups[g]) & set(kept)))


def _without(columns: list[int], count: int, value: Callable[[list[int]], float]) -> Iterator[tuple[float, list[int]]]:
    """Value of the columns without so many of them, and those left."""
    for out in combinations(columns, count):
        fewer = [c for c in columns if c not in out]
        yield value(fewer), fewer


def distinct(models: list[Found], alike: dict[int, int]) -> dict[frozenset[int], float]:
    """Score of each set of terms, the best first: of models that differ by moments alone, the best.

    Args:
        models: the best first. alike: columns that stand for another: one term, a little earlier or later.
    """
    out: dict[frozenset[int], float] = {}
    for m in models:
        out.setdefault(frozenset(alike.get(c, c) for c in m.columns), m.score)
    return out


def idle(r: Regression, columns: tuple[int, ...], chance: dict[int, float]) -> int | None:
    """The least likely term of a model where it is no more likely than not (the median model: Barbieri and Berger 2004) and
    the rows hardly ask for it; else None."""
    reduced = _reduced(r, np.ones(len(r.rows), bool))
    least = min(columns, key=lambda c: chance[c])
    if chance[least] > LIKELIER_THAN_NOT or len(columns) == 1:
        return None
    lost = reduced.score(columns)[0] - reduced.score(tuple(c for c in columns if c != least))[0]
    return least if lost < criteria.BEATS_NOTHING else None


def probabilities(r: Regression, models: list[Found], alike: dict[int, int] | None = None) -> dict[int, float]:
    """The probability of each column: its share of the evidence, bounded by how often parts of the record choose it.

    Args:
        models: of `search`. alike: see `distinct`.
    """
    alike = alike or {}
    apart = distinct(models, alike)
    weight = np.exp(np.array(list(apart.values())) - models[0].score)
    weight = np.where(weight > np.exp(-WINDOW), weight, 0.0)
    weight /= weight.sum()
    share: dict[int, float] = {}
    for terms, v in zip(apart, weight, strict=True):
        for c in terms:
            share[c] = share.get(c, 0.0) + float(v)
    rng = np.random.default_rng(0)
    chosen: dict[int, int] = {}
    for _ in range(DRAWS):
        use = np.zeros(len(r.rows), bool)
        use[rng.permutation(len(r.rows))[: round(KEPT * len(r.rows))]] = True
        for c in next(iter(distinct(search(r, use, models, most=len(models[0].groups) + 1), alike))):
            chosen[c] = chosen.get(c, 0) + 1
    # Laplace's rule: so many draws say no more than this
    by_kind = {c: min(p, (chosen.get(c, 0) + 1.0) / (DRAWS + 2.0)) for c, p in share.items()}
    return {c: by_kind.get(alike.get(c, c), 0.0) for m in models for c in m.columns}
