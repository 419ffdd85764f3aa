"""The body by mesh and motion together, as the cross-check of a run left it, in another frame."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from massprops.core.outputs import Outputs
from massprops.exchange.alignment import Similarity
from massprops.mass.properties import MassProperties

SAME = 1e-9
"""Difference of k1 up to which the cross-check is of this mesh."""


def read_fused(run: Path | None, document: dict[str, Any]) -> dict[str, Any] | None:
    """`fused` of a run's `crosscheck.json`; None where there is none, or it is of an earlier mesh.

    Args:
        run: the run folder, or None for a bare mesh.
        document: its `massprops.json`.
    """
    if run is None or not Outputs(run).intact("crosscheck.json"):
        return None
    try:
        found = json.loads((run / "crosscheck.json").read_text())
        fused, k1 = found["fused"], float(found["mesh"]["k1"])
        own = float(document["inertia_ratios"]["k1"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return fused if isinstance(fused, dict) and abs(k1 - own) < SAME else None


def in_frame(fused: dict[str, Any], transform: Similarity, density: float) -> MassProperties:
    """The fused body's mass properties after a similarity x -> s R x + t of its mesh.

    Args:
        fused: of `read_fused`, in the mesh's axes.
        transform: to the other frame.
        density: [kg/m^3].
    """
    s, place = transform.scale, np.array([*fused["center_of_mass"], 1.0])
    R = transform.matrix[:3, :3] / s
    inertia = s**5 * R @ np.array(fused["inertia"], float) @ R.T
    return MassProperties.of(density, s**3 * float(fused["volume"]), (transform.matrix @ place)[:3], inertia)
