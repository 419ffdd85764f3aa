"""Fusion of mesh and motion on bodies with truth, without images; `make bench`.

The bodies are those of `tests/crosscheck/footage_bodies.py`: a real shape, measured where a tumbling shows it lit and closed
by a membrane elsewhere. Seeds 0 to 14 served to set `massprops.consistency.fusion.SIZE_OF_ITS_OWN`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "crosscheck"))

from footage_bodies import Body, make_body

from massprops.consistency.fusion import agreement, fuse
from massprops.consistency.verdict import SIGNIFICANT
from massprops.mass.recommended import recommend, relative_width

FIRST = 100
NAMES = ("V", "I1", "I2", "I3", "k1", "k2")


def values(document: dict[str, Any]) -> np.ndarray:
    """(6,) volume, moments, ratios."""
    k = document.get("inertia_ratios") or document
    return np.array([document["volume"], *document["principal_moments"], k["k1"], k["k2"]])


def bounds(document: dict[str, Any]) -> np.ndarray:
    """(6, 2) of the same."""
    found = document["interval_90"]
    return np.array([found["volume"], *found["principal_moments"], found["k1"], found["k2"]])


def held(document: dict[str, Any], true: np.ndarray) -> np.ndarray:
    low, high = bounds(document).T
    return np.asarray((low <= true) & (true <= high))


def judged(body: Body) -> dict[str, Any]:
    """One body: errors and intervals of the mesh, of both together, and of what is recommended."""
    true = np.array([body.true.volume, *body.true.principal_moments, body.true.k1, body.true.k2])
    size = np.array([*true[:4], 1.0, 1.0])
    mesh, both = body.side.document, fuse(body.draws, body.side, body.motion)
    p = agreement(body.draws, body.motion, body.length)
    verdict = "consistent" if p >= SIGNIFICANT else "inconsistent"
    chosen = recommend(mesh, {"verdict": verdict, "fused": both})
    low, high = bounds(mesh).T
    return {
        "p": p, "source": chosen["source"], "observed": body.observed,
        "mesh": (values(mesh) - true) / size, "fused": (values(both) - true) / size,
        "recommended": (values(chosen) - true) / size,
        "mesh held": held(mesh, true), "fused held": held(both, true), "recommended held": held(chosen, true),
        "within mesh": (low <= values(chosen)) & (values(chosen) <= high),
        "widths": (relative_width(mesh), relative_width(both)),
    }  # fmt: skip


@pytest.mark.bench
def test_fused_intervals_hold_and_a_well_measured_mesh_stays_within_its_own() -> None:
    rows = []
    print("\n  errors of V, I1, I2, I3 [%] and of k1, k2")
    for low_sun in (False, True):
        for seed in range(FIRST, FIRST + 15):
            rows.append(one := judged(make_body(seed, low_sun)))
            errors = "   ".join(
                f"{what} " + " ".join(f"{100 * v:+6.2f}" for v in one[what][:4]) + " %"
                + "".join(f" {v:+.4f}" for v in one[what][4:]) for what in ("mesh", "fused")
            )  # fmt: skip
            print(f"  {seed} measured {100 * one['observed']:3.0f} %  {errors}  {one['source']}", flush=True)
    for what in ("mesh", "fused", "recommended"):
        mean = np.abs([row[what] for row in rows]).mean(axis=0)
        share = np.mean([row[f"{what} held"] for row in rows], axis=0)
        print(f"  {what:<12} mean error " + " ".join(f"{100 * v:.2f} %" for v in mean[:4])
              + "".join(f" {v:.4f}" for v in mean[4:])
              + "   intervals hold " + " ".join(f"{n} {v:.2f}" for n, v in zip(NAMES, share, strict=True)))  # fmt: skip
    widths = np.mean([row["widths"] for row in rows], axis=0)
    print(f"  mean half width of the moments: mesh {100 * widths[0]:.1f} %, fused {100 * widths[1]:.1f} %")
    well = [row for row in rows if row["observed"] > 0.85]
    print(
        f"  moved out of the mesh's own interval: {sum(not r['within mesh'].all() for r in well)} of {len(well)} measured well"
    )
    assert np.mean([row["fused held"] for row in rows], axis=0).min() >= 0.9
    assert all(row["within mesh"].all() for row in well)
