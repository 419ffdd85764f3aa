"""The mesh's side of the cross-check: inertia, ratios, axes and centre of mass, with the covariance from its replicates
or intervals."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from massprops.consistency.replicates import Replicates, fill_pulls, read_replicates
from massprops.errors import InputError
from massprops.mass.confidence import OPEN
from massprops.mass.document import read_document
from massprops.mass.integrals import central_inertia
from massprops.mass.ratio_space import (
    covariance_of_intervals,
    covariance_of_replicates,
    interval_sigma,
    log_components,
)

SHAPE_FLOOR = 0.004
"""1-sigma of each of the five numbers that no replicate shows: what matching, outlines and lens bend alike in all
views. Meshes of simulated footage with truth had their products of inertia off by 0.002 to 0.006 where the replicates
say 0.001."""


@dataclass(frozen=True)
class MeshSide:
    """Of one run, in the mesh's axes, which are those of the run's attitude0.

    Attributes:
        document: `massprops.json`.
        inertia: (3, 3) of trace 1; axes: (3, 3) principal axes as columns; k: (2,).
        covariance: (5, 5) of `log_components` in `axes`; zero when the mesh states no uncertainty.
        centre: (3,) [final units]; centre_covariance: (3, 3).
        stated: whether the mesh states an uncertainty.
        unseen: share of the surface that was filled in.
        factor: final units per unit of the structure from motion.
        length: greatest length of the body [final units]; without replicates that of a ball of its inertia, which is less.
        fill: (k, 3) how far each filled face may move the centre of mass (`replicates.fill_pulls`) [final units].
    """

    document: dict[str, Any]
    inertia: np.ndarray
    axes: np.ndarray
    k: np.ndarray
    covariance: np.ndarray
    centre: np.ndarray
    centre_covariance: np.ndarray
    stated: bool
    unseen: float
    factor: float
    length: float = 0.0
    fill: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    def fill_reaches(self, place: np.ndarray) -> bool:
        """Whether the filled sides, each off by its distance from what was measured, may carry the centre of mass to a place (3,)."""
        apart = place - self.centre
        return bool(np.abs(self.fill @ apart).sum() >= apart @ apart > 0)

    @property
    def open(self) -> bool:
        """Whether the images leave open how large the body is."""
        low, high = (self.document.get("interval_90") or {}).get("volume") or (0.0, 0.0)
        return bool(0.5 * (high - low) > OPEN * self.document["volume"])

    @property
    def sigma_k(self) -> np.ndarray:
        """(2,) 1-sigma of k1, k2."""
        return np.sqrt(np.diag(self.covariance)[:2])


def read_mesh_side(run: Path) -> MeshSide:
    """The mesh's side of a run.

    Raises:
        InputError: the run has no mass properties, or impossible ones.
    """
    from massprops.documents.scale_json import read_scale

    path = run / "massprops.json"
    if not path.is_file():
        raise InputError(f"{run}: no massprops.json in this run: finish it with 'massprops reconstruct' first")
    document = read_document(path)
    inertia = np.array(document["inertia"], float).reshape(3, 3)
    axes = np.array(document["principal_axes"], float).reshape(3, 3)
    centre = np.array(document["center_of_mass"], float).reshape(3)
    inertia = inertia / np.trace(inertia)
    stated = covariance_of_intervals(document, axes)
    covariance = np.zeros((5, 5)) if stated is None else stated
    centre_covariance = _centre_intervals(document, centre)
    try:
        factor = read_scale(run).factor
    except (InputError, ValueError):
        factor = 1.0
    replicates = read_replicates(run)
    if replicates is not None:
        centres, inertias = _drawn(replicates)
        covariance = covariance_of_replicates(inertias, inertia, axes) + SHAPE_FLOOR**2 * np.eye(5)
        apart = centres * factor - centre
        centre_covariance = apart.T @ apart / len(apart)
    seen = (document.get("surface") or {}).get("observed_fraction")
    return MeshSide(
        document=document,
        inertia=inertia,
        axes=axes,
        k=log_components(inertia, axes)[:2],
        covariance=covariance,
        centre=centre,
        centre_covariance=centre_covariance,
        stated=stated is not None or replicates is not None,
        unseen=0.0 if seen is None else float(1.0 - seen),
        factor=factor,
        length=_length(document) if replicates is None else replicates.length * factor,
        fill=np.zeros((0, 3)) if replicates is None else fill_pulls(*replicates.surface) * factor,
    )


def _length(document: dict[str, Any]) -> float:
    """Greatest length of the body: the unit itself where there is no scale, else by the gyration of its mass."""
    if (document.get("scale") or {}).get("source") == "none":
        return 1.0
    mass = float(document.get("mass") or 0.0)
    trace = float(np.trace(np.array(document["inertia"], float)))
    # of a solid ball, whose diameter is 2 (5/6 tr(I)/m)^1/2: less than the length of anything longer
    return 2.0 * float(np.sqrt(5.0 / 6.0 * trace / mass)) if mass > 0 else 0.0


def _drawn(replicates: Replicates) -> tuple[np.ndarray, np.ndarray]:
    """Centres (r, 3) [units of the structure from motion] and inertias (r, 3, 3) of the mesh's replicates."""
    _, centres, inertias = central_inertia(replicates.rows, 1.0)
    good = np.linalg.eigvalsh(inertias)[:, 0] > 0
    return centres[good], inertias[good]


def _centre_intervals(document: dict[str, Any], centre: np.ndarray) -> np.ndarray:
    bounds = (document.get("interval_90") or {}).get("center_of_mass")
    if not bounds:
        return np.zeros((3, 3))
    return np.diag([interval_sigma(b, c) ** 2 for b, c in zip(bounds, centre, strict=True)])
