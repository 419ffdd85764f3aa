"""`massprops.json`: the mass properties of a run."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from massprops.documents.fields import Array, Listed, Names, Nested, Number, Text, YesNo, document

FORMAT = "massprops/1"
LENGTHS = ("m", "model")


@document(others="ignored")
class UnitsFile:
    """Units of every number in the file."""

    length: Annotated[str, Text("metres, or the model's own unit", LENGTHS)]
    mass: Annotated[str, Text("kilograms, or the model's own unit", ("kg", "model"))] = "kg"


@document(others="ignored")
class InertiaRatiosFile:
    """Ratios of the principal moments."""

    k1: Annotated[float, Number("ln(I1/I2)", "", low=-60, high=1e-6)]
    k2: Annotated[float, Number("ln(I2/I3)", "", low=-60, high=1e-6)]


@document(others="ignored")
class IntervalsFile:
    """90 % intervals, [low, high] for each number; `null` for an end that is not known."""

    volume: Annotated[np.ndarray, Array("of the volume", "length^3", (2,), gaps=True)] | None = None
    mass: Annotated[np.ndarray, Array("of the mass", "mass", (2,), gaps=True)] | None = None
    center_of_mass: Annotated[np.ndarray, Array("of each coordinate", "length", (3, 2), gaps=True)] | None = None
    inertia: Annotated[np.ndarray, Array("of each element", "mass length^2", (3, 3, 2), gaps=True)] | None = None
    principal_moments: Annotated[np.ndarray, Array("of each moment", "mass length^2", (3, 2), gaps=True)] | None = None
    k1: Annotated[np.ndarray, Array("of k1", "", (2,), gaps=True)] | None = None
    k2: Annotated[np.ndarray, Array("of k2", "", (2,), gaps=True)] | None = None


@document(others="ignored")
class ScaleFile:
    """Where the scale comes from."""

    source: (
        Annotated[
            str, Text("`none`, `given`, `baseline`, `range`, `distance`, `marker`, or one of an installed package")
        ]
        | None
    ) = None
    metres_per_unit: (
        Annotated[float, Number("metres per unit of the model; `null` without a scale", "m", above=0, high=1e15)] | None
    ) = None
    relative_sigma: Annotated[float, Number("relative 1-sigma of it", "", low=0, high=1e3)] | None = None


@document(others="ignored")
class ConfidenceFile:
    """How far to trust the numbers."""

    level: Annotated[str, Text("in one word", ("high", "medium", "low"))]
    because: Annotated[tuple[Any, ...], Listed("one sentence each", Text("", longest=10_000))] = ()


@document(others="ignored")
class RecommendedFile:
    """The values to use, and why: the mesh's, or those of mesh and motion together. Every exporter writes these."""

    source: Annotated[str, Text("`mesh`, or `fused`: mesh and motion together", ("mesh", "fused"))]
    volume: Annotated[float, Number("volume", "length^3", above=0)]
    mass: Annotated[float, Number("mass", "mass", above=0)]
    center_of_mass: Annotated[np.ndarray, Array("in the mesh's axes", "length", (3,))]
    inertia: Annotated[
        np.ndarray, Array("about the centre of mass, mesh's axes, tensor signs", "mass length^2", (3, 3))
    ]
    principal_moments: Annotated[np.ndarray, Array("ascending", "mass length^2", (3,), 0)]
    principal_axes: Annotated[np.ndarray, Array("unit columns, right-handed", "", (3, 3), -1.001, 1.001)]
    k1: Annotated[float, Number("ln(I1/I2)", "", low=-60, high=1e-6)]
    k2: Annotated[float, Number("ln(I2/I3)", "", low=-60, high=1e-6)]
    interval_90: Annotated[IntervalsFile, Nested("90 % intervals of these values")] | None = None
    because: Annotated[str, Text("why these, one sentence", longest=10_000)] = ""


@document(others="ignored")
class MassFile:
    """`massprops.json`: mass, centre of mass and inertia of a run."""

    units: Annotated[UnitsFile, Nested("units of the numbers below")]
    mass: Annotated[float, Number("mass", "mass", above=0)]
    center_of_mass: Annotated[np.ndarray, Array("in the mesh's axes", "length", (3,))]
    inertia: Annotated[
        np.ndarray, Array("about the centre of mass, mesh's axes, tensor signs", "mass length^2", (3, 3))
    ]
    principal_moments: Annotated[np.ndarray, Array("ascending", "mass length^2", (3,), 0)]
    principal_axes: Annotated[np.ndarray, Array("unit columns, right-handed", "", (3, 3), -1.001, 1.001)]
    inertia_ratios: Annotated[InertiaRatiosFile, Nested("ratios of the moments")]
    volume: Annotated[float, Number("volume of the mesh", "length^3", above=0)]
    density: Annotated[float, Number("constant density", "mass/length^3", above=0)] | None = None
    density_assumed: Annotated[bool, YesNo("true if no density was given, so that 1000 kg/m^3 (water) was assumed")] = (
        False
    )
    recommended: Annotated[RecommendedFile, Nested("the values to use, and why")] | None = None
    confidence: Annotated[ConfidenceFile, Nested("how far to trust the numbers")] | None = None
    format: Annotated[str, Text("kind and version of the file", (FORMAT,))] = FORMAT
    interval_90: Annotated[IntervalsFile, Nested("90 % intervals")] | None = None
    scale: Annotated[ScaleFile, Nested("where the scale comes from")] | None = None
    surface: (
        Annotated[
            dict[str, Any],
            Names(
                "`watertight`; `area` [length^2]; shares of it: `measured_fraction` (also as `observed_fraction`), "
                "`inferred_fraction` (closed at the support), `filled_fraction`"
            ),
        ]
        | None
    ) = None
    frame: Annotated[str, Text("what the axes are")] | None = None
    images: (
        Annotated[
            dict[str, Any],
            Names("`given`: in the footage; `used`: chosen for structure from motion; `registered`: placed by it"),
        ]
        | None
    ) = None
    warnings: Annotated[tuple[Any, ...], Listed("one sentence each", Text("", longest=10_000))] | None = None
