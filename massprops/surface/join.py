"""The pieces of a cut to one body: parts that were measured and hang by what was not.

What moves together is one body, but a thin root that was never lit or never seen leaves what hangs by it without a
link, and the cut has several components. The cut's own energy says which of them are the body's. Deleting a component
costs what its points weigh, less its surface; a link costs what lines of sight, silhouettes and its own surface say
against it. A component stays when its deletion costs more than its link.

Links are chains of tetrahedra, found by one search from all components at once (Dijkstra 1959, over facets), of
which a minimum spanning tree is kept (Mehlhorn 1988) and pruned from its leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from massprops.surface.cut import Costs, components, surface_faces
from massprops.surface.tetra import Tetrahedra

OneThing = Callable[[np.ndarray, np.ndarray, Sequence[np.ndarray]], np.ndarray]
"""Which of some parts (k,) bool silhouettes show to be one thing with the body, of vertices (v, 3), the body's faces (f, 3) and those of
each part."""

LEVEL = 1e-3
"""Chance that the heaviest of the specks of wrong points is taken for a part."""


def joined(
    tetra: Tetrahedra, costs: Costs, inside: np.ndarray, moving: bool = True, one_thing: OneThing | None = None
) -> np.ndarray:
    """(t,) bool: the component that weighs most, the parts worth a link to it, and the links.

    Args:
        tetra: t tetrahedra.
        costs: of the cut that gave the labels.
        inside: (t,) labels of least cost.
        moving: all points moved together, so that all parts are the body's; else the component that weighs most is the
            object, and others may be what stands beside it, unless they hang together with it through space that no
            silhouette shows to be empty, or silhouettes show both to be one thing.
        one_thing: of a still object; without silhouettes, nothing tells the object's parts from other things.
    """
    part = np.where(inside, components(tetra, inside), -1)
    deletion_cost = _deletion_cost(tetra, costs, part)
    body = int(np.argmax(deletion_cost))
    few = parts(deletion_cost) if moving or one_thing else np.array([body])
    if costs.shown is not None:
        # what all silhouettes of the object show is its own
        of_object = np.bincount(part[inside], costs.shown[inside], len(deletion_cost)) > 0.5 * np.bincount(part[inside])
        few = np.union1d(few, np.flatnonzero(of_object))
    if len(few) < 2:
        return part == body
    part = np.where(np.isin(part, few), part, -1)
    sky, facets = costs.outside > 0, _facets(tetra)
    label = _linked(tetra, facets, costs, part, deletion_cost, body, sky)
    held, apart = np.intersect1d(few, part[label]), np.setdiff1d(few, part[label])
    if not moving and one_thing and len(apart):
        of_body, *of_parts = (surface_faces(tetra, part == k) for k in (body, *apart))
        apart = apart[one_thing(tetra.points, of_body, of_parts)]
    if (moving or one_thing) and len(apart):
        # only what nothing else holds hangs by space that silhouettes show to be empty
        deletion_cost[body] = deletion_cost[held].sum()
        part = np.where(label, body, np.where(np.isin(part, apart), part, -1))
        label = _linked(tetra, facets, costs, part, deletion_cost, body, np.zeros_like(sky))
    return label


def _linked(
    tetra: Tetrahedra,
    facets: tuple[np.ndarray, np.ndarray],
    costs: Costs,
    part: np.ndarray,
    deletion_cost: np.ndarray,
    body: int,
    shut: np.ndarray,
) -> np.ndarray:
    """(t,) bool: the body, the parts worth a link to it, and the links.

    Args:
        facets: as of `_facets`.
        part: (t,) number of each tetrahedron's component, -1 outside of all; body: of the one that weighs most.
        deletion_cost: (n,) of `_deletion_cost`.
        shut: (t,) bool, tetrahedra that no link leads through.
    """
    limit = float(np.sort(deletion_cost[np.unique(part[part >= 0])])[-2])
    facet, sides = facets
    ends, price, through = _passages(tetra, costs, part >= 0, shut, facet, limit)
    graph = coo_matrix((price, ends.T), shape=(len(sides), len(sides))).tocsr()
    distance, before, owner = _search(graph, part, sides, limit)
    link, first = _links(ends, price, distance, owner, len(deletion_cost))
    label: np.ndarray = part == body
    for a, b in _kept_links(link, deletion_cost, body):
        label |= np.isin(part, (a, b))
        crossing = first[min(a, b), max(a, b)]
        label[through[crossing]] = True
        for f in ends[crossing]:
            while before[f] >= 0:
                label[np.intersect1d(sides[f], sides[before[f]])] = True
                f = before[f]
    return label


def parts(deletion_cost: np.ndarray) -> np.ndarray:
    """Indices of the components that are no specks: the heaviest, and those too heavy for chance.

    Specks of wrong points weigh the less often the more, like an exponential with their mean, or with one point's
    weight if that is more: of n of them the heaviest is over mean ln(n / LEVEL) once in 1 / LEVEL cases.

    Args:
        deletion_cost: (n,) energy that deleting each component costs.
    """
    order = np.argsort(deletion_cost)
    rank = np.arange(1, len(deletion_cost) + 1)
    mean = np.cumsum(deletion_cost[order]) / rank
    lighter = np.concatenate([[1.0], np.maximum(mean[:-1], 1.0)])
    over = deletion_cost[order] > lighter * np.log(rank / LEVEL)
    over[-1] = True
    # all above the first that is too heavy
    return order[np.argmax(over) :]


def _deletion_cost(tetra: Tetrahedra, costs: Costs, part: np.ndarray) -> np.ndarray:
    """(n,) rise of the cut's energy when each component is called outside."""
    inside = part >= 0
    open_side = (tetra.neighbours >= 0) & ~inside[tetra.neighbours]
    gain = costs.inside - costs.outside - ((costs.into + costs.both) * open_side).sum(1)
    return np.bincount(part[inside], gain[inside])


def _facets(tetra: Tetrahedra) -> tuple[np.ndarray, np.ndarray]:
    """(t, 4) number of the facet across from each corner, -1 on the rim, and (f, 2) the tetrahedra on its sides."""
    t, k, other, back = tetra.facets
    facet = np.full(tetra.neighbours.shape, -1, np.int64)
    facet[t, k] = facet[other, back] = np.arange(len(t))
    return facet, np.column_stack([t, other])


def _passages(
    tetra: Tetrahedra, costs: Costs, inside: np.ndarray, shut: np.ndarray, facet: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ways through the outside, from facet to facet of one tetrahedron; shut: (t,) bool, tetrahedra that none leads through.

    Returns:
        ends (p, 2) facets, price (p,) of calling the tetrahedron inside and closing its two other facets, through
        (p,) the tetrahedron; none at `limit` or over.
    """
    free = ~inside
    wall = np.where((tetra.neighbours >= 0) & free[tetra.neighbours], costs.into + costs.both, 0.0)
    inside_cost = np.maximum(costs.outside - costs.inside, 0.0)
    ends, price, through = [], [], []
    for i in range(4):
        for j in range(i + 1, 4):
            others = [k for k in range(4) if k not in (i, j)]
            # never zero, which a sparse graph takes for no edge
            cost = np.maximum(inside_cost + wall[:, others].sum(1), 1e-9)
            way = np.flatnonzero(free & ~shut & (cost < limit) & (facet[:, i] >= 0) & (facet[:, j] >= 0))
            ends.append(facet[way][:, [i, j]])
            price.append(cost[way])
            through.append(way)
    return np.concatenate(ends), np.concatenate(price), np.concatenate(through)


def _search(
    graph: csr_matrix, part: np.ndarray, sides: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each facet the cheapest way to a component: its price, the facet before it, and which component (or -1)."""
    from scipy.sparse.csgraph import dijkstra

    one, two = part[sides[:, 0]], part[sides[:, 1]]
    start = np.flatnonzero((one >= 0) != (two >= 0))
    distance, before, source = dijkstra(
        graph, directed=False, indices=start, min_only=True, return_predecessors=True, limit=limit
    )
    reached = np.isfinite(distance)
    return distance, before, np.where(reached, np.maximum(one, two)[np.where(reached, source, 0)], -1)


def _links(
    ends: np.ndarray, price: np.ndarray, distance: np.ndarray, owner: np.ndarray, size: int
) -> tuple[csr_matrix, dict[tuple[int, int], int]]:
    """The cheapest way between each two components that meet: its price (n, n), and the passage where they meet."""
    a, b = owner[ends].T
    meet = np.flatnonzero((a != b) & (a >= 0) & (b >= 0))
    low, high = np.minimum(a, b)[meet], np.maximum(a, b)[meet]
    total = price[meet] + distance[ends[meet]].sum(1)
    order = np.lexsort((total, high, low))
    cheapest = order[np.unique(low[order] * size + high[order], return_index=True)[1]]
    low, high, total, meet = low[cheapest], high[cheapest], total[cheapest], meet[cheapest]
    first = {(int(i), int(j)): int(m) for i, j, m in zip(low, high, meet, strict=True)}
    return coo_matrix((total, (low, high)), shape=(size, size)).tocsr(), first


def _kept_links(link: csr_matrix, deletion_cost: np.ndarray, body: int) -> list[tuple[int, int]]:
    """Pairs (towards the body, away from it): branches of the tree that are worth their links."""
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    tree = minimum_spanning_tree(link)
    order, parent = breadth_first_order(tree, body, directed=False)
    price = (tree + tree.T).tocsr()
    value = deletion_cost.astype(float).copy()
    for c in order[:0:-1]:
        value[parent[c]] += max(value[c] - price[c, parent[c]], 0.0)
    kept, out = {body}, []
    for c in order[1:]:
        if parent[c] in kept and value[c] > price[c, parent[c]]:
            kept.add(c)
            out.append((int(parent[c]), int(c)))
    return out
