"""The sequence folder: what is written comes back, and bad rows are left out and counted."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from massprops.errors import InputError
from massprops.sequence import (
    AttitudeSeries,
    Body,
    Camera,
    Environment,
    Orbit,
    RangeSeries,
    RateSeries,
    RotorSeries,
    Sequence,
    Tracks,
    read_sequence,
    write_sequence,
)
from massprops.sequence.truth import read_truth


def example() -> Sequence:
    t = np.arange(3, dtype=np.int64) * 10**9
    return Sequence(
        cameras={
            0: Camera((640, 480), np.array([800.0, 800, 320, 240]), np.array([0.1, 0, 0, 0]), sigma_px=0.3, rate_hz=1.0)
        },
        tracks=Tracks(np.repeat(t, 2), np.zeros(6, int), np.tile([4, 7], 3), np.arange(12.0).reshape(6, 2)),
        range=RangeSeries(t, np.array([10.0, 10.1, 10.2]), 0.05),
        rates=RateSeries(t, np.arange(9.0).reshape(3, 3), 0.01),
        rotor=RotorSeries(t, np.array([0.0, 10.0, 20.0]), np.array([0.6, 0.0, -0.8]), 2e-6),
        attitude=AttitudeSeries(t, np.tile([0.6, 0.8, 0, 0], (3, 1)), np.full(3, 1e-3)),
        body=Body(np.diag([1.0, 2.0, 2.5]), source="test"),
        environment=Environment("lvlh", Orbit(3.986e14, 7e6, 0.01, 0.3), np.array([0, 0, 1.0]), np.array([1e-5, 0, 0])),
    )


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    write_sequence(tmp_path, example(), truth={"k1": -0.2})
    back, want = read_sequence(tmp_path), example()
    assert back.warnings == ()
    for part in ("tracks", "range", "rates", "attitude", "rotor"):
        a, b = getattr(back, part), getattr(want, part)
        for name, value in vars(b).items():
            assert np.allclose(getattr(a, name), value), (part, name)
    assert back.environment.orbit is not None and back.environment.orbit.eccentricity == 0.01
    assert back.cameras[0].sigma_px == 0.3 and np.allclose(back.cameras[0].distortion, [0.1, 0, 0, 0])
    assert back.body is not None and np.allclose(back.body.inertia, np.diag([1, 2, 2.5]))
    truth = read_truth(tmp_path)
    assert truth is not None and truth.facts["k1"] == -0.2


def test_columns_are_found_by_name_and_bad_rows_counted(tmp_path: Path) -> None:
    write_sequence(tmp_path, example())
    (tmp_path / "tracks0/data.csv").write_text(
        "#timestamp [us],feature,v [px],camera,u [px],extra\n"
        "1000,3,20.5,0,10.5,x\n1000,3,21,0,11,x\n2000,4,nan,0,1,x\n2000,5,1,0,inf,x\n2000,6,1,2,1,x\nrubbish\n500,3,1,0,2,x\n"
    )
    read = read_sequence(tmp_path)
    assert read.tracks is not None
    assert read.tracks.timestamp_ns.tolist() == [500_000, 1_000_000]
    assert read.tracks.uv.tolist() == [[2.0, 1.0], [10.5, 20.5]]
    text = " ".join(read.warnings)
    assert (
        "3 rows with missing" in text
        and "repeat a feature" in text
        and "sorted" in text
        and "camera is not 0 or 1" in text
    )


def test_times_that_go_back_or_repeat_are_left_out(tmp_path: Path) -> None:
    write_sequence(tmp_path, example())
    (tmp_path / "imu0/data.csv").write_text(
        "#timestamp [ms],w_x,w_y,w_z\n1,0,0,1\n2,0,0,2\n2,0,0,3\n1,0,0,4\n5,0,0,5\n"
    )
    read = read_sequence(tmp_path)
    assert read.rates is not None and read.rates.w[:, 2].tolist() == [1, 2, 5]
    assert any("2 rows whose timestamp" in w for w in read.warnings)


def test_a_clock_that_was_set_back_is_refused(tmp_path: Path) -> None:
    write_sequence(tmp_path, example())
    times = [*range(1, 41), *range(20, 60)]
    rows = "".join(f"{t},0,0,{k}\n" for k, t in enumerate(times))
    (tmp_path / "imu0/data.csv").write_text("#timestamp [ms],w_x,w_y,w_z\n" + rows)
    with pytest.raises(InputError, match="line 42: its time is 0.02 s earlier than the row before, and 20 rows run on"):
        read_sequence(tmp_path)


def test_a_table_of_which_most_would_be_left_out_is_refused(tmp_path: Path) -> None:
    write_sequence(tmp_path, example())
    (tmp_path / "imu0/data.csv").write_text("#timestamp [ms],w_x,w_y,w_z\n4,0,0,1\n3,0,0,2\n2,0,0,3\n1,0,0,4\n")
    with pytest.raises(InputError, match="3 of 4 rows have a time that is repeated or goes back: sort them"):
        read_sequence(tmp_path)


@pytest.mark.parametrize(
    ("file", "text", "says"),
    [
        ("cam0/sensor.yaml", "resolution: [640, 480]\n", "no intrinsics"),
        ("cam0/sensor.yaml", "intrinsics: [800, 800, .nan, 240]\n", "finite"),
        ("cam0/sensor.yaml", "intrinsics: [0, 800, 320, 240]\n", "focal"),
        ("cam0/sensor.yaml", "- a list\n", "names with values"),
        ("cam0/sensor.yaml", "a: [1, 2\n", "not YAML"),
        ("body.yaml", "inertia: [[1, 0, 0], [0, 1, 0], [0, 0, 3]]\n", "triangle"),
        ("body.yaml", "inertia: [[1, 2, 0], [0, 1, 0], [0, 0, 1]]\n", "symmetric"),
        ("environment.yaml", "chaser_attitude: upside-down\n", "inertial or lvlh"),
        ("environment.yaml", "orbit: {mu_m3_s2: 1.0}\n", "semi_major_axis_m"),
        ("environment.yaml", "magnetic_dipole_T_m3: [0, 0, -8.0e15]\n", "magnetic_dipole_T_m3 needs orbit"),
        (
            "environment.yaml",
            "magnetic_field_T: [0, 0, 1e-5]\nmagnetic_dipole_T_m3: [0, 0, -8.0e15]\n"
            "orbit: {mu_m3_s2: 4.0e14, semi_major_axis_m: 7.0e6, eccentricity: 0, true_anomaly_rad: 0}\n",
            "in place of magnetic_field_T",
        ),
        ("tracks0/data.csv", "#timestamp [ns],camera,u [px],v [px]\n", "no column feature"),
    ],
)
def test_files_that_contradict_themselves(tmp_path: Path, file: str, text: str, says: str) -> None:
    write_sequence(tmp_path, example())
    (tmp_path / file).write_text(text)
    with pytest.raises(InputError, match=says):
        read_sequence(tmp_path)


def test_the_dipole_of_a_planet_comes_back(tmp_path: Path) -> None:
    own = replace(example().environment, magnetic_field_T=None, magnetic_dipole_T_m3=np.array([0.0, 1e15, -8e15]))
    write_sequence(tmp_path, replace(example(), environment=own))
    back = read_sequence(tmp_path).environment
    assert back.magnetic_field_T is None and np.allclose(back.magnetic_dipole_T_m3, [0.0, 1e15, -8e15])


@pytest.mark.parametrize("name", ["body.yaml", "environment.yaml", "imu0", "imu0/data.csv", "cam0/sensor.yaml"])
@pytest.mark.parametrize("kind", ["link", "loop", "device", "pipe", "folder"])
def test_what_cannot_be_read_is_not_taken_for_absent(tmp_path: Path, name: str, kind: str) -> None:
    write_sequence(tmp_path, example())
    place = tmp_path / name
    place.rename(tmp_path / "aside")
    if kind in ("link", "loop"):
        place.symlink_to({"link": tmp_path / "moved", "loop": place}[kind])
    elif name == "imu0":
        return  # a folder that was never there
    elif kind == "device":
        place.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(place)
    else:
        place.mkdir()
    with pytest.raises(InputError, match=f"{name}: (a link that leads nowhere|is a folder, pipe or device)"):
        read_sequence(tmp_path)


def test_nothing_there(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "none"):
        with pytest.raises(InputError):
            read_sequence(folder)


def test_images_outside_the_folder_are_not_taken(tmp_path: Path) -> None:
    write_sequence(tmp_path / "s", example())
    (tmp_path / "secret.png").write_text("x")
    (tmp_path / "s/cam0/data").mkdir()
    (tmp_path / "s/cam0/data.csv").write_text("#timestamp [ns],filename\n1,../../../secret.png\n")
    assert read_sequence(tmp_path / "s").cameras[0].images == ()


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=300), st.sampled_from(["tracks0", "imu0", "attitude0", "range0", "rotor0"]))
def test_no_table_breaks_the_reader(tmp_path: Path, text: str, sensor: str) -> None:
    write_sequence(tmp_path, example())
    (tmp_path / sensor / "data.csv").write_text(text, encoding="utf-8", errors="replace")
    try:
        read = read_sequence(tmp_path)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        if read.tracks is not None:
            assert np.isfinite(read.tracks.uv).all() and np.all(np.diff(read.tracks.timestamp_ns) >= 0)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=200), st.sampled_from(["body.yaml", "environment.yaml", "cam0/sensor.yaml"]))
def test_no_yaml_breaks_the_reader(tmp_path: Path, text: str, name: str) -> None:
    write_sequence(tmp_path, example())
    (tmp_path / name).write_text(text, encoding="utf-8", errors="replace")
    try:
        read_sequence(tmp_path)
    except InputError as error:
        assert str(error)


def test_real_throws(real_data: Path) -> None:
    for folder in sorted((real_data / "throws").iterdir()):
        read = read_sequence(folder)
        assert read.rates is not None and len(read.rates.w) > 400 and read.body is None
