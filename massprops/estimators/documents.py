"""What `massprops estimate` writes of its estimates: one JSON document, one table of the state history each."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.estimators.outcome import Outcome
from massprops.estimators.result import Estimate
from massprops.model.problem import Problem
from massprops.sequence.table import stamped_table


def document(outcome: Outcome, source: str = "") -> dict[str, Any]:
    """`estimates.json`."""
    problem = outcome.problem
    return {
        "format": "massprops-estimates/1",
        "source": source,
        "epochs": len(problem.times),
        "seconds": float(problem.times[-1]),
        "measured": {
            "features": int(problem.uv.shape[2]),
            "observations": int(problem.seen.sum()),
            "cameras": len(problem.cameras),
            "ranges": int(np.isfinite(problem.range_m).sum()),
            "rates": int(np.isfinite(problem.rates[:, 0]).sum()),
            "attitudes": int(np.isfinite(problem.attitude[:, 0]).sum()),
        },
        "prior": None if outcome.prior is None else outcome.prior.document(),
        "estimators": [entry(e, outcome.cpu_seconds.get(e.name)) for e in outcome.estimates],
        "skipped": [{"name": name, "reason": reason} for name, reason in outcome.skipped.items()],
        "reason": outcome.reason,
        "warnings": list(outcome.warnings),
    }


def entry(estimate: Estimate, cpu_seconds: float | None = None) -> dict[str, Any]:
    """One estimator's result as plain numbers."""
    rate = None
    if estimate.w is not None and len(estimate.w) and np.isfinite(estimate.w[-1]).all():
        last = None if estimate.sigma_w is None else estimate.sigma_w[-1]
        rate = {"w_rad_s": estimate.w[-1], "sigma_rad_s": last, "speed_rad_s": float(np.linalg.norm(estimate.w[-1]))}
    return {
        "name": estimate.name,
        "converged": bool(estimate.converged),
        "observable": bool(estimate.observable),
        "reliable": bool(estimate.reliable),
        "because": estimate.because,
        "reason": estimate.reason,
        **estimate.ratios(),
        "inertia": estimate.inertia,
        "principal_axes": estimate.principal_axes,
        "axes_covariance_rad2": estimate.axes_covariance,
        "body_frame": estimate.body_frame,
        "rate": rate,
        "innovation": estimate.innovation,
        "gated": int(estimate.gated),
        "used": int(estimate.used),
        "features": None if estimate.features is None else len(estimate.features),
        "cpu_us_per_step": estimate.cpu_us_per_step,
        "cpu_seconds": cpu_seconds,
        "history": f"{estimate.name}.csv" if len(estimate.times) else None,
        "warnings": list(estimate.warnings),
    }


COLUMNS = (
    ("q", "q_w [],q_x [],q_y [],q_z []"),
    ("sigma_attitude", "sigma_attitude_x [rad],sigma_attitude_y [rad],sigma_attitude_z [rad]"),
    ("w", "w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1]"),
    ("sigma_w", "sigma_w_x [rad s^-1],sigma_w_y [rad s^-1],sigma_w_z [rad s^-1]"),
    ("position", "p_x [m],p_y [m],p_z [m]"),
    ("sigma_position", "sigma_p_x [m],sigma_p_y [m],sigma_p_z [m]"),
    ("velocity", "v_x [m s^-1],v_y [m s^-1],v_z [m s^-1]"),
    ("sigma_velocity", "sigma_v_x [m s^-1],sigma_v_y [m s^-1],sigma_v_z [m s^-1]"),
    ("k_history", "k1 [],k2 []"),
    ("k_sigma_history", "sigma_k1 [],sigma_k2 []"),
)


def history_csv(estimate: Estimate, problem: Problem) -> str:
    """The state history, one row an epoch; columns that the estimator does not give are left out."""
    n = len(estimate.times)
    stamps = problem.stamps(estimate.times)
    header, parts = ["#timestamp [ns]"], []
    for name, title in COLUMNS:
        values = getattr(estimate, name)
        width = title.count(",") + 1
        if values is not None and np.shape(values) == (n, width):
            header.append(title)
            parts.append(np.asarray(values, float))
    table = np.hstack(parts) if parts else np.zeros((n, 0))
    return stamped_table(",".join(header), stamps, table, 12)
