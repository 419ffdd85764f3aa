"""Blind diagnosis of sequences with hidden effects: the confusion table and the figures wanted, printed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from diagnose.blind import hide, judge

RUNS = int(os.environ.get("MASSPROPS_BLIND_RUNS", "120"))
FIRST = int(os.environ.get("MASSPROPS_BLIND_FIRST", "1000"))
FRAMES = 480


@pytest.mark.bench
def test_blind_diagnoses(tmp_path: Path, capsys) -> None:
    rows = []
    for seed in range(FIRST, FIRST + RUNS):
        folder, answer, out = (tmp_path / f"{seed}" / part for part in ("seq", "answer", "out"))
        hide(seed, folder, answer, FRAMES)
        before = os.times()
        done = subprocess.run(
            [sys.executable, "-m", "massprops_cli.main", "diagnose", str(folder), "-o", str(out), "-q"],
            capture_output=True,
            text=True,
            cwd=folder,
        )
        after = os.times()
        cpu = after.children_user + after.children_system - before.children_user - before.children_system
        told = json.loads((answer / "answer.json").read_text())
        if done.returncode != 0:
            rows.append({"kind": told["kind"], "truth": " + ".join(told["names"]), "said": "failed", "cpu": cpu})
            rows[-1] |= {
                "right": False,
                "listed": False,
                "before": 9.0,
                "after": 9.0,
                "worst_z": None,
                "verdict": "failed",
            }
            rows[-1]["error"] = done.stderr[-300:]
        else:
            rows.append({**judge(json.loads((out / "diagnosis.json").read_text()), told), "cpu": cpu})
        with capsys.disabled():
            r = rows[-1]
            print(
                f"{seed} {r['kind']:<8}{r['truth'][:44]:<45}{r['verdict']:<12}{r['said'][:44]:<45}"
                f"{r['before']:7.2f} ->{r['after']:7.3f}  z {r['worst_z'] or 0:4.1f}  {r['cpu']:5.1f} s  {time.strftime('%H:%M:%S')}",
                flush=True,
            )
    with capsys.disabled():
        print(summary(rows))
    shown = [r for r in rows if r["kind"] == "one" and r["before"] > 1.15]
    assert np.mean([r["listed"] for r in shown]) > 0.5


def summary(rows: list[dict]) -> str:
    """What was wanted beside what was measured, and the confusion table."""

    def share(values: list[bool]) -> str:
        return f"{100 * np.mean(values):5.1f} % of {len(values)}" if values else "–"

    def of(kind: str) -> list[dict]:
        return [r for r in rows if r["kind"] == kind]

    shown = [r for r in of("one") if r["before"] > 1.15]
    two = [r for r in of("two") if r["before"] > 1.15]
    named = [r for r in rows if r["right"] and r["truth"] not in ("none", "outside")]
    lines = [
        "",
        "wanted                                                        measured",
        f"one effect, residual above 1.15: named right      >= 95 %   {share([r['right'] for r in shown])}",
        f"... first or in the ambiguous list                >= 99 %   {share([r['listed'] for r in shown])}",
        f"none taken for something                          <=  2 %   {share([not r['right'] for r in of('none')])}",
        f"outside the catalogue: not misnamed               >= 90 %   {share([r['right'] for r in of('outside')])}",
        f"two effects, both named                           >= 80 %   {share([r['right'] for r in two])}",
        f"... or both in the ambiguous list                           {share([r['listed'] for r in two])}",
        f"held-out gap after at most 1.1                    >= 95 %   {share([r['after'] <= 1.1 for r in named])}",
        f"parameters within 3 sigma                         >= 95 %   {share([(r['worst_z'] or 0) <= 3 for r in named])}",
        f"CPU seconds: median {np.median([r['cpu'] for r in rows]):.0f}, largest {max(r['cpu'] for r in rows):.0f} (wanted < 60)",
        "",
        "confusion (truth -> said)",
    ]
    lines += [f"  {t:<50} {s:<50} {n}" for (t, s), n in sorted(Counter((r["truth"], r["said"]) for r in rows).items())]
    return "\n".join(lines)
