"""`environment.yaml`: what is known of the surroundings. "Inertial" axes are cam0's at the first timestamp."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from massprops.documents.fields import Array, Nested, Number, Text, document


@document()
class OrbitFile:
    """Kepler orbit of the chaser."""

    mu_m3_s2: Annotated[
        float,
        Number(
            "gravitational parameter of the planet; of a boulder 1e-3, of the Sun 1.3e20",
            "m^3/s^2",
            low=1e-6,
            high=1e25,
        ),
    ]
    semi_major_axis_m: Annotated[float, Number("semi-major axis", "m", low=1.0, high=1e16)]
    eccentricity: Annotated[float, Number("eccentricity", "", low=0, below=1)]
    true_anomaly_rad: Annotated[float, Number("true anomaly at the first timestamp", "rad", low=-1e4, high=1e4)]
    R_inertial_perifocal: (
        Annotated[np.ndarray, Array("perifocal axes to inertial axes", "", (3, 3), -1.001, 1.001)] | None
    ) = None


@document()
class EnvironmentFile:
    """`environment.yaml`: what is known of the surroundings."""

    chaser_attitude: Annotated[str, Text("how the chaser holds itself", ("inertial", "lvlh"))] = "inertial"
    orbit: Annotated[OrbitFile, Nested("the chaser's orbit; `null` when unknown")] | None = None
    sun_direction: (
        Annotated[np.ndarray, Array("from the target to the Sun, inertial axes, any length", "", (3,), -1e12, 1e12)]
        | None
    ) = None
    magnetic_field_T: Annotated[np.ndarray, Array("constant vector, inertial axes", "T", (3,), -1e3, 1e3)] | None = None
    magnetic_dipole_T_m3: (
        Annotated[
            np.ndarray,
            Array(
                "dipole at the planet's centre in place of a constant field, inertial axes: the field at r is "
                "(3 (d . r) r / r^2 - d) / r^3, of the Earth 7.8e15 to the south; needs `orbit`",
                "T m^3",
                (3,),
                -1e30,
                1e30,
            ),
        ]
        | None
    ) = None
