"""Lays one closed body on another: every plausible start, then iterative closest points to the planes of the target.

Bodies that are nearly symmetric (a bus between two arrays) have several poses that fit almost as well. So many starts
are refined, the survivors exactly, and the pose is chosen by the mean distance in both directions without trimming:
a small part that breaks the symmetry is what tells the poses apart, and trimming would throw just that away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix
from massprops.exchange.distances import Surface, surface_samples

if TYPE_CHECKING:
    import trimesh

Nearest = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Points (n, 3) -> closest points (n, 3) of the target and its unit normals (n, 3) there."""

ROUNDS = ((48, 700, 5, 12), (12, 1500, 10, 4))
"""Rounds on sampled surfaces: starts taken, points, steps, and how many distinct poses go on to the next."""


@dataclass(frozen=True)
class Similarity:
    """x -> scale * R x + t, from the source's frame to the target's."""

    scale: float
    R: np.ndarray
    t: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) in the target's frame."""
        return self.scale * points @ self.R.T + self.t

    def back(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the target's frame in the source's."""
        return (points - self.t) @ self.R / self.scale

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4)."""
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = self.scale * self.R, self.t
        return out


def starts(source_axes: np.ndarray, target_axes: np.ndarray) -> np.ndarray:
    """Rotations to try: (n, 3, 3).

    Principal frames on each other in their 24 ways; turns about each principal axis by 15 degrees, for bodies with two
    like moments; and an even net over all rotations, for bodies whose moments say little.
    """
    cube = []
    for order in permutations(range(3)):
        for sign in product((1, -1), repeat=3):
            m = np.zeros((3, 3))
            m[np.arange(3), order] = sign
            if np.linalg.det(m) > 0:
                cube.append(m)
    out = [target_axes @ m @ source_axes.T for m in cube]
    flips = [m for m in cube if np.count_nonzero(np.diag(m)) == 3]
    for axis in np.eye(3):
        for step in range(1, 24):
            turn = rotation_matrix(from_rotation_vector(axis * np.radians(15 * step)))
            out += [target_axes @ turn @ m @ source_axes.T for m in flips]
    return np.concatenate([np.stack(out), rotation_net(400)])


def rotation_net(count: int) -> np.ndarray:
    """(count, 3, 3) rotations spread evenly: the super-Fibonacci spiral of Alexa (CVPR 2022), algorithm 1."""
    phi, psi = np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(count) + 0.5
    r, R = np.sqrt(s / count), np.sqrt(1 - s / count)
    a, b = 2 * np.pi * s / phi, 2 * np.pi * s / psi
    return rotation_matrix(np.column_stack([r * np.sin(a), r * np.cos(a), R * np.sin(b), R * np.cos(b)]))


def distinct(rotations: np.ndarray, order: np.ndarray, count: int, apart_deg: float = 10.0) -> list[int]:
    """The first `count` of rotations (n, 3, 3) in the order (n,) that are at least `apart_deg` from those taken before."""
    least = 1 + 2 * np.cos(np.radians(apart_deg))
    taken: list[int] = []
    for k in order:
        if all(np.sum(rotations[k] * rotations[j]) < least for j in taken):
            taken.append(int(k))
            if len(taken) == count:
                break
    return taken


def align(
    source: trimesh.Trimesh,
    target: trimesh.Trimesh,
    free_scale: bool,
    measured: np.ndarray | None = None,
    seed: int = 0,
) -> Similarity:
    """The similarity that lays `source` on `target`.

    Args:
        source, target: closed meshes.
        free_scale: whether the scale is found too; 1 otherwise.
        measured: (f,) bool faces of the source that were measured; the fit uses them alone.
        seed: of the samples.
    """
    from scipy.spatial import cKDTree

    from massprops.mass.properties import mass_properties

    a, b = mass_properties(source, 1.0), mass_properties(target, 1.0)
    scale = (b.volume / a.volume) ** (1 / 3) if free_scale else 1.0
    source_points, goal = surface_samples(source, 6000, seed, measured), surface_samples(target, 6000, seed + 1)
    own_tree, goal_tree = cKDTree(source_points), cKDTree(goal)
    target_surface, source_surface = Surface(target), Surface(source)
    normals = target_surface.closest(goal)[1]

    def sampled(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at = goal_tree.query(points)[1]
        return goal[at], normals[at]

    rotations = starts(a.principal_axes, b.principal_axes)

    few = scale * (source_points[:250] - a.center_of_mass)
    there = np.einsum("rij,nj->rni", rotations, few) + b.center_of_mass
    back = np.einsum("rji,nj->rni", rotations, goal[:250] - b.center_of_mass) / scale + a.center_of_mass
    score = goal_tree.query(there.reshape(-1, 3))[0].reshape(len(rotations), -1).mean(1)
    score += scale * own_tree.query(back.reshape(-1, 3))[0].reshape(len(rotations), -1).mean(1)

    def both_ways(similarity: Similarity, count: int) -> float:
        value = goal_tree.query(similarity.apply(source_points[:count]))[0].mean()
        return float(value + similarity.scale * own_tree.query(similarity.back(goal[:count]))[0].mean())

    kept = [
        Similarity(scale, rotations[k], b.center_of_mass - scale * rotations[k] @ a.center_of_mass)
        for k in distinct(rotations, np.argsort(score, kind="stable"), ROUNDS[0][0])
    ]
    for count, points, steps, most_kept in ROUNDS:
        moved = [iterate(start, source_points[:points], sampled, free_scale, steps) for start in kept[:count]]
        values = np.array([both_ways(candidate, points) for candidate in moved])
        order = distinct(np.stack([m.R for m in moved]), np.argsort(values, kind="stable"), most_kept, apart_deg=3.0)
        kept = [moved[k] for k in order]

    exact: list[tuple[float, Similarity]] = []
    for start in kept:
        fine = iterate(start, source_points[:3000], target_surface.closest, free_scale, steps=10)
        value = float(target_surface.distance(fine.apply(source_points)).mean())
        exact.append((value + fine.scale * float(source_surface.distance(fine.back(goal)).mean()), fine))
    best = min(exact, key=lambda pair: pair[0])[1]
    many = surface_samples(source, 10_000, seed + 2, measured)
    return iterate(best, many, target_surface.closest, free_scale, steps=30)


def iterate(start: Similarity, points: np.ndarray, nearest: Nearest, free_scale: bool, steps: int) -> Similarity:
    """Point-to-plane iterations (Chen and Medioni 1992) with Cauchy weights at the usual residual.

    Args:
        start: where to begin.
        points: (n, 3) of the source.
        nearest: the target.
        free_scale: whether the scale moves too.
        steps: at most so many.
    """
    now = start
    for _ in range(steps):
        p = now.apply(points)
        q, n = nearest(p)
        residual = np.einsum("ni,ni->n", p - q, n)
        apart = np.linalg.norm(p - q, axis=1)
        width = 2.5 * max(mad_sigma(residual), 1e-12)
        weight = 1.0 / (1.0 + (residual / width) ** 2)
        weight *= apart < 6.0 * width + 3.0 * float(np.median(apart))
        middle = p.mean(axis=0)
        arm = p - middle
        reach = float(np.sqrt(np.mean(np.sum(arm**2, axis=1))))
        # turns are counted in lengths at the body's reach, so that the cut-off below does not depend on the unit
        columns = [np.cross(arm, n) / reach, n]
        if free_scale:
            columns.append(np.einsum("ni,ni->n", arm, n)[:, None] / reach)
        J = np.concatenate(columns, axis=1)
        # a body of revolution leaves a direction open: do not move along it
        step = -np.linalg.lstsq(J.T @ (weight[:, None] * J), J.T @ (weight * residual), rcond=1e-9)[0]
        turn = rotation_matrix(from_rotation_vector(step[:3] / reach))
        grow = 1.0 + (float(step[6]) / reach if free_scale else 0.0)
        if not 0.5 < grow < 2.0:
            break
        now = Similarity(now.scale * grow, turn @ now.R, grow * turn @ (now.t - middle) + middle + step[3:6])
        if np.linalg.norm(step) < 1e-7 * reach:
            break
    return now
