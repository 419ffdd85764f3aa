"""Sparse regression over groups of columns: which terms the rows ask for, how surely, and whether parts of them agree.

Every model has the base columns (inertia, momentum at the start, sensor), marginalised. Models compare by Schwarz's
criterion with the noise marginalised (Kass and Wasserman 1995: the evidence under a prior that is worth one row), and pay
for each group they pick the logarithm of how many subsets of terms the library's groups offer. A beam of models grows group by group; needless terms leave.
The probability of a term is the share of the models' evidence that holds it (Hoeting et al. 1999), and no more than how
often parts of the record, drawn in blocks of time, choose it by themselves (Meinshausen and Buhlmann 2010).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BEAM = 10
MOST_GROUPS = 4
BLOCKS = 20
DRAWS, KEPT = 16, 0.75
"""Of the blocks, to ask parts of the record one by one."""
WINDOW = 15.0
"""Log evidence behind the best model at which another no longer counts."""


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Rows, base columns and candidates as inner products by block of time.

    Attributes:
        G: (blocks, f + k + 1, f + k + 1) of base columns (over their prior), candidates and the rows; base: f.
        rows: numbers per block; noise_rows: as how many the stated noise counts.
        groups: columns of each group, as indices among the candidates; least: groups that may not be negative.
    """

    G: np.ndarray
    base: int
    rows: np.ndarray
    noise_rows: float
    groups: tuple[tuple[int, ...], ...]
    least: tuple[bool, ...]


@dataclass(frozen=True)
class Found:
    """A model: columns by index, its score, and the groups it came from."""

    columns: tuple[int, ...]
    score: float
    groups: tuple[int, ...] = ()


def regression_of(
    fixed: np.ndarray, sd: np.ndarray, candidates: np.ndarray, y: np.ndarray, noise_rows: float,
    groups: tuple[tuple[int, ...], ...], least: tuple[bool, ...],
) -> Regression:  # fmt: skip
    """The inner products of rows over their noise, three numbers a row in time order.

    Args:
        fixed: (r, f) with prior sd (f,); candidates: (r, k); y: (r,).
    """
    A = np.concatenate([fixed * sd, candidates, y[:, None]], axis=1)
    block = np.minimum(np.arange(len(y)) // 3 * BLOCKS // (len(y) // 3), BLOCKS - 1)
    G = np.stack([A[block == b].T @ A[block == b] for b in range(BLOCKS)])
    rows = np.bincount(block, minlength=BLOCKS)
    return Regression(G=G, base=fixed.shape[1], rows=rows, noise_rows=noise_rows, groups=groups, least=least)


@dataclass(frozen=True)
class _Reduced:
    """Inner products (k + 1, k + 1) of candidates and rows once the base is marginalised; n numbers."""

    G: np.ndarray
    n: float
    noise_rows: float

    def score(self, columns: tuple[int, ...]) -> tuple[float, np.ndarray]:
        """Log evidence of a model, and its coefficients."""
        left, x = float(self.G[-1, -1]), np.zeros(0)
        if columns:
            own = np.array(columns)
            M, b = self.G[np.ix_(own, own)], self.G[own, -1]
            scale = np.sqrt(np.maximum(np.diag(M), 1e-300))
            U = M / scale[:, None] / scale + 1e-9 * np.eye(len(own))
            x = np.linalg.solve(U, b / scale) / scale
            left -= float(b @ x)
        count = self.n + self.noise_rows
        fit = -0.5 * count * np.log((max(left, 0.0) + self.noise_rows) / count)
        return float(fit - 0.5 * len(columns) * np.log(self.n)), x


def _reduced(r: Regression, use: np.ndarray) -> _Reduced:
    G = r.G[use].sum(axis=0)
    f = r.base
    H = G[:f, :f] + np.eye(f)
    rest = G[f:, f:] - G[f:, :f] @ np.linalg.solve(H, G[:f, f:])
    return _Reduced(rest, float(r.rows[use].sum()), r.noise_rows)


def search(r: Regression, use: np.ndarray | None = None, beam: int = BEAM, most: int = MOST_GROUPS) -> list[Found]:
    """Models by their score, the best first, needless terms pruned; the empty model is among them."""
    own = _reduced(r, np.ones(len(r.rows), bool) if use is None else use)
    # which group, and which of its terms: uniform over both (Chen and Chen 2008's extended criterion)
    price = float(np.log(len(r.groups) * (2.0 ** max(len(g) for g in r.groups) - 1.0)))
    empty = Found((), own.score(())[0])
    seen: dict[tuple[int, ...], Found] = {(): empty}
    level = [empty]
    for _ in range(most):
        grown: dict[tuple[int, ...], Found] = {}
        for model in level:
            for g in range(len(r.groups)):
                if g in model.groups:
                    continue
                groups = tuple(sorted((*model.groups, g)))
                if groups in grown:
                    continue
                columns = tuple(c for k in groups for c in r.groups[k])
                grown[groups] = Found(columns, own.score(columns)[0] - price * len(groups), groups)
        best = sorted(grown.values(), key=lambda m: -m.score)[:beam]
        pruned = [_pruned(own, r, m, price) for m in best]
        gained = max((m.score for m in pruned), default=-np.inf) > max(m.score for m in seen.values()) + 1e-9
        for m in pruned:
            if m.columns not in seen or m.score > seen[m.columns].score:
                seen[m.columns] = m
        level = best
        if not gained:
            break
    return sorted(seen.values(), key=lambda m: -m.score)


def _pruned(own: _Reduced, r: Regression, model: Found, price: float) -> Found:
    """The model without the terms that it is better off without; worthless with a coefficient of the wrong sign."""
    columns, groups = list(model.columns), model.groups

    def value(c: list[int]) -> float:
        left = [g for g in groups if set(r.groups[g]) & set(c)]
        return own.score(tuple(c))[0] - price * len(left)

    score = value(columns)
    while len(columns) > 1:
        trials = [(value([c for c in columns if c != out]), out) for out in columns]
        best, out = max(trials)
        if best <= score:
            break
        score, columns = best, [c for c in columns if c != out]
    kept = tuple(columns)
    x = own.score(kept)[1]
    for g in groups:
        for c, v in zip(kept, x, strict=True):
            if r.least[g] and c in r.groups[g] and v < 0:
                return Found(kept, -np.inf, groups)
    return Found(kept, score, tuple(g for g in groups if set(r.groups[g]) & set(kept)))


def probabilities(r: Regression, models: list[Found], alike: dict[int, int] | None = None) -> dict[int, float]:
    """The probability of each column: its share of the evidence, bounded by how often parts of the record choose it.

    Args:
        models: of `search`. alike: columns that stand for another: one term, a little earlier or later.
    """
    alike = alike or {}

    def kinds(model: Found) -> set[int]:
        return {alike.get(c, c) for c in model.columns}

    weight = np.exp(np.array([m.score for m in models]) - models[0].score)
    weight = np.where(weight > np.exp(-WINDOW), weight, 0.0)
    weight /= weight.sum()
    share: dict[int, float] = {}
    for m, v in zip(models, weight, strict=True):
        for c in kinds(m):
            share[c] = share.get(c, 0.0) + float(v)
    rng = np.random.default_rng(0)
    chosen: dict[int, int] = {}
    for _ in range(DRAWS):
        use = np.zeros(len(r.rows), bool)
        use[rng.permutation(len(r.rows))[: round(KEPT * len(r.rows))]] = True
        for c in kinds(search(r, use, most=len(models[0].groups) + 1)[0]):
            chosen[c] = chosen.get(c, 0) + 1
    # Laplace's rule: so many draws say no more than this
    by_kind = {c: min(p, (chosen.get(c, 0) + 1.0) / (DRAWS + 2.0)) for c, p in share.items()}
    return {c: by_kind.get(alike.get(c, c), 0.0) for m in models for c in m.columns}
