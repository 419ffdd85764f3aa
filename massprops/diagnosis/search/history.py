"""The physicist's first look: is angular momentum constant in size and direction, does energy fall?"""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.dynamics.rigid_body import angular_momentum, kinetic_energy


def momentum_and_energy(times: np.ndarray, q: np.ndarray, w: np.ndarray, inertia: np.ndarray) -> dict[str, Any]:
    """Histories and their drifts, without a model of the motion.

    Args:
        times: (n,); q: (n, 4) body to inertial and w: (n, 3) from local fits; inertia: (3, 3) body axes.

    Returns:
        `momentum` (n, 3) and `energy` (n,) over their first values, `size_drift` and `energy_drift` (relative, over the
        record), `direction_drift_deg`, each with its scatter.
    """
    h, energy = angular_momentum(q, w, inertia), kinetic_energy(w, inertia)
    size = np.linalg.norm(h, axis=1)
    tenth = max(2, len(times) // 10)
    first, last = h[:tenth].mean(axis=0), h[-tenth:].mean(axis=0)
    cosine = first @ last / np.linalg.norm(first) / np.linalg.norm(last)
    middle = np.median(size)
    return {
        "times": times,
        "momentum": h / np.linalg.norm(first),
        "energy": energy / np.mean(energy[:tenth]),
        "size_drift": float((size[-tenth:].mean() - size[:tenth].mean()) / middle),
        "size_scatter": float(np.std(np.diff(size)) / np.sqrt(2) / middle),
        "energy_drift": float(energy[-tenth:].mean() / energy[:tenth].mean() - 1.0),
        "energy_scatter": float(np.std(np.diff(energy)) / np.sqrt(2) / np.median(energy)),
        "direction_drift_deg": float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))),
    }
