"""Labels by minimum cut, and the closed surface between inside and outside.

The border of a set of tetrahedra is closed by construction, whatever the labels: no grid, no thickness below which
a plate tears.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from massprops.surface.tetra import Tetrahedra


@dataclass(frozen=True)
class Costs:
    """What the cut pays, for t tetrahedra.

    Attributes:
        outside: (t,) evidence that a tetrahedron is outside: cost of calling it inside.
        inside: (t,) cost of calling it outside.
        into: (t, 4) cost of a facet whose neighbour is outside and whose own tetrahedron is inside.
        both: (t, 4) cost of a facet between different labels.
        shown: (t,) bool, tetrahedra that silhouettes alone show; None where there are none.
        space: (t,) what `inside` holds for each unit of the hull's pull on space in which nothing was measured; None where it is
            not told.
        before: (t,) likewise what `outside` holds, in front of flat sides that go on; None where none do.
    """

    outside: np.ndarray
    inside: np.ndarray
    into: np.ndarray
    both: np.ndarray
    shown: np.ndarray | None = None
    space: np.ndarray | None = None
    before: np.ndarray | None = None

    def pulled(self, more: float) -> Costs:
        """The same with so much more pull of the hull."""
        if self.space is None or more == 0.0:
            return self
        outside = self.outside if self.before is None else self.outside + more * self.before
        return replace(self, inside=self.inside + more * self.space, outside=outside)


def minimum_cut(tetra: Tetrahedra, costs: Costs) -> np.ndarray:
    """(t,) bool, True inside: the labels of least cost (Boykov and Kolmogorov 2004, by PyMaxflow)."""
    import maxflow

    t, k, other, back = tetra.facets
    graph = maxflow.Graph[float](len(tetra.corners), len(t))
    nodes = graph.add_nodes(len(tetra.corners))
    smooth = costs.both[t, k]
    # Source is outside: an edge i -> j is cut when i is outside and j inside.
    graph.add_edges(nodes[t], nodes[other], costs.into[other, back] + smooth, costs.into[t, k] + smooth)
    graph.add_grid_tedges(nodes, costs.outside, costs.inside)
    graph.maxflow()
    return np.asarray(graph.get_grid_segments(nodes), bool)


def manifold(tetra: Tetrahedra, inside: np.ndarray, never: np.ndarray | None = None) -> np.ndarray:
    """The labels with bubbles filled, and pinched edges thickened until the surface is a manifold.

    Args:
        inside: (t,) bool.
        never: (t,) bool, tetrahedra that no edge is thickened by, such as those that reach far out of the body: what
            pinches an edge beside them is taken away.
    """
    shut = np.asarray((tetra.neighbours < 0).any(1))
    if never is not None:
        shut = shut | never
    label = inside
    for _ in range(40):
        label = ~_reached_from_outside(tetra, label)
        about, edge = _pinched(tetra, label)
        if not len(about):
            break
        beside = np.bincount(edge, shut[about], minlength=int(edge.max()) + 1) > 0
        gone = np.zeros(len(label), bool)
        gone[about[beside[edge]]] = True
        label = label.copy()
        label[about[_closed(tetra, label, about, edge)]] = True
        label &= ~gone & ~shut
        shut = shut | gone
    return label


def components(tetra: Tetrahedra, inside: np.ndarray) -> np.ndarray:
    """(t,) number of the component of equal labels that each tetrahedron belongs to, in the order of their first ones."""
    return np.asarray(_components(tetra.neighbours, np.ascontiguousarray(inside, bool)))


@njit(cache=True)
def _components(neighbours: np.ndarray, inside: np.ndarray) -> np.ndarray:
    part, waiting, count = np.full(len(inside), -1, np.int32), np.empty(len(inside), np.int64), 0
    for first in range(len(inside)):
        if part[first] >= 0:
            continue
        part[first] = count
        waiting[0], waiting_count = first, 1
        while waiting_count > 0:
            waiting_count -= 1
            t = waiting[waiting_count]
            for k in range(4):
                other = neighbours[t, k]
                if other >= 0 and part[other] < 0 and inside[other] == inside[t]:
                    part[other] = count
                    waiting[waiting_count] = other
                    waiting_count += 1
        count += 1
    return part


def _reached_from_outside(tetra: Tetrahedra, inside: np.ndarray) -> np.ndarray:
    part = components(tetra, inside)
    rim = np.unique(part[(tetra.neighbours < 0).any(1) & ~inside])
    return np.isin(part, rim) & ~inside


def _pinched(tetra: Tetrahedra, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges that more than two surface triangles share: the tetrahedra (k,) about them, and the number (k,) of the edge."""
    faces = surface_faces(tetra, inside)
    size = len(tetra.points)
    code, count = np.unique(_edges(faces.T, np.roll(faces, -1, axis=1).T, size), return_counts=True)
    bad = code[count > 2]
    ends = np.zeros(size, bool)
    ends[bad // size] = ends[bad % size] = True
    near = np.flatnonzero(ends[tetra.corners].sum(axis=1) > 1)
    about, edge = [], []
    for i in range(4) if len(bad) else ():
        for j in range(i + 1, 4):
            edge_codes = _edges(tetra.corners[near, i], tetra.corners[near, j], size)
            place = np.minimum(np.searchsorted(bad, edge_codes), len(bad) - 1)
            here = np.flatnonzero(bad[place] == edge_codes)
            about.append(near[here])
            edge.append(place[here])
    none = np.zeros(0, int)
    return np.concatenate([none, *about]), np.concatenate([none, *edge])


def _edges(one: np.ndarray, other: np.ndarray, size: int) -> np.ndarray:
    """A number for each edge between points `one` and `other`, of `size` points, whichever is named first."""
    return np.minimum(one, other).astype(np.int64) * size + np.maximum(one, other)


def _closed(tetra: Tetrahedra, inside: np.ndarray, about: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """(k,) bool: of the tetrahedra about pinched edges, as of `_pinched`, those outside that close all gaps of an edge but its largest.

    A thin part may meet itself at an edge between two very large tetrahedra: to fill both would draw a web across the sky.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    free = np.flatnonzero(~inside[about])
    t, e = about[free], edge[free].astype(np.int64)
    code = e * len(inside) + t
    order = np.argsort(code)
    links = []
    for k in range(4):
        # two that share a facet and an edge are next to each other about that edge
        wanted = e * len(inside) + tetra.neighbours[t, k]
        place = np.minimum(np.searchsorted(code, wanted, sorter=order), len(code) - 1)
        there = np.flatnonzero((tetra.neighbours[t, k] >= 0) & (code[order[place]] == wanted))
        links.append(np.stack([there, order[place[there]]]))
    i, j = np.concatenate(links, axis=1)
    gap = connected_components(coo_matrix((np.ones(len(i), np.int8), (i, j)), shape=(len(t),) * 2), directed=False)[1]
    size = np.bincount(gap, tetra.volume[t])[gap]
    largest = np.zeros(int(edge.max()) + 1)
    np.maximum.at(largest, e, size)
    out = np.zeros(len(about), bool)
    out[free] = size < largest[e]
    return out


def surface_faces(tetra: Tetrahedra, inside: np.ndarray) -> np.ndarray:
    """(f, 3) triangles between inside and outside, wound so that normals point out; indices of tetra.points."""
    after = np.where(tetra.neighbours >= 0, inside[tetra.neighbours], False)
    t, k = np.nonzero(inside[:, None] & ~after)
    face: np.ndarray = tetra.corners[t[:, None], (k[:, None] + [[1, 2, 3]]) % 4]
    a, b, c = (tetra.points[face[:, i]] for i in range(3))
    apex = tetra.points[tetra.corners[t, k]]
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), apex - a) > 0
    face[inward] = face[inward][:, ::-1]
    return face
