"""Reads a sequence folder. The truth in it is never opened here: see `massprops.sequence.truth`."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import numpy as np

from massprops.documents.body import BodyFile
from massprops.documents.environment import EnvironmentFile
from massprops.documents.fields import read, unread
from massprops.documents.loading import load_yaml
from massprops.documents.sensor import CameraFile, GyroscopeFile, RangeFile, RotorFile
from massprops.documents.tables import ATTITUDE, GYROSCOPE, IMAGES, RANGE, ROTOR, TRACKS, Table
from massprops.errors import InputError
from massprops.sequence.data import (
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
)
from massprops.sequence.table import check_times, read_table

S = TypeVar("S")
SMALLEST_MOMENT = 1e-50
"""Of an inertia: below it products of moments are no numbers any more."""
SET_BACK = 10
"""Rows in a row, each later than the one before and earlier than one before them, that show a clock which was set back."""


def read_sequence(folder: str | Path) -> Sequence:
    """All of a sequence folder except the truth.

    A run folder is taken as the sequence inside it. Rows that cannot be used are left out and counted in `warnings`.

    Raises:
        InputError: not a folder, nothing of a sequence in it, or a file that contradicts itself.
    """
    folder = Path(folder)
    if (folder / "sequence").is_dir() and not (folder / "tracks0").is_dir():
        folder = folder / "sequence"
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give a sequence folder or a run folder")
    warnings: list[str] = []
    cameras = {i: _camera(folder / f"cam{i}", warnings) for i in (0, 1) if _there(folder / f"cam{i}" / "sensor.yaml")}
    sequence = Sequence(
        cameras=cameras,
        tracks=_tracks(folder / "tracks0" / "data.csv", cameras, warnings),
        range=_range(folder / "range0", warnings),
        rates=_rates(folder / "imu0", warnings),
        attitude=_attitude(folder / "attitude0" / "data.csv", warnings),
        body=_body(folder / "body.yaml"),
        environment=_environment(folder / "environment.yaml"),
        rotor=_rotor(folder / "rotor0", warnings),
        warnings=tuple(warnings),
        folder=folder,
    )
    if not any((cameras, sequence.tracks, sequence.range, sequence.rates, sequence.attitude)):
        raise InputError(f"{folder}: nothing of a sequence here; expected cam0, tracks0, range0, imu0 or attitude0")
    return sequence


def sequence_with(folder: Path, sensor: str) -> Sequence | None:
    """The sequence in a folder that holds such a sensor, `range0` or `attitude0`; None of any other folder or file.

    Raises:
        InputError: as `read_sequence`.
    """
    return read_sequence(folder) if (folder / sensor / "data.csv").is_file() else None


def _there(path: Path) -> bool:
    """Whether the sequence has a file. A link that leads nowhere is not taken for a file that was never there.

    Raises:
        InputError: the file or its folder is such a link, or something stands there that is no file.
    """
    if path.is_file():
        return True
    for place in (path.parent, path):
        if place.is_symlink() and not place.exists():
            raise InputError(f"{place}: a link that leads nowhere: mend it, or remove it")
    if path.exists():
        raise InputError(f"{path}: is a folder, pipe or device: put a file in its place, or remove it")
    return False


def _camera(folder: Path, warnings: list[str]) -> Camera:
    path = folder / "sensor.yaml"
    content, strange = unread(CameraFile, load_yaml(path), str(path))
    warnings += strange
    document = read(CameraFile, content, str(path))
    intrinsics = document.intrinsics
    if not (intrinsics[:2] > 0).all():
        raise InputError(f"{path}: focal lengths fu, fv must be above 0")
    pose = document.T_BS if document.T_BS is not None else np.eye(4)
    turn = pose[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or np.linalg.det(turn) < 0:
        raise InputError(
            f"{path}: the left three columns of T_BS are no rotation: give the sensor's axes as a rotation matrix"
        )
    if not np.allclose(pose[3], [0, 0, 0, 1], atol=1e-3):
        raise InputError(f"{path}: the last row of T_BS must be 0, 0, 0, 1")
    size = document.resolution if document.resolution is not None else np.maximum(2 * intrinsics[2:], 1.0)
    return Camera(
        resolution=(int(size[0]), int(size[1])),
        intrinsics=intrinsics,
        distortion=np.zeros(4) if document.distortion_coefficients is None else document.distortion_coefficients,
        T_BS=pose,
        sigma_px=document.sigma_px,
        rate_hz=document.rate_hz,
        video=folder / "video.mp4" if _there(folder / "video.mp4") else None,
        images=_images(folder, warnings),
        stated=document.resolution is not None,
    )


def _images(folder: Path, warnings: list[str]) -> tuple[tuple[int, Path], ...]:
    path = folder / "data.csv"
    if not _there(path):
        return ()
    rows = read_table(path, IMAGES)
    _count(warnings, path, rows.left_out, "rows that cannot be read")
    inside = (folder / "data").resolve()
    images = []
    for stamp, name in zip(rows.columns["timestamp"], rows.columns["filename"], strict=True):
        file = inside / str(name)
        if len(str(name)) < 256 and file.resolve().parent == inside and file.is_file():
            images.append((int(stamp), file.resolve()))
    return tuple(images)


def _series(path: Path, columns: Table, warnings: list[str]) -> dict[str, np.ndarray]:
    """A table with times in order: repeated times keep their first row, times that go back are left out.

    Raises:
        InputError: most of its rows would be left out, so that the others are no record of anything, or the clock was set back.
    """
    rows = read_table(path, columns)
    table = rows.columns
    _count(warnings, path, rows.left_out, "rows with missing, unreadable or infinite values")
    stamp = table["timestamp"]
    if len(stamp):
        # one row on a later clock must not make all rows after it go back
        order = np.argsort(stamp, kind="stable")
        check_times(path, stamp[order], rows.lines[order])
        forward = stamp > np.concatenate([[stamp[0] - 1], np.maximum.accumulate(stamp)[:-1]])
        gone = int((~forward).sum())
        if 2 * gone > len(stamp):
            raise InputError(
                f"{path}: {gone} of {len(stamp)} rows have a time that is repeated or goes back: sort them"
            )
        _refuse_set_back(path, stamp, rows.lines, forward)
        _count(warnings, path, gone, "rows whose timestamp is repeated or goes back")
        table = {name: values[forward] for name, values in table.items()}
    return table


def _refuse_set_back(path: Path, stamp: np.ndarray, lines: np.ndarray, forward: np.ndarray) -> None:
    """Refuses times that go back once and run on from there, row by row: the rows after it would be taken for later than they are.

    Args:
        stamp: (n,) [ns] as they stand in the file; lines: (n,) where; forward: (n,) which are later than all before.
    """
    runs_on = ~forward[1:] & ~forward[:-1] & (np.diff(stamp) > 0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], runs_on, [False]]).astype(int)))
    for begins, ends in edges.reshape(-1, 2):
        if ends - begins >= SET_BACK:
            back = (stamp[begins - 1] - stamp[begins]) * 1e-9
            raise InputError(
                f"{path}: line {lines[begins]}: its time is {back:.4g} s earlier than the row before, and {ends - begins} rows run "
                "on from there: a clock was set back, or two records are in one file. Keep one of them"
            )


def _tracks(path: Path, cameras: dict[int, Camera], warnings: list[str]) -> Tracks | None:
    if not _there(path):
        return None
    rows = read_table(path, TRACKS)
    table = {**rows.columns, "line": rows.lines}
    _count(warnings, path, rows.left_out, "rows with missing, unreadable or infinite values")
    whole = (table["camera"] == np.round(table["camera"])) & (table["feature"] == np.round(table["feature"]))
    known = whole & np.isin(table["camera"], [0, 1]) & (np.abs(table["feature"]) < 2**53)
    _count(warnings, path, int((~known).sum()), "rows whose camera is not 0 or 1, or whose feature is no integer")
    inside = known & (np.abs(table["u"]) < 1e6) & (np.abs(table["v"]) < 1e6)
    _count(warnings, path, int((known & ~inside).sum()), "rows with pixels a million from the image")
    table = {name: values[inside] for name, values in table.items()}
    stamp = table["timestamp"]
    camera, feature = table["camera"].astype(np.int64), table["feature"].astype(np.int64)
    newest = np.maximum.accumulate(stamp) if len(stamp) else stamp
    back = stamp < newest
    if back.any():
        warnings.append(f"{path}: {int(back.sum())} rows out of time order were sorted")
    order = np.lexsort((feature, camera, stamp))
    check_times(path, stamp[order], table["line"][order])
    stamp, camera, feature = stamp[order], camera[order], feature[order]
    uv = np.column_stack([table["u"], table["v"]])[order]
    if len(stamp):
        same = (np.diff(stamp) == 0) & (np.diff(camera) == 0) & (np.diff(feature) == 0)
        first = np.concatenate([[True], ~same])
        _count(warnings, path, int((~first).sum()), "rows that repeat a feature in the same image")
        stamp, camera, feature, uv = stamp[first], camera[first], feature[first], uv[first]
    missing = sorted(set(np.unique(camera).tolist()) - set(cameras))
    if missing and cameras:
        raise InputError(
            f"{path}: tracks of camera {missing[0]}, but there is no cam{missing[0]}/sensor.yaml with its intrinsics"
        )
    return Tracks(stamp, camera, feature, uv)


def _range(folder: Path, warnings: list[str]) -> RangeSeries | None:
    if not _there(folder / "data.csv"):
        return None
    table = _series(folder / "data.csv", RANGE, warnings)
    positive = table["range"] > 0
    _count(warnings, folder / "data.csv", int((~positive).sum()), "ranges that are not positive")
    return RangeSeries(
        table["timestamp"][positive], table["range"][positive], _sensor(RangeFile, folder, warnings).sigma_m
    )


def _rates(folder: Path, warnings: list[str]) -> RateSeries | None:
    if not _there(folder / "data.csv"):
        return None
    table = _series(folder / "data.csv", GYROSCOPE, warnings)
    w = np.column_stack([table[k] for k in ("w_x", "w_y", "w_z")])
    return RateSeries(table["timestamp"], w, _sensor(GyroscopeFile, folder, warnings).sigma_rad_s)


def _rotor(folder: Path, warnings: list[str]) -> RotorSeries | None:
    if not _there(folder / "data.csv"):
        return None
    table, sensor = _series(folder / "data.csv", ROTOR, warnings), _sensor(RotorFile, folder, warnings)
    axis = _unit(sensor.axis, f"{folder / 'sensor.yaml'}: axis has no length: give a direction, or leave it out")
    return RotorSeries(table["timestamp"], table["rate"], axis, sensor.inertia_kg_m2)


def _attitude(path: Path, warnings: list[str]) -> AttitudeSeries | None:
    if not _there(path):
        return None
    table = _series(path, ATTITUDE, warnings)
    q = np.column_stack([table[k] for k in ("q_w", "q_x", "q_y", "q_z")])
    norm = np.linalg.norm(q, axis=1)
    unit = np.abs(norm - 1) < 0.01
    _count(warnings, path, int((~unit).sum()), "quaternions that are not unit")
    q, norm = q[unit], norm[unit]
    return AttitudeSeries(table["timestamp"][unit], q / norm[:, None], np.maximum(table["sigma"][unit], 1e-9))


def _sensor(kind: type[S], folder: Path, warnings: list[str]) -> S:
    """What a sensor's file says; everything absent when there is none."""
    path = folder / "sensor.yaml"
    if not _there(path):
        return kind()
    content, strange = unread(kind, load_yaml(path), str(path))
    warnings += strange
    return read(kind, content, str(path))


def _body(path: Path) -> Body | None:
    if not _there(path):
        return None
    document = read(BodyFile, load_yaml(path), str(path))
    inertia = document.inertia
    if inertia is None:
        return None
    if not np.allclose(inertia, inertia.T, rtol=1e-6, atol=1e-12 * float(np.abs(inertia).max())):
        raise InputError(f"{path}: inertia is not symmetric")
    low, middle, high = np.linalg.eigvalsh(inertia)
    if not low > SMALLEST_MOMENT or low + middle < high * (1 - 1e-6):
        raise InputError(f"{path}: principal moments {low:.4g}, {middle:.4g}, {high:.4g} break the triangle inequality")
    return Body(
        inertia=0.5 * (inertia + inertia.T),
        inertia_units=document.inertia_units,
        mass_kg=document.mass_kg,
        centre_of_mass_m=document.centre_of_mass_m,
        source=document.source or "",
        inertia_sigma=document.inertia_sigma,
    )


def _unit(direction: np.ndarray | None, fault: str) -> np.ndarray | None:
    """(3,) of length 1, or None of none. fault: what is said of one without length."""
    if direction is None:
        return None
    length = float(np.linalg.norm(direction))
    if not length > 1e-12:
        raise InputError(fault)
    return direction / length


def _environment(path: Path) -> Environment:
    if not _there(path):
        return Environment()
    document = read(EnvironmentFile, load_yaml(path), str(path))
    direction = _unit(document.sun_direction, f"{path}: sun_direction has no length")
    orbit = None
    if document.orbit is not None:
        rotation = np.eye(3) if document.orbit.R_inertial_perifocal is None else document.orbit.R_inertial_perifocal
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
            raise InputError(f"{path}: R_inertial_perifocal is not a rotation")
        orbit = Orbit(**{**vars(document.orbit), "R_inertial_perifocal": rotation})
    field, dipole = document.magnetic_field_T, document.magnetic_dipole_T_m3
    if dipole is not None and (orbit is None or field is not None):
        why = "needs orbit" if orbit is None else "stands in place of magnetic_field_T, and both are given"
        raise InputError(f"{path}: magnetic_dipole_T_m3 {why}")
    return Environment(document.chaser_attitude, orbit, direction, field, dipole)


def _count(warnings: list[str], path: Path, count: int, what: str) -> None:
    if count:
        warnings.append(f"{path}: {count} {what} left out")
