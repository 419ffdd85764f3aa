"""`model.yaml`: effects and their parameters, as `massprops diagnose` writes and `simulate --model` reads them."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from massprops.documents.fields import Array, Names, Nested, Text, document

FORMAT = "massprops-model/1"


@document()
class EffectFile:
    """One effect. Its parameters and their units are those that `massprops.effects` lists."""

    name: Annotated[str, Text("name of the effect")]
    parameters: Annotated[dict[str, Any], Names("every parameter of the effect with its value")]
    units: Annotated[dict[str, Any], Names("units of the parameters, for the reader")] | None = None
    given: (
        Annotated[dict[str, Any], Names("what was measured beside the motion, where the effect follows it")] | None
    ) = None
    sigma: Annotated[dict[str, Any], Names("1-sigma of the parameters")] | None = None


@document(others="ignored")
class ModelFile:
    """`model.yaml`: the effects that act, the inertia, and the state in which the record begins."""

    format: Annotated[str, Text("kind and version of the file", (FORMAT,))]
    effects: Annotated[tuple[EffectFile, ...], Nested("list of effects", many=True)] | None = None
    inertia: (
        Annotated[np.ndarray, Array("in body axes, mean moment 1; `null` when it is to be found", "", (3, 3))] | None
    ) = None
    angular_velocity_rad_s: (
        Annotated[np.ndarray, Array("at the first epoch, body axes", "rad/s", (3,), -1e4, 1e4)] | None
    ) = None
    attitude: (
        Annotated[np.ndarray, Array("at the first epoch, body to inertial axes, scalar first", "", (4,), -2.0, 2.0)]
        | None
    ) = None
