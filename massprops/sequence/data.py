"""What a sequence folder holds, as frozen dataclasses of arrays. SI units, radians, pixels, nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Camera:
    """One camera: `camN/sensor.yaml`.

    Attributes:
        resolution: width, height [px].
        intrinsics: (4,) fu, fv, cu, cv [px].
        distortion: (4,) OpenCV k1, k2, p1, p2.
        T_BS: (4, 4) sensor frame to the chaser's body frame (cam0's frame by default) [m].
        sigma_px: 1-sigma of a track [px]; None when the file does not say.
        rate_hz: frame rate, None when unknown.
        video: file of the images, when there is one.
        images: image files with timestamps, when there are some: tuple of (timestamp_ns, path).
        stated: whether the resolution is known, not taken to be twice the principal point.
    """

    resolution: tuple[int, int]
    intrinsics: np.ndarray
    distortion: np.ndarray = field(default_factory=lambda: np.zeros(4))
    T_BS: np.ndarray = field(default_factory=lambda: np.eye(4))
    sigma_px: float | None = None
    rate_hz: float | None = None
    video: Path | None = None
    images: tuple[tuple[int, Path], ...] = ()
    stated: bool = True


@dataclass(frozen=True)
class Tracks:
    """`tracks0`: m observations. timestamp_ns (m,) int64; camera (m,) int; feature (m,) int; uv (m, 2) [px]."""

    timestamp_ns: np.ndarray
    camera: np.ndarray
    feature: np.ndarray
    uv: np.ndarray


@dataclass(frozen=True)
class RangeSeries:
    """`range0`: distance from cam0's centre to the target's centre of mass. timestamp_ns (m,), range_m (m,), sigma_m."""

    timestamp_ns: np.ndarray
    range_m: np.ndarray
    sigma_m: float | None = None


@dataclass(frozen=True)
class RateSeries:
    """`imu0`: body rates. timestamp_ns (m,), w (m, 3) [rad/s]; sigma [rad/s] or None."""

    timestamp_ns: np.ndarray
    w: np.ndarray
    sigma: float | None = None


@dataclass(frozen=True)
class RotorSeries:
    """`rotor0`: a wheel inside the body. timestamp_ns (m,), rate (m,) against the body about its axis [rad/s]; axis (3,) unit,
    body axes, and inertia_kg_m2 about it, or None."""

    timestamp_ns: np.ndarray
    rate: np.ndarray
    axis: np.ndarray | None = None
    inertia_kg_m2: float | None = None


@dataclass(frozen=True)
class AttitudeSeries:
    """`attitude0`: rotates body vectors into cam0. timestamp_ns (m,), q (m, 4) Hamilton w x y z, sigma (m,) [rad]."""

    timestamp_ns: np.ndarray
    q: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True)
class Body:
    """`body.yaml`: what is assumed of the target. inertia (3, 3) about the centre of mass in body axes, tensor signs."""

    inertia: np.ndarray
    inertia_units: str = "ratio"
    mass_kg: float | None = None
    centre_of_mass_m: np.ndarray | None = None
    source: str = ""
    inertia_sigma: float | None = None


@dataclass(frozen=True)
class Orbit:
    """Kepler orbit of the chaser: SI, radians; R_inertial_perifocal (3, 3)."""

    mu_m3_s2: float
    semi_major_axis_m: float
    eccentricity: float
    true_anomaly_rad: float
    R_inertial_perifocal: np.ndarray = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Environment:
    """`environment.yaml`: what is known of the surroundings; vectors (3,) in inertial axes, or None. The field is constant, or that of
    the planet's dipole along the orbit."""

    chaser_attitude: str = "inertial"
    orbit: Orbit | None = None
    sun_direction: np.ndarray | None = None
    magnetic_field_T: np.ndarray | None = None
    magnetic_dipole_T_m3: np.ndarray | None = None


@dataclass(frozen=True)
class Sequence:
    """Everything a sequence folder says except the truth. Any part may be absent.

    Attributes:
        cameras: by number, 0 or 1.
        warnings: rows left out and assumptions made while reading, one line each.
        folder: where it was read from, or None.
    """

    cameras: dict[int, Camera] = field(default_factory=dict)
    tracks: Tracks | None = None
    range: RangeSeries | None = None
    rates: RateSeries | None = None
    attitude: AttitudeSeries | None = None
    body: Body | None = None
    environment: Environment = field(default_factory=Environment)
    warnings: tuple[str, ...] = ()
    folder: Path | None = None
    rotor: RotorSeries | None = None

    @property
    def of_run(self) -> bool:
        """Whether it was written by `massprops reconstruct`, so that its attitudes come from the same images as its tracks."""
        return self.folder is not None and (self.folder.parent / "run.yaml").is_file()

    @property
    def first_ns(self) -> int:
        """First time of what was measured of the motion, from which times in models count [ns]; 0 without any."""
        series = [s for s in (self.tracks, self.range, self.rates, self.attitude) if s is not None]
        return min((int(s.timestamp_ns.min()) for s in series if len(s.timestamp_ns)), default=0)
