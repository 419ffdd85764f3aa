"""`massprops estimate`: what runs, what is skipped and why, what is written, and a prior that is right or wrong."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from estimators.made_sequence import AXES, TRUE_K, make_sequence, simple_method

from massprops import estimate
from massprops.errors import InputError, NotPossible
from massprops.estimators import methods as registry
from massprops.estimators.estimate import estimate_all
from massprops.estimators.prior import read_filter
from massprops.mass.ratio_space import inertia_of


@pytest.fixture
def two_methods(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"simple": simple_method(), "ranger": simple_method("ranger", ("range", "tracks"))}
    monkeypatch.setattr(registry, "methods", lambda: found)


def filter_file(path: Path, k: np.ndarray, sigma: float, **changes: object) -> Path:
    import yaml

    content: dict = {
        "format": "massprops-filter/1",
        "inertia": inertia_of(k, AXES).tolist(),
        "inertia_ratios": {"k1": float(k[0]), "k2": float(k[1])},
        "k_covariance": (np.eye(2) * sigma**2).tolist(),
        "axes_covariance_rad2": (np.eye(3) * sigma**2).tolist(),
        "process_noise": 1e-5,
    }
    path.write_text(yaml.safe_dump({**content, **changes}))
    return path


@pytest.mark.parametrize("attitude", [False, True])
def test_writes_all_or_nothing_and_measures_errors_against_truth(
    two_methods: None, tmp_path: Path, attitude: bool
) -> None:
    folder = make_sequence(tmp_path / "seq", attitude=attitude)
    found = estimate(folder, out=tmp_path / "out")
    assert [e.name for e in found] == ["simple"]
    written = sorted(p.name for p in (tmp_path / "out").iterdir() if p.name != ".massprops")
    assert written == ["estimates.json", "report.html", "simple.csv"]
    content = json.loads((tmp_path / "out" / "estimates.json").read_text())
    assert [s["name"] for s in content["skipped"]] == ["ranger"] and "range0" in content["skipped"][0]["reason"]
    errors = content["against_truth"]["simple"]
    assert abs(errors["k1_error"]) < 0.03 and abs(errors["k2_error"]) < 0.03
    assert errors["axes_error_deg"] < 3 and errors["attitude_rms_rad"] < 0.01 and errors["rate_rms_rad_s"] < 0.02
    header, first = (tmp_path / "out" / "simple.csv").read_text().splitlines()[:2]
    assert header.startswith("#timestamp [ns],q_w []") and len(header.split(",")) == len(first.split(","))
    page = (tmp_path / "out" / "report.html").read_text()
    assert "rate error" in page and 'class="band"' in page
    assert not re.search(r'(?:src|href)="(?:https?:)?//', page)


def test_an_estimate_is_never_written_into_a_run_or_a_sequence(two_methods: None, tmp_path: Path) -> None:
    folder = make_sequence(tmp_path / "seq")
    before = sorted(folder.rglob("*"))
    with pytest.raises(InputError, match="choose another -o"):
        estimate(folder, out=folder)
    assert sorted(folder.rglob("*")) == before


def test_another_method_later_leaves_the_first_ones_history(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = {"simple": simple_method(), "other": simple_method("other")}
    monkeypatch.setattr(registry, "methods", lambda: found)
    folder, out = make_sequence(tmp_path / "<img src=x onerror=alert(1)>"), tmp_path / "out"
    estimate(folder, out, method="simple")
    history = (out / "simple.csv").read_text()
    estimate(folder, out, method="other")
    content = json.loads((out / "estimates.json").read_text())
    assert sorted(e["name"] for e in content["estimators"]) == ["other", "simple"]
    assert (out / "simple.csv").read_text() == history and (out / "other.csv").is_file()
    page = (out / "report.html").read_text()
    assert "simple.csv" in page and "<img src=x" not in page and "&lt;img src=x" in page
    estimate(make_sequence(tmp_path / "two", attitude=True), out, method="other")
    content = json.loads((out / "estimates.json").read_text())
    assert [e["name"] for e in content["estimators"]] == ["other"], "of other data nothing stays in sight"
    assert not (out / "simple.csv").exists()
    assert (out / ".massprops/previous/estimate/simple.csv").read_text() == history


def test_named_method_without_its_sensor_is_not_possible(two_methods: None, tmp_path: Path) -> None:
    folder = make_sequence(tmp_path / "seq")
    with pytest.raises(NotPossible, match="ranger needs ranges"):
        estimate(folder, method="ranger")
    with pytest.raises(InputError, match="no such estimator; there are simple, ranger and all"):
        estimate(folder, method="kalman")


@pytest.mark.parametrize("error", [np.linalg.LinAlgError, ValueError, IndexError, OverflowError])
def test_a_method_that_breaks_down_costs_no_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, error: type[Exception]
) -> None:
    broken, mad = simple_method("broken"), simple_method("mad")
    honest = mad.estimate

    def singular(problem, prior, start):  # type: ignore[no-untyped-def]
        raise error("array must not contain infs")

    def not_finite(problem, prior, start):  # type: ignore[no-untyped-def]
        from dataclasses import replace

        return replace(honest(problem, prior, start), k1=float("nan"))

    broken.estimate, mad.estimate = singular, not_finite  # type: ignore[attr-defined]
    monkeypatch.setattr(registry, "methods", lambda: {m.NAME: m for m in (broken, mad, simple_method())})
    outcome = estimate_all(make_sequence(tmp_path / "seq"))
    assert list(outcome.skipped) == ["broken"] and error.__name__ in outcome.skipped["broken"]
    assert [e.name for e in outcome.sound] == ["simple"]
    assert not outcome.estimates[0].converged and outcome.estimates[0].reason


def test_right_prior_is_used_and_wrong_one_is_noticed_and_overcome(two_methods: None, tmp_path: Path) -> None:
    folder = make_sequence(tmp_path / "seq")
    right = estimate_all(folder, ["simple"], filter_file(tmp_path / "right.yaml", TRUE_K, 0.002))
    assert right.prior is not None and right.prior.verdict == "used" and right.prior.p_value > 1e-3
    assert abs(right.estimates[0].k1 - TRUE_K[0]) < 0.004
    wrong = estimate_all(folder, ["simple"], filter_file(tmp_path / "wrong.yaml", TRUE_K + [0.2, -0.15], 0.002))
    assert wrong.prior is not None and wrong.prior.verdict == "rejected" and wrong.prior.p_value < 1e-6
    assert abs(wrong.estimates[0].k1 - TRUE_K[0]) < 0.04  # blindly averaged it would be 0.2 off
    assert any("contradict the prior" in line for line in wrong.warnings)


def test_prior_axes_are_tied_by_common_features(two_methods: None, tmp_path: Path) -> None:
    """The prior's frame is turned at random and its lengths are in another unit: the features bring both back."""
    from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix

    folder = make_sequence(tmp_path / "seq")
    points = np.random.default_rng(0).uniform(-1, 1, (12, 3))
    R = rotation_matrix(from_rotation_vector(np.array([0.4, -1.0, 0.7])))
    features = {"units": "model", "sigma": 0.01, "ids": list(range(100, 112)), "xyz": (0.3 * points @ R.T).tolist()}
    turned = (R @ inertia_of(TRUE_K, AXES) @ R.T).tolist()
    outcome = estimate_all(
        folder, ["simple"], filter_file(tmp_path / "f.yaml", TRUE_K, 0.01, inertia=turned, features=features)
    )
    assert outcome.prior is not None and outcome.prior.frame == "features" and outcome.prior.verdict == "used"
    tied = outcome.prior.prior
    assert np.allclose(tied.inertia, outcome.estimates[0].inertia, atol=0.01)
    assert tied.features is not None and np.allclose(
        np.linalg.norm(tied.features, axis=1), np.linalg.norm(points, axis=1), rtol=0.02
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"inertia": np.diag([1.0, 1.0, 3.0]).tolist(), "inertia_ratios": None}, "triangle inequality"),
        ({"inertia": None, "inertia_ratios": {"k1": -2.0, "k2": -1.0}}, "triangle inequality"),
        ({"inertia": np.diag([-1.0, 1.0, 1.0]).tolist(), "inertia_ratios": None}, "above 0"),
        ({"inertia": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]], "inertia_ratios": None}, "not symmetric"),
        ({"inertia": [[1, 0], [0, 1]]}, "3 x 3"),
        ({"inertia": float("nan")}, "3 x 3"),
        ({"inertia_ratios": {"k1": -0.9, "k2": -0.1}}, "correct one of them"),
        ({"inertia_ratios": {"k1": 0.5, "k2": -0.1}}, "k1 must be from -60"),
        ({"k_covariance": [[1, 2], [2, 1]]}, "not a covariance"),
        ({"process_noise": -1.0}, "process_noise must be from 0"),
        ({"features": {"ids": [1, 1], "xyz": [[0, 0, 0], [1, 0, 0]]}}, "different"),
        ({"features": {"ids": [1, 2], "xyz": [[0, 0, 0]]}}, "for each of the 2 ids"),
        ({"frame": {"mark": [["a"]]}}, "mark"),
        ({"format": "massprops/1"}, "export RUN --to filter"),
    ],
)
def test_prior_that_no_body_has_is_one_clear_line(tmp_path: Path, changes: dict, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        read_filter(filter_file(tmp_path / "f.yaml", TRUE_K, 0.01, **changes))
    assert "\n" not in str(caught.value) and "f.yaml" in str(caught.value)


def test_prior_of_ratios_alone(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_text("inertia_ratios: {k1: -0.25, k2: -0.15}\n")
    found = read_filter(path)
    assert np.allclose(found.prior.inertia, inertia_of(TRUE_K, np.eye(3)))
    with pytest.raises(InputError, match="no such file"):
        read_filter(tmp_path / "absent.yaml")


def test_command_line(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "massprops_cli.main", "estimate", "--help"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and "--prior" in done.stdout
    absent = subprocess.run(
        [sys.executable, "-m", "massprops_cli.main", "estimate", str(tmp_path / "no"), "-o", str(tmp_path / "o")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert absent.returncode == 2 and len(absent.stderr.strip().splitlines()) == 1
    heavy = "import sys, massprops_cli.estimate; print([m for m in ('numpy', 'numba', 'scipy') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True).stdout.strip() == "[]"


def test_memory_is_counted_before_tracks_are_laid_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from massprops.model.problem import problem_of
    from massprops.sequence import read_sequence
    from massprops.simulation.track_scenario import TrackScenario
    from massprops.simulation.tracks import simulate_tracks

    sequence = read_sequence(make_sequence(tmp_path / "seq", epochs=20))
    monkeypatch.setattr("massprops.memory.machine_bytes", lambda: 10_000)
    with pytest.raises(InputError, match="20 epochs of 12 features in 2 cameras would take .* GB of memory"):
        problem_of(sequence)
    with pytest.raises(InputError, match="1000 frames of 500 features would take"):
        simulate_tracks(TrackScenario(frames=1000, features=500))
