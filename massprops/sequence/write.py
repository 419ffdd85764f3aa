"""Writes a sequence folder, and the truth beside it for simulated ones."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from massprops.core.files import plain, write_whole
from massprops.documents.body import BodyFile
from massprops.documents.environment import EnvironmentFile
from massprops.documents.fields import as_written
from massprops.documents.sensor import CameraFile, GyroscopeFile, RangeFile, RotorFile
from massprops.documents.tables import ATTITUDE, GYROSCOPE, IMAGES, RANGE, ROTOR, STATE, TRACKS
from massprops.sequence.data import Body, Camera, Sequence
from massprops.sequence.table import stamped_table, table_text


def write_sequence(folder: str | Path, sequence: Sequence, truth: dict[str, Any] | None = None) -> Path:
    """Writes everything of `sequence` that is not None.

    Images named in `Camera.images` are listed in `camN/data.csv` by file name and expected in `camN/data/`.

    Args:
        folder: made when it is not there.
        sequence: what to write.
        truth: `truth.yaml`'s content; its keys `timestamp_ns` (n,), `position` (n, 3) [m], `q` (n, 4) and `w` (n, 3)
            [rad/s] go to `state_groundtruth_estimate0/data.csv` instead.
    """
    folder = Path(folder)
    for number, camera in sequence.cameras.items():
        _document(CameraFile, folder / f"cam{number}" / "sensor.yaml", camera_yaml(camera))
        if camera.images:
            rows = [f"{stamp},{path.name}" for stamp, path in camera.images]
            _text(folder / f"cam{number}" / "data.csv", table_text(IMAGES.header, rows))
    if (tracks := sequence.tracks) is not None:
        rows = [
            f"{t},{c},{f},{u:.9g},{v:.9g}"
            for t, c, f, (u, v) in zip(*(getattr(tracks, k.name).tolist() for k in fields(tracks)), strict=True)
        ]
        _text(folder / "tracks0/data.csv", table_text(TRACKS.header, rows))
    if (series := sequence.range) is not None:
        _numbers(folder / "range0/data.csv", RANGE.header, series.timestamp_ns, series.range_m[:, None])
        _document(RangeFile, folder / "range0/sensor.yaml", {"sensor_type": "range", "sigma_m": series.sigma_m})
    if (rates := sequence.rates) is not None:
        _numbers(folder / "imu0/data.csv", GYROSCOPE.header, rates.timestamp_ns, rates.w)
        if rates.sigma is not None:
            _document(GyroscopeFile, folder / "imu0/sensor.yaml", {"sensor_type": "imu", "sigma_rad_s": rates.sigma})
    if (rotor := sequence.rotor) is not None:
        _numbers(folder / "rotor0/data.csv", ROTOR.header, rotor.timestamp_ns, rotor.rate[:, None])
        content = plain({"sensor_type": "rotor", "axis": rotor.axis, "inertia_kg_m2": rotor.inertia_kg_m2})
        _document(RotorFile, folder / "rotor0/sensor.yaml", {k: v for k, v in content.items() if v is not None})
    if (attitude := sequence.attitude) is not None:
        columns = np.column_stack([attitude.q, attitude.sigma])
        _numbers(folder / "attitude0/data.csv", ATTITUDE.header, attitude.timestamp_ns, columns)
    if sequence.body is not None:
        _document(BodyFile, folder / "body.yaml", body_yaml(sequence.body))
    _document(EnvironmentFile, folder / "environment.yaml", plain(asdict(sequence.environment)))
    if truth is not None:
        _truth(folder / "truth", dict(truth))
    return folder


def camera_yaml(camera: Camera) -> dict[str, Any]:
    """`camN/sensor.yaml`."""
    content: dict[str, Any] = {
        "sensor_type": "camera",
        "resolution": [int(v) for v in camera.resolution],
        "camera_model": "pinhole",
        "intrinsics": np.asarray(camera.intrinsics, float).tolist(),
        "distortion_model": "radial-tangential",
        "distortion_coefficients": np.asarray(camera.distortion, float).tolist(),
        "T_BS": {"rows": 4, "cols": 4, "data": np.asarray(camera.T_BS, float).ravel().tolist()},
    }
    if camera.sigma_px is not None:
        content["sigma_px"] = float(camera.sigma_px)
    if camera.rate_hz is not None:
        content["rate_hz"] = float(camera.rate_hz)
    return content


def body_yaml(body: Body) -> dict[str, Any]:
    """`body.yaml`."""
    content: dict[str, Any] = plain(asdict(body))
    return content


def _truth(folder: Path, truth: dict[str, Any]) -> None:
    stamp = truth.pop("timestamp_ns", None)
    if stamp is not None:
        columns = np.column_stack([truth.pop("position"), truth.pop("q"), truth.pop("w")])
        _numbers(folder / "state_groundtruth_estimate0/data.csv", STATE.header, stamp, columns)
    _yaml(folder / "truth.yaml", truth)


def _numbers(path: Path, header: str, stamp: np.ndarray, values: np.ndarray) -> None:
    _text(path, stamped_table(header, stamp, values))


def _document(kind: type, path: Path, content: dict[str, Any]) -> None:
    """A file of one of our schemas, checked as its reader will."""
    _yaml(path, as_written(kind, content, str(path)))


def _yaml(path: Path, content: dict[str, Any]) -> None:
    import yaml

    _text(path, yaml.safe_dump(content, sort_keys=False, default_flow_style=None))


def _text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text)
