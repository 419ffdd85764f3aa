"""`sensor.yaml` of a camera, a range sensor, a gyroscope and a wheel. Other programs write these too (EuRoC's keys)."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from massprops.documents.fields import Array, Number, Text, document

DISTORTIONS = ("radial-tangential", "radtan", "none")


@document(others="ignored")
class CameraFile:
    """`camN/sensor.yaml`: one camera of a sequence."""

    intrinsics: Annotated[
        np.ndarray, Array("[fu, fv, cu, cv]: focal lengths and principal point", "px", (4,), -1e7, 1e7)
    ]
    sensor_type: Annotated[str | None, Text("`camera`")] = None
    comment: Annotated[str | None, Text("free")] = None
    resolution: Annotated[np.ndarray, Array("[width, height]", "px", (2,), 1, 100_000)] | None = None
    camera_model: Annotated[str, Text("projection", ("pinhole",))] = "pinhole"
    distortion_model: Annotated[str, Text("lens", DISTORTIONS)] | None = None
    distortion_coefficients: (
        Annotated[np.ndarray, Array("[k1, k2, p1, p2], as OpenCV's", "", (4,), -1e3, 1e3)] | None
    ) = None
    T_BS: (
        Annotated[np.ndarray, Array("sensor frame to the chaser's body frame, row by row", "m", (4, 4), -1e9, 1e9)]
        | None
    ) = None
    sigma_px: Annotated[float, Number("1-sigma of a track", "px", above=0, high=1e4)] | None = None
    rate_hz: Annotated[float, Number("images a second", "Hz", above=0, high=1e6)] | None = None


@document(others="ignored")
class RangeFile:
    """`range0/sensor.yaml`: a range sensor."""

    sensor_type: Annotated[str | None, Text("`range`")] = None
    comment: Annotated[str | None, Text("free")] = None
    rate_hz: Annotated[float, Number("measurements a second", "Hz", above=0, high=1e9)] | None = None
    sigma_m: Annotated[float, Number("1-sigma of a range", "m", above=0, high=1e9)] | None = None


@document(others="ignored")
class GyroscopeFile:
    """`imu0/sensor.yaml`: a gyroscope on the body."""

    sensor_type: Annotated[str | None, Text("`imu`")] = None
    comment: Annotated[str | None, Text("free")] = None
    rate_hz: Annotated[float, Number("measurements a second", "Hz", above=0, high=1e9)] | None = None
    sigma_rad_s: Annotated[float, Number("1-sigma of a rate", "rad/s", above=0, high=1e3)] | None = None


@document(others="ignored")
class RotorFile:
    """`rotor0/sensor.yaml`: a wheel inside the body."""

    sensor_type: Annotated[str | None, Text("`rotor`")] = None
    comment: Annotated[str | None, Text("free")] = None
    rate_hz: Annotated[float, Number("measurements a second", "Hz", above=0, high=1e9)] | None = None
    axis: Annotated[np.ndarray, Array("direction about which a positive rate turns, body axes", "", (3,))] | None = None
    inertia_kg_m2: Annotated[float, Number("moment about that axis", "kg m^2", above=0, high=1e12)] | None = None
