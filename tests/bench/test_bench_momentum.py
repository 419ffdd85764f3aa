"""Diagnoses of motion logs that others recorded, by the balance of momentum: about ten seconds of CPU each.

Thresholds were set on every other record of each folder (the first, third and so on by name). The rest was opened once, at
the end.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from massprops.diagnosis.diagnose import BalanceDiagnosis, diagnose_by_balance
from massprops.sequence import read_sequence

pytestmark = pytest.mark.bench

RACQUET_K1 = -2.597
"""ln(I1 / I2) over seven tosses, from a fit with drag by axis; the pendulum agrees within its wide error."""


def _found(folder: Path) -> tuple[BalanceDiagnosis, list[str]]:
    found = diagnose_by_balance(read_sequence(folder))
    return found, [e["name"] for e in found.document["effects"]]


def _wheel(found: BalanceDiagnosis, folder: Path) -> dict[str, float]:
    """The named wheel against the withheld one: angle of the axis from z [deg], correlation, size over the truth's."""
    effect = found.document["effects"][0]
    truth = yaml.safe_load((folder / "truth" / "truth.yaml").read_text())
    rate = np.loadtxt(folder / "truth" / "flywheel.csv", delimiter=",", comments="#")
    mean = np.trace(np.array(truth["inertia_kg_m2"])) / 3.0
    times = np.array(effect["history"]["times_s"])
    # the wheel turns about -z
    withheld = -np.interp(times, rate[:, 0] * 1e-9, rate[:, 1]) * truth["flywheel_inertia_kg_m2"] / mean
    axis = np.array(effect["axis"])
    history = np.array(effect["history"]["momentum_rad_s"]) * np.sign(axis[2])
    return {
        "axis_deg": float(np.degrees(np.arccos(min(1.0, abs(axis[2]))))),
        "correlation": float(np.corrcoef(history, withheld)[0, 1]),
        "size": float(np.ptp(history) / np.ptp(withheld)),
    }


def test_a_wheel_in_thrown_bodies(real_data: Path) -> None:
    folders = sorted((real_data / "flights").iterdir())
    alone, axis, history, size = 0, 0, 0, 0
    print(f"\n{'flight':<24}{'verdict':<12}{'axis':>7}{'corr.':>8}{'size':>7}{'k1':>8}{'true':>8}")
    for folder in folders:
        found, names = _found(folder)
        truth = yaml.safe_load((folder / "truth" / "truth.yaml").read_text())
        moments = np.linalg.eigvalsh(np.array(truth["inertia_kg_m2"]))
        row: dict[str, Any] = {"axis_deg": np.nan, "correlation": np.nan, "size": np.nan}
        if (
            found.document["verdict"] == "named"
            and names == ["internal-rotor"]
            and "history" in found.document["effects"][0]
        ):
            alone += 1
            row = _wheel(found, folder)
            axis += row["axis_deg"] < 5.0
            history += row["correlation"] >= 0.98
            size += abs(row["size"] - 1.0) <= 0.1
        k1 = found.document["corrected"]["k1"]["after"]
        print(
            f"{folder.name:<24}{found.document['verdict']:<12}{row['axis_deg']:>7.1f}{row['correlation']:>8.3f}"
            f"{row['size']:>7.2f}{k1:>8.3f}{np.log(moments[0] / moments[1]):>8.3f}  {names}"
        )
    print(
        f"internal-rotor alone {alone}, axis within 5 deg {axis}, correlation .98 {history}, size within 10 % {size}, "
        f"of {len(folders)}"
    )
    assert alone >= 12 and axis >= 12
    if min(history, size) < 12:
        pytest.xfail(f"correlation .98 in {history}, size within 10 % in {size} of {len(folders)}, 12 wanted")


def test_drag_of_racquets(real_data: Path) -> None:
    folders = sorted((real_data / "racquets").iterdir())
    named, close = 0, 0
    for folder in folders:
        found, names = _found(folder)
        k = found.document["corrected"]
        print(
            f"\n{folder.name}: {found.document['verdict']} {names}, k1 {k['k1']['after']:.3f}, k2 {k['k2']['after']:.3f}",
            end="",
        )
        named += found.document["verdict"] == "named" and names == ["drag-by-axis"]
        close += abs(k["k1"]["after"] - RACQUET_K1) < 0.05
    print(f"\ndrag-by-axis alone {named}, k1 within .05 {close} (wanted: 7), of {len(folders)}")
    assert named >= 7
    if close < 7:
        pytest.xfail(f"k1 within .05 in {close} of {len(folders)}, 7 wanted")


def test_bounces_of_a_tossed_cube(real_data: Path) -> None:
    right, free = 0, 0
    folders = sorted((real_data / "tosses").iterdir())
    for folder in folders:
        found, names = _found(folder)
        truth = yaml.safe_load((folder / "truth" / "truth.yaml").read_text())
        verdict = found.document["verdict"]
        if truth["effect"] == "none":
            free += verdict == "none"
            print(f"\n{folder.name}: {verdict} {names}", end="")
            continue
        line = f"\n{folder.name}: {verdict} {names}"
        if verdict == "named" and names == ["impulse"]:
            effect = found.document["effects"][0]
            begins, lasts = effect["parameters"]["time"], effect["parameters"]["duration"]
            size = float(np.linalg.norm(effect["rate_change_rad_s"]))
            # the truth's times are those of the frames on either side
            at = begins < truth["time_s"][1] and begins + lasts > truth["time_s"][0]
            right += at and abs(size / truth["jump_rad_s"] - 1.0) < 0.1
            line += f", {begins:.4f} to {begins + lasts:.4f} s of {truth['time_s']}, jump {size:.2f} of {truth['jump_rad_s']:.2f}"
        print(line, end="")
    print(f"\nbounces right {right} of 4 (wanted: 3), free flights none {free} of 4")
    assert free == 4
    if right < 3:
        pytest.xfail(f"{right} of 4 bounces, 3 wanted: a steady wheel in a body of free inertia passes for the others")
