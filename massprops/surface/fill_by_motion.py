"""How far unmeasured sides reach, by the centre of mass that a body's motion shows.

A body that is free turns about its centre of mass, whatever its surface shows, and a side that was never lit or never seen is as
large as puts the mesh's centre there. Which of several ways of filling in does so is weighed by its evidence: the centre's own
covariance, and that of what the fill may be off by besides (`error_modes`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from massprops.mass.integrals import mesh_integrals, offset_response
from massprops.surface.error_modes import fill_modes

SHARES = np.linspace(0.0, 1.0, 13)
"""Of the way to the membrane that are tried."""
FACTORS = (0.1, 0.2, 0.5, 1.0)
"""How much of what `error_modes` states the fill of one body may be off from place to place: that is stated for the worst of many."""


class Pull(NamedTuple):
    """What a cut does with space in which nothing was measured.

    Attributes:
        strength: of the hull's pull on it, per spacing cubed.
        straight: flat sides go on, and what lies in front of them is pushed out as strongly.
    """

    strength: float
    straight: bool = False


@dataclass(frozen=True)
class Balance:
    """Where the motion shows the centre of mass: place (3,) in the frame of the views, covariance (3, 3)."""

    place: np.ndarray
    covariance: np.ndarray

    def widened(self, sigma: float) -> Balance:
        """The same with an error of its own along each axis."""
        return replace(self, covariance=self.covariance + sigma**2 * np.eye(3))


@dataclass(frozen=True)
class Cut:
    """A mesh whose unmeasured sides are where the cut left them.

    Attributes:
        vertices: (v, 3); faces: (f, 3).
        measured: (v,) bool.
        membrane: (v, 3) the same with its unmeasured vertices on a membrane over the measured rims.
    """

    vertices: np.ndarray
    faces: np.ndarray
    measured: np.ndarray
    membrane: np.ndarray

    def at(self, share: float) -> np.ndarray:
        """(v, 3) with its unmeasured vertices a share of the way to the membrane."""
        return self.vertices + share * (self.membrane - self.vertices)


@dataclass(frozen=True)
class FillCentres:
    """Centres of mass (k, 3) of a cut by `SHARES`, and the covariance (3, 3) of what its fill may be off by besides."""

    centres: np.ndarray
    spread: np.ndarray


def fill_centres(cut: Cut) -> FillCentres:
    """The ways of filling in that one cut leaves."""
    centres = np.array([centre_of(cut.at(float(share)), cut.faces) for share in SHARES])
    whole, seen = cut.at(float(np.median(SHARES))), cut.measured[cut.faces].all(axis=1)
    if not seen.any():
        return FillCentres(centres, np.zeros((3, 3)))
    # the first mode is common to all of the fill, as the share is
    modes = fill_modes(whole, cut.faces, seen, float(np.linalg.norm(np.ptp(whole, axis=0))))[1:]
    by_volume, by_first = np.split(modes @ offset_response(whole, cut.faces)[:, :4], [1], axis=1)
    moved = (by_first - by_volume * centre_of(whole, cut.faces)) / mesh_integrals(whole, cut.faces)[0]
    return FillCentres(centres, moved.T @ moved)


def log_evidence(ways: FillCentres, balance: Balance, shift: np.ndarray | float = 0.0) -> np.ndarray:
    """(k, 4) log density of the centre that the motion shows, by the share of the way to the membrane and by how much of what is stated
    (`FACTORS`) the fill is off from place to place.

    Args:
        shift: (3,) by which later steps move the mesh's centre.
    """
    apart = ways.centres + shift - balance.place
    out = []
    for factor in FACTORS:
        spread = balance.covariance + factor**2 * ways.spread
        square = np.einsum("ki,ki->k", apart, np.linalg.solve(spread, apart.T).T)
        out.append(-0.5 * (square + np.linalg.slogdet(spread)[1]))
    return np.stack(out, axis=1)


def tells(cut: Cut, balance: Balance) -> bool:
    """Whether how far the fill reaches moves the centre of mass by more than the motion leaves open."""
    moved = centre_of(cut.membrane, cut.faces) - centre_of(cut.vertices, cut.faces)
    return bool(moved @ np.linalg.solve(balance.covariance, moved) > 1.0)


@dataclass(frozen=True)
class LikelyFill:
    """A pull, the mean share of the way to the membrane under it, and the chance of that pull."""

    pull: Pull
    membrane: float
    chance: float


def balanced(
    ways: Mapping[Pull, FillCentres], usual: float, balance: Balance, shift: np.ndarray | float = 0.0
) -> list[LikelyFill]:
    """The pulls under which the centre may lie where the motion shows it, the likeliest first.

    Args:
        ways: by the hull's pull on what was not measured; usual: share that is likeliest where nothing is known, and its 1-sigma.
        shift: (3,) by which later steps move the mesh's centre.
    """
    prior = -0.5 * ((SHARES - usual) / usual) ** 2
    log = {pull: np.logaddexp.reduce(log_evidence(way, balance, shift), axis=1) + prior for pull, way in ways.items()}
    total = {pull: np.logaddexp.reduce(by_share) for pull, by_share in log.items()}
    whole = np.logaddexp.reduce(list(total.values()))
    fills = [
        LikelyFill(pull, round(float(np.exp(by_share - total[pull]) @ SHARES), 2), float(np.exp(total[pull] - whole)))
        for pull, by_share in log.items()
    ]
    return sorted(fills, key=lambda fill: -fill.chance)


def centre_of(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(3,) of a closed mesh."""
    ten = mesh_integrals(vertices, faces)
    return np.asarray(ten[1:4] / ten[0])
