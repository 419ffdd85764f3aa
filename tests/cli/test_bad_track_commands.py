"""What bad sequences get from `massprops estimate`: one line and exit 2 or 3, or rows left out with their count."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from whole import assert_one_line, massprops

from massprops.simulation import simulate


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stereo sequence of 40 epochs with 8 features."""
    place = tmp_path_factory.mktemp("good") / "seq"
    return simulate("tracks", place, frames=40, features=8, seed=4)


Rows = list[list[str]]


def edit_rows(seq: Path, change: Callable[[Rows], Rows]) -> None:
    """Changes the rows of `tracks0/data.csv`, each a list of timestamp, camera, feature, u, v."""
    path = seq / "tracks0" / "data.csv"
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *(",".join(r) for r in change([r.split(",") for r in rows]))]) + "\n")


def edit_yaml(path: Path, **changes: object) -> None:
    content = {**yaml.safe_load(path.read_text()), **changes}
    path.write_text(yaml.safe_dump({k: v for k, v in content.items() if v is not None}))


def every(n: int, change: Callable[[list[str]], list[str]]) -> Callable[[Rows], Rows]:
    return lambda rows: [change(r) if i % n == 0 else r for i, r in enumerate(rows)]


def replaced(column: int, value: str) -> Callable[[list[str]], list[str]]:
    return lambda row: [*row[:column], value, *row[column + 1 :]]


def at(row_time: int) -> str:
    return str(row_time * 500_000_000)


def back(rows: Rows) -> Rows:
    """One epoch in five comes before the one ahead of it in the file."""
    late = {at(5 * i) for i in range(1, 8)}
    return [r for r in rows if r[0] not in late] + [r for r in rows if r[0] in late]


def seen_once(rows: Rows) -> Rows:
    return [*rows, [at(3), "0", "77", "600", "500"]]


def collinear(rows: Rows) -> Rows:
    """All features on one line of the body, as a truss seen end to end gives: pixels on one line of every image."""
    keep = {"0", "2"}
    ends: dict[tuple[str, str], dict[str, list[float]]] = {}
    for t, c, f, u, v in rows:
        if f in keep:
            ends.setdefault((t, c), {})[f] = [float(u), float(v)]
    out = []
    for (t, c), two in sorted(ends.items(), key=lambda e: (int(e[0][0]), e[0][1])):
        if len(two) == 2:
            (u0, v0), (u1, v1) = two["0"], two["2"]
            for k in range(5):
                s = k / 4
                out.append([t, c, str(k), f"{u0 + s * (u1 - u0)}", f"{v0 + s * (v1 - v0)}"])
    return out


def other_clock(rows: Rows) -> Rows:
    return [[str(int(r[0]) + 217_000_000), *r[1:]] if r[1] == "1" else r for r in rows]


LEFT_OUT = -1
"""Rows left out with a warning that counts them, and the rest estimated."""

CASES: dict[str, tuple[Callable[[Path], object], int, str]] = {
    "times go back": (lambda s: edit_rows(s, back), LEFT_OUT, "rows out of time order were sorted"),
    "rows repeated": (lambda s: edit_rows(s, lambda rows: rows + rows[:50]), LEFT_OUT, "50 rows that repeat a feature"),
    "times missing": (lambda s: edit_rows(s, every(7, replaced(0, ""))), LEFT_OUT, "left out"),
    "nan pixels": (lambda s: edit_rows(s, every(9, replaced(3, "nan"))), LEFT_OUT, "left out"),
    "infinite pixels": (lambda s: edit_rows(s, every(9, replaced(4, "inf"))), LEFT_OUT, "left out"),
    "pixels far away": (lambda s: edit_rows(s, every(9, replaced(4, "1e30"))), LEFT_OUT, "left out"),
    "a feature seen once": (lambda s: edit_rows(s, seen_once), LEFT_OUT, "1 features were seen fewer than three times"),
    "two features": (lambda s: edit_rows(s, lambda rows: [r for r in rows if r[2] in "02"]), 3, "three features"),
    "collinear": (lambda s: edit_rows(s, collinear), 3, "off a line"),
    "no baseline": (lambda s: shutil.copy(s / "cam0/sensor.yaml", s / "cam1/sensor.yaml"), 2, "baseline"),
    "no intrinsics": (lambda s: edit_yaml(s / "cam0/sensor.yaml", intrinsics=None), 2, "no intrinsics"),
    "intrinsics not finite": (
        lambda s: edit_yaml(s / "cam0/sensor.yaml", intrinsics=[1, 2, float("nan"), 3]),
        2,
        "4 finite numbers",
    ),
    "no sensor file": (lambda s: (s / "cam1/sensor.yaml").unlink(), 2, "no cam1/sensor.yaml"),
    "clocks differ": (lambda s: edit_rows(s, other_clock), 2, "clock"),
    "no tracks": (lambda s: edit_rows(s, lambda rows: []), 2, "tracks0"),
    "empty tracks file": (lambda s: (s / "tracks0/data.csv").write_text(""), 2, "tracks0"),
    "no such column": (lambda s: (s / "tracks0/data.csv").write_text("#a,b\n1,2\n"), 2, "column"),
    "binary tracks": (lambda s: (s / "tracks0/data.csv").write_bytes(bytes(range(256)) * 9), 2, "tracks0"),
    "nothing": (lambda s: shutil.rmtree(s), 2, "no such"),
    "body no body has": (
        lambda s: edit_yaml(s / "body.yaml", inertia=[[1, 0, 0], [0, 1, 0], [0, 0, 5]]),
        2,
        "triangle inequality",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_bad_sequence(good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str) -> None:
    change, code, says = CASES[case]
    seq = shutil.copytree(good, tmp_path / "seq")
    change(seq)
    out = tmp_path / "out"
    said = massprops(capfd, "estimate", seq, "-o", out, "-q", "--method", "smoother", "--method", "ekf")
    assert "Traceback" not in said.err and "unexpected" not in said.err
    if code != LEFT_OUT:
        assert_one_line(said, code, says)
        assert (code == 3) == out.exists()
        return
    warning = next(line for line in said.lines if says in line)
    assert warning.startswith("warning: ") and re.search(r": (\d+) ", warning), warning
    # the record is short: no ratios are claimed from it, with or without the rows
    content = json.loads((out / "estimates.json").read_text())
    assert said.code == 3 and len(content["estimators"]) == 2
    assert all(e["rate"]["speed_rad_s"] == pytest.approx(0.1047, rel=0.02) for e in content["estimators"])


PRIORS: dict[str, tuple[str, str]] = {
    "no such file": ("", "no such"),
    "not yaml": ("{", "prior.yaml"),
    "of nothing": ("{}", "prior.yaml"),
    "triangle inequality": (
        "format: massprops-filter/1\ninertia: [[1, 0, 0], [0, 1, 0], [0, 0, 5]]\n"
        "k_covariance: [[1.0e-4, 0], [0, 1.0e-4]]\naxes_covariance_rad2: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n",
        "triangle inequality",
    ),
}


@pytest.mark.parametrize("case", PRIORS)
def test_bad_prior(good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str) -> None:
    content, says = PRIORS[case]
    prior = tmp_path / "prior.yaml"
    if content:
        prior.write_text(content)
    said = massprops(capfd, "estimate", good, "-o", tmp_path / "out", "-q", "--method", "ekf", "--prior", prior)
    assert_one_line(said, 2, says)
    assert not (tmp_path / "out").exists()


def test_bad_options(good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("x")
    for options, says in (
        (("-o", tmp_path / "out", "--method", "magic"), "smoother"),
        (("-o", tmp_path / "file"), "choose another"),
        (("-o", good), "choose another"),
        (("-o", tmp_path / "out", "--model", tmp_path / "no.yaml"), "no such"),
    ):
        assert_one_line(massprops(capfd, "estimate", good, "-q", *options), 2, says)
    assert not (tmp_path / "out").exists()
