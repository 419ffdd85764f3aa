"""Reads a sequence folder. The truth in it is never opened here: see `massprops.sequence.truth`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from massprops.errors import InputError
from massprops.sequence.data import (
    AttitudeSeries,
    Body,
    Camera,
    Environment,
    Orbit,
    RangeSeries,
    RateSeries,
    Sequence,
    Tracks,
)
from massprops.sequence.table import read_table

LARGEST_YAML = 10_000_000


def read_sequence(folder: str | Path) -> Sequence:
    """Everything in the folder that is not truth.

    A run folder is taken as the sequence inside it. Rows that cannot be used are left out and counted in `warnings`.

    Raises:
        InputError: not a folder, nothing of a sequence in it, or a file that contradicts itself.
    """
    folder = Path(folder)
    if (folder / "sequence").is_dir() and not (folder / "tracks0").is_dir():
        folder = folder / "sequence"
    if not folder.is_dir():
        raise InputError(f"{folder}: no such sequence folder")
    warnings: list[str] = []
    cameras = {
        i: _camera(folder / f"cam{i}", warnings) for i in (0, 1) if (folder / f"cam{i}" / "sensor.yaml").is_file()
    }
    sequence = Sequence(
        cameras=cameras,
        tracks=_tracks(folder / "tracks0" / "data.csv", cameras, warnings),
        range=_range(folder / "range0", warnings),
        rates=_rates(folder / "imu0", warnings),
        attitude=_attitude(folder / "attitude0" / "data.csv", warnings),
        body=_body(folder / "body.yaml"),
        environment=_environment(folder / "environment.yaml"),
        warnings=tuple(warnings),
        folder=folder,
    )
    if not any((cameras, sequence.tracks, sequence.range, sequence.rates, sequence.attitude)):
        raise InputError(f"{folder}: nothing of a sequence here; expected cam0, tracks0, range0, imu0 or attitude0")
    return sequence


def load_yaml(path: Path) -> dict[str, Any]:
    """A YAML mapping, read safely.

    Raises:
        InputError: too large, not YAML, or not a mapping.
    """
    import yaml

    if path.stat().st_size > LARGEST_YAML:
        raise InputError(f"{path}: {path.stat().st_size / 1e6:.0f} MB is too large for a YAML file of a sequence")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not YAML ({str(error).splitlines()[0]})") from None
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected names with values, found a {type(content).__name__}")
    return content


def numbers(path: Path, content: dict[str, Any], key: str, shape: tuple[int, ...]) -> np.ndarray:
    """`content[key]` as finite floats of a given shape, or an InputError that names file and key."""
    value = content.get(key)
    if isinstance(value, dict) and "data" in value:
        value = value["data"]
    try:
        array = np.array(value, float)
        if array.size == int(np.prod(shape)):
            array = array.reshape(shape)
    except (TypeError, ValueError):
        raise InputError(f"{path}: {key} must be {' x '.join(map(str, shape))} numbers") from None
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{path}: {key} must be {' x '.join(map(str, shape))} finite numbers")
    return array


def _scalar(path: Path, content: dict[str, Any], key: str, positive: bool = False) -> float | None:
    value = content.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputError(f"{path}: {key} must be a number, not {value!r}")
    if positive and value <= 0:
        raise InputError(f"{path}: {key} must be above 0, not {value!r}")
    return float(value)


def _camera(folder: Path, warnings: list[str]) -> Camera:
    path = folder / "sensor.yaml"
    content = load_yaml(path)
    if "intrinsics" not in content:
        raise InputError(f"{path}: no intrinsics; give intrinsics: [fu, fv, cu, cv]")
    intrinsics = numbers(path, content, "intrinsics", (4,))
    if not (intrinsics[:2] > 0).all():
        raise InputError(f"{path}: focal lengths fu, fv must be above 0")
    model = content.get("camera_model", "pinhole")
    if model != "pinhole":
        raise InputError(f"{path}: camera_model {model!r} is not known; only pinhole is")
    if "distortion_coefficients" in content:
        kind = content.get("distortion_model", "radial-tangential")
        if kind not in ("radial-tangential", "radtan", "none", None):
            raise InputError(f"{path}: distortion_model {kind!r} is not known; only radial-tangential is")
        distortion = numbers(path, content, "distortion_coefficients", (4,))
    else:
        distortion = np.zeros(4)
    pose = numbers(path, content, "T_BS", (4, 4)) if content.get("T_BS") is not None else np.eye(4)
    if not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-3):
        raise InputError(f"{path}: T_BS does not hold a rotation")
    size = numbers(path, content, "resolution", (2,)) if content.get("resolution") is not None else 2 * intrinsics[2:]
    return Camera(
        resolution=(int(size[0]), int(size[1])),
        intrinsics=intrinsics,
        distortion=distortion,
        T_BS=pose,
        sigma_px=_scalar(path, content, "sigma_px", positive=True),
        rate_hz=_scalar(path, content, "rate_hz", positive=True),
        video=folder / "video.mp4" if (folder / "video.mp4").is_file() else None,
        images=_images(folder, warnings),
    )


def _images(folder: Path, warnings: list[str]) -> tuple[tuple[int, Path], ...]:
    path = folder / "data.csv"
    if not path.is_file():
        return ()
    table, left_out = read_table(path, ("timestamp", "filename"), text=("filename",))
    _count(warnings, path, left_out, "rows that cannot be read")
    inside = (folder / "data").resolve()
    found = []
    for stamp, name in zip(table["timestamp"], table["filename"], strict=True):
        file = (inside / str(name)).resolve()
        if file.parent == inside and file.is_file():
            found.append((int(stamp), file))
    return tuple(found)


def _series(path: Path, columns: tuple[str, ...], warnings: list[str]) -> dict[str, np.ndarray]:
    """A table with times in order: repeated times keep their first row, times that go back are left out."""
    table, left_out = read_table(path, columns)
    _count(warnings, path, left_out, "rows with missing, unreadable or infinite values")
    stamp = table["timestamp"]
    if len(stamp):
        forward = stamp > np.concatenate([[stamp[0] - 1], np.maximum.accumulate(stamp)[:-1]])
        _count(warnings, path, int((~forward).sum()), "rows whose timestamp is repeated or goes back")
        table = {name: values[forward] for name, values in table.items()}
    return table


def _tracks(path: Path, cameras: dict[int, Camera], warnings: list[str]) -> Tracks | None:
    if not path.is_file():
        return None
    table, left_out = read_table(path, ("timestamp", "camera", "feature", "u", "v"))
    _count(warnings, path, left_out, "rows with missing, unreadable or infinite values")
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
    if not (folder / "data.csv").is_file():
        return None
    table = _series(folder / "data.csv", ("timestamp", "range"), warnings)
    positive = table["range"] > 0
    _count(warnings, folder / "data.csv", int((~positive).sum()), "ranges that are not positive")
    return RangeSeries(table["timestamp"][positive], table["range"][positive], _sigma(folder, "sigma_m"))


def _rates(folder: Path, warnings: list[str]) -> RateSeries | None:
    if not (folder / "data.csv").is_file():
        return None
    table = _series(folder / "data.csv", ("timestamp", "w_x", "w_y", "w_z"), warnings)
    w = np.column_stack([table[k] for k in ("w_x", "w_y", "w_z")])
    return RateSeries(table["timestamp"], w, _sigma(folder, "sigma_rad_s"))


def _attitude(path: Path, warnings: list[str]) -> AttitudeSeries | None:
    if not path.is_file():
        return None
    table = _series(path, ("timestamp", "q_w", "q_x", "q_y", "q_z", "sigma"), warnings)
    q = np.column_stack([table[k] for k in ("q_w", "q_x", "q_y", "q_z")])
    norm = np.linalg.norm(q, axis=1)
    unit = np.abs(norm - 1) < 0.01
    _count(warnings, path, int((~unit).sum()), "quaternions that are not unit")
    q, norm = q[unit], norm[unit]
    return AttitudeSeries(table["timestamp"][unit], q / norm[:, None], np.maximum(table["sigma"][unit], 1e-9))


def _sigma(folder: Path, key: str) -> float | None:
    path = folder / "sensor.yaml"
    return _scalar(path, load_yaml(path), key, positive=True) if path.is_file() else None


def _body(path: Path) -> Body | None:
    if not path.is_file():
        return None
    content = load_yaml(path)
    if content.get("inertia") is None:
        return None
    inertia = numbers(path, content, "inertia", (3, 3))
    if not np.allclose(inertia, inertia.T, rtol=1e-6, atol=1e-12 * float(np.abs(inertia).max())):
        raise InputError(f"{path}: inertia is not symmetric")
    low, middle, high = np.linalg.eigvalsh(inertia)
    if low <= 0 or low + middle < high * (1 - 1e-6):
        raise InputError(f"{path}: principal moments {low:.4g}, {middle:.4g}, {high:.4g} break the triangle inequality")
    units = content.get("inertia_units", "ratio")
    if units not in ("kg m^2", "ratio"):
        raise InputError(f"{path}: inertia_units {units!r}; give 'kg m^2' or 'ratio'")
    centre = content.get("centre_of_mass_m")
    return Body(
        inertia=0.5 * (inertia + inertia.T),
        inertia_units=units,
        mass_kg=_scalar(path, content, "mass_kg", positive=True),
        centre_of_mass_m=None if centre is None else numbers(path, content, "centre_of_mass_m", (3,)),
        source=str(content.get("source") or ""),
        inertia_sigma=_scalar(path, content, "inertia_sigma"),
    )


def _environment(path: Path) -> Environment:
    if not path.is_file():
        return Environment()
    content = load_yaml(path)
    attitude = content.get("chaser_attitude", "inertial")
    if attitude not in ("inertial", "lvlh"):
        raise InputError(f"{path}: chaser_attitude {attitude!r}; give inertial or lvlh")
    sun = content.get("sun_direction")
    field = content.get("magnetic_field_T")
    direction = None
    if sun is not None:
        direction = numbers(path, content, "sun_direction", (3,))
        if not np.linalg.norm(direction) > 0:
            raise InputError(f"{path}: sun_direction has no length")
        direction = direction / np.linalg.norm(direction)
    return Environment(
        chaser_attitude=attitude,
        orbit=_orbit(path, content.get("orbit")),
        sun_direction=direction,
        magnetic_field_T=None if field is None else numbers(path, content, "magnetic_field_T", (3,)),
    )


def _orbit(path: Path, content: Any) -> Orbit | None:
    if content is None:
        return None
    if not isinstance(content, dict):
        raise InputError(f"{path}: orbit must have names with values")
    values = {}
    for key in ("mu_m3_s2", "semi_major_axis_m", "eccentricity", "true_anomaly_rad"):
        value = _scalar(path, content, key)
        if value is None:
            raise InputError(f"{path}: orbit has no {key}")
        values[key] = value
    if values["mu_m3_s2"] <= 0 or values["semi_major_axis_m"] <= 0 or not 0 <= values["eccentricity"] < 1:
        raise InputError(f"{path}: orbit needs mu and semi-major axis above 0 and an eccentricity in [0, 1)")
    given = content.get("R_inertial_perifocal") is not None
    rotation = numbers(path, content, "R_inertial_perifocal", (3, 3)) if given else np.eye(3)
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
        raise InputError(f"{path}: R_inertial_perifocal is not a rotation")
    return Orbit(**values, R_inertial_perifocal=rotation)


def _count(warnings: list[str], path: Path, count: int, what: str) -> None:
    if count:
        warnings.append(f"{path}: {count} {what} left out")
