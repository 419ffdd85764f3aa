"""kabir2025: the set-up of every case."""

from __future__ import annotations

from typing import Any

import numpy as np

RATES = (0.025, 0.075, 0.125, 0.175)
SPANS = (75, 100, 200, 500, 1000, 1500, 2000, 2500, 3000)
POLHODE_S = {0.025: 441.045, 0.075: 147.015, 0.125: 88.209, 0.175: 63.006}
FLOW = {0.025: 1e-5, 0.075: 5e-4, 0.125: 5e-4, 0.175: 1e-3}
NOISE_W = {0.025: 2.5e-9, 0.075: 2.5e-7, 0.125: 2.5e-5, 0.175: 2.5e-5}
NOISE_Q = {0.025: 4e-10, 0.075: 4e-8, 0.125: 4e-6, 0.175: 4e-6}
FEATURES = (
    (0.1302, 0.6648, 0.2264),
    (1.0343, -1.4858, -1.1352),
    (-0.5122, 0.9775, -1.0898),
    (-0.2252, -1.1739, 0.8723),
    (0.9440, 1.1748, 0.8409),
)


def configuration(case: str) -> dict[str, Any]:
    """The whole set-up of a case, SI units and radians."""
    if case == "polhode":
        return {
            "kind": case,
            "at": {str(f): {**configuration(f"gp-{f}"), "spans_s": [three_periods(f)]} for f in RATES},
        }
    kind, _, rate = case.partition("-")
    f = float(rate)
    common: dict[str, Any] = {
        "kind": kind,
        "tumbling_hz": f,
        "w0": [2 * np.pi * f * x for x in (2 / 3, 1 / 3, 2 / 3)],
        "moments": [90.0, 100.0, 112.0],
        "position_m": [0.0, 10.0, 0.0],
        "baseline_m": 1.0,
        "focal_length": 1.0,
        "sigma_projection": 1e-5,
        "sigma_disparity": 1e-5,
        "sigma_flow": FLOW[f],
    }
    if kind == "gp":
        spans = [*SPANS, three_periods(f)]
        return {**common, "features_m": [[1.0, 1.0, 1.0]], "spans_s": sorted(spans), "ahead_s": 2000}
    return {
        **common,
        "features_m": [list(p) for p in FEATURES],
        "total_s": 3000,
        "dark_from_s": 1500,
        "start_s": 150 if f < 0.05 else 60,
        "alpha": 0.1,
        "beta": 2.0,
        "kappa": 0.0,
        "largest_turn_rad": 0.1,
        "process_noise": {"w": NOISE_W[f], "q": NOISE_Q[f], "k": 3.6e-5, "features": 1e-6},
    }


def three_periods(f: float) -> int:
    """Samples in three polhode periods."""
    return round(3 * POLHODE_S[f])
