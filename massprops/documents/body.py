"""`body.yaml`: what is assumed of the target."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from massprops.documents.fields import Array, Number, Text, document

LARGEST_SIGMA = 1e6
"""Of an inertia, relative: of a body of which next to nothing was seen."""


@document()
class BodyFile:
    """`body.yaml`: what is assumed of the target."""

    inertia: (
        Annotated[
            np.ndarray,
            Array(
                "about the centre of mass, body axes, tensor signs `I_xy = -int x y dm`; `null` when unknown",
                "`inertia_units`",
                (3, 3),
            ),
        ]
        | None
    ) = None
    inertia_units: Annotated[str, Text("whether the inertia has a scale", ("kg m^2", "ratio"))] = "ratio"
    mass_kg: Annotated[float, Number("mass", "kg", above=0, high=1e30)] | None = None
    centre_of_mass_m: Annotated[np.ndarray, Array("centre of mass in body axes", "m", (3,), -1e12, 1e12)] | None = None
    source: Annotated[str, Text("where the numbers come from")] | None = None
    inertia_sigma: Annotated[float, Number("relative 1-sigma of the inertia", "", low=0, high=LARGEST_SIGMA)] | None = (
        None
    )
