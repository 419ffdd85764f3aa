"""What bad or thin input gets, and the files that a diagnosis leaves."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from report.browser import check_page, needs_browser

from massprops import sequence_from_arrays
from massprops.diagnosis.search.residual_statistics import mean_square, whiteness
from massprops.model import load_model
from massprops.model.linearise import Residuals
from massprops.model.measurements import Measurements
from massprops.sensing.predict import Seen
from massprops.sequence import Environment, write_sequence
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks
from massprops_cli.main import run

SHORT = TrackScenario(frames=120, features=8, rate_deg=5.0, seed=3)


def _diagnose(folder: Path, out: Path) -> tuple[int, dict]:
    status = run(["diagnose", str(folder), "-o", str(out), "-q"])
    path = out / "diagnosis.json"
    return status, json.loads(path.read_text()) if path.is_file() else {}


@pytest.fixture(scope="module")
def damped(tmp_path_factory) -> tuple[Path, Path]:
    folder, out = tmp_path_factory.mktemp("seq"), tmp_path_factory.mktemp("out")
    made = simulate_tracks(replace(SHORT, effects=("viscous-damping:6",)))
    # no noise stated and no surroundings known: the first is estimated or assumed, the effects that need them skipped
    write_sequence(folder, replace(made.sequence, environment=Environment()))
    assert run(["diagnose", str(folder), "-o", str(out), "-q"]) == 0
    return folder, out


def test_the_files_are_there_and_say_the_same(damped) -> None:
    _, out = damped
    document = json.loads((out / "diagnosis.json").read_text())
    assert document["verdict"] in ("named", "ambiguous")
    assert "viscous-damping" in [e["name"] for e in document["effects"]]
    gap = document["gap"]
    assert gap["noise_floor"] == 1.0 and gap["held_out"]["after"] < gap["held_out"]["before"]
    assert load_model(out / "model.yaml").names[0] == document["effects"][0]["name"]
    names = [c["name"] for c in document["candidates"]]
    assert len(names) == len(set(names)), "an effect fitted from two starts is listed once"
    head, first = (out / "residual.csv").read_text().splitlines()[:2]
    assert head.startswith("#timestamp [ns],channel") and first.split(",")[1] == "tracks"
    page = (out / "report.html").read_text()
    assert f"<b>{document['verdict']}: viscous-damping" in page and "tracks held out, rms" in page and "s⁻¹" in page
    assert "<svg" in page and "http" not in page.split("<body")[1].split("www.w3.org")[0]


@needs_browser
def test_the_page_fits_its_window_and_is_accessible(damped, tmp_path) -> None:
    check_page(damped[1] / "report.html", tmp_path)


def test_effects_without_their_surroundings_are_skipped_and_said(damped) -> None:
    document = json.loads((damped[1] / "diagnosis.json").read_text())
    for name in ("gravity-gradient-torque", "eddy-current-torque", "solar-radiation-torque"):
        assert "needs" in document["skipped"][name]


def test_the_model_found_drives_simulate_and_estimate(damped, tmp_path: Path) -> None:
    folder, out = damped
    model = str(out / "model.yaml")
    again = tmp_path / "again"
    assert run(["simulate", "tracks", "-o", str(again), "--frames", "40", "--model", model, "-q"]) == 0
    assert "viscous-damping" in yaml.safe_load((again / "truth" / "truth.yaml").read_text())["effects"]
    place = tmp_path / "est"
    assert run(["estimate", str(folder), "--method", "smoother", "--model", model, "-o", str(place), "-q"]) == 0


def test_a_short_record_holds_nothing_out_and_says_so(tmp_path: Path) -> None:
    made = simulate_tracks(replace(SHORT, frames=40))
    write_sequence(tmp_path / "seq", made.sequence)
    status, document = _diagnose(tmp_path / "seq", tmp_path / "out")
    assert status == 0 and document["gap"]["held_out"]["before"] is None
    assert any("too few to hold any out" in w for w in document["warnings"])


def test_noise_not_stated_is_assumed_with_a_warning(tmp_path: Path) -> None:
    made = simulate_tracks(SHORT)
    cameras = {k: replace(c, sigma_px=None) for k, c in made.sequence.cameras.items()}
    write_sequence(tmp_path / "seq", replace(made.sequence, cameras=cameras))
    status, document = _diagnose(tmp_path / "seq", tmp_path / "out")
    assert status == 0 and any("sigma_px" in w for w in document["warnings"])


def test_features_that_all_come_late_are_still_diagnosed(tmp_path: Path) -> None:
    made = simulate_tracks(SHORT)
    t = made.sequence.tracks
    late = t.timestamp_ns > made.sequence.range.timestamp_ns[40]
    tracks = replace(
        t, timestamp_ns=t.timestamp_ns[late], camera=t.camera[late], feature=t.feature[late], uv=t.uv[late]
    )
    write_sequence(tmp_path / "seq", replace(made.sequence, tracks=tracks))
    status, document = _diagnose(tmp_path / "seq", tmp_path / "out")
    assert status == 0 and document["verdict"] == "none"


def test_a_body_file_that_contradicts_itself_is_one_line(tmp_path: Path, capsys) -> None:
    write_sequence(tmp_path / "seq", simulate_tracks(replace(SHORT, frames=40)).sequence)
    (tmp_path / "seq" / "body.yaml").write_text("inertia: [[1, 0, 0], [0, 1, 0], [0, 0, 5]]\ninertia_units: ratio\n")
    status, _ = _diagnose(tmp_path / "seq", tmp_path / "out")
    said = capsys.readouterr().err.strip()
    assert status == 2 and "triangle inequality" in said and len(said.splitlines()) == 1


@pytest.mark.parametrize("where", ["missing", "file"])
def test_no_sequence_or_no_place_is_one_line(tmp_path: Path, capsys, where: str) -> None:
    out = tmp_path / "out"
    if where == "file":
        write_sequence(tmp_path / "seq", simulate_tracks(replace(SHORT, frames=40)).sequence)
        out.write_text("")
    assert run(["diagnose", str(tmp_path / "seq"), "-o", str(out), "-q"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_misfit_and_whiteness_of_normal_noise_and_of_structure() -> None:
    rng = np.random.default_rng(0)
    epoch, feature = (a.ravel() for a in np.meshgrid(np.arange(200), np.arange(5), indexing="ij"))
    seen = Seen(epoch, np.zeros(1000, int), feature, np.zeros(1000))
    none = np.zeros(0, int)
    m = Measurements(seen, np.zeros((1000, 2)), np.ones(1000), none, none, none)
    noise = rng.standard_normal((1000, 2))
    empty = (np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    white = Residuals(noise, *empty)
    assert mean_square(white) == pytest.approx(1.0, abs=0.1) and abs(whiteness(white, m)) < 4
    wave = Residuals(noise + np.sin(epoch / 20.0)[:, None], *empty)
    assert mean_square(wave) > 1.3 and whiteness(wave, m) > 8


@pytest.mark.parametrize("name", ["config_b_LOG00152", "config_b_LOG00156"])
def test_a_body_that_hardly_turns_is_not_observable(real_data: Path, tmp_path: Path, name: str) -> None:
    status, document = _diagnose(real_data / "throws" / name, tmp_path / "out")
    assert status == 3 and document["verdict"] == "none" and "not observable" in document["reason"]


def test_a_short_turn_ends_with_exit_code_3_and_keeps_what_was_computed(tmp_path: Path) -> None:
    """So do several records of which none turns enough; one that does is enough."""
    t = np.arange(0.0, 1.0, 0.01)
    rng = np.random.default_rng(4)
    for name, size in (("short", 0.1), ("other", 0.15), ("long", 6.0)):
        w = size * np.stack([np.cos(2.0 * t), np.sin(2.0 * t), 0.5 + 0.0 * t], axis=1)
        noisy = w + 1e-3 * rng.standard_normal(w.shape)
        write_sequence(tmp_path / name, sequence_from_arrays(t, rates=noisy, rate_sigma=1e-3))
    assert _diagnose(tmp_path / "short", tmp_path / "out")[0] == 3
    assert (tmp_path / "out" / "report.html").is_file()
    assert run(["diagnose", *(str(tmp_path / n) for n in ("short", "other")), "-q"]) == 3
    assert run(["diagnose", *(str(tmp_path / n) for n in ("short", "long")), "-q"]) == 0
