"""Filter YAML: what `massprops export --to filter` writes and `massprops estimate --prior` reads."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from massprops.documents.fields import Array, Listed, Names, Nested, Number, Text, document

FORMAT = "massprops-filter/1"
LARGEST_STAMP = 2**62
MOST_FEATURES = 10_000


@document()
class RatiosFile:
    """Inertia ratios of ascending moments."""

    k1: Annotated[float, Number("ln(I1/I2), not above 0", "", low=-60, high=1e-9)]
    k2: Annotated[float, Number("ln(I2/I3), not above 0", "", low=-60, high=1e-9)]


@document()
class FeaturesFile:
    """Feature points, from the centre of mass, in the file's axes."""

    ids: Annotated[
        tuple[Any, ...],
        Listed(
            "numbers of the features in `tracks0`, all different",
            Number("", "", -(2**53), 2**53, whole=True),
            MOST_FEATURES,
        ),
    ]
    xyz: Annotated[np.ndarray, Array("one row a feature", "`units`", (None, 3), -1e12, 1e12)] | None = None
    units: Annotated[str, Text("metres, or the model's unit", ("m", "model"))] = "m"
    sigma: Annotated[float, Number("1-sigma of a coordinate", "`units`", low=0, high=1e12)] | None = None


@document()
class FrameFile:
    """What the axes are."""

    kind: Annotated[str, Text("in words")] | None = None
    mark: (
        Annotated[
            tuple[Any, ...],
            Listed(
                "rows of timestamp [ns], q_w, q_x, q_y, q_z of the footage's `attitude0`",
                Listed("", Number("", "", -LARGEST_STAMP, LARGEST_STAMP), count=5),
                1000,
            ),
        ]
        | None
    ) = None


@document()
class FilterFile:
    """A prior for filters, in the axes of the run's mesh."""

    format: Annotated[str, Text("kind and version of the file", (FORMAT,))] = FORMAT
    source: Annotated[str, Text("where the numbers come from")] | None = None
    units: Annotated[dict[str, Any], Names("`length`: `m` or `model`")] | None = None
    inertia: Annotated[np.ndarray, Array("about the centre of mass, tensor signs, any scale", "", (3, 3))] | None = None
    inertia_ratios: Annotated[RatiosFile, Nested("ratios, which must agree with the inertia")] | None = None
    principal_axes: Annotated[np.ndarray, Array("unit columns at right angles", "", (3, 3), -1.001, 1.001)] | None = (
        None
    )
    k_covariance: Annotated[np.ndarray, Array("covariance of k1, k2", "", (2, 2), -1e6, 1e6)] | None = None
    axes_covariance_rad2: (
        Annotated[np.ndarray, Array("covariance of small turns about the principal axes", "rad^2", (3, 3), -1e6, 1e6)]
        | None
    ) = None
    frame: Annotated[FrameFile, Nested("which footage the axes belong to")] | None = None
    features: Annotated[FeaturesFile, Nested("feature points")] | None = None
    process_noise: (
        Annotated[float, Number("1-sigma of angular acceleration", "rad/s^2 per sqrt(s)", low=0, high=1e6)] | None
    ) = None
