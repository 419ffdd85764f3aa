"""What a simulation of tracks is asked for."""

from __future__ import annotations

from typing import Annotated, Any

from massprops.documents.fields import Listed, Number, Text, YesNo, document, ranges_of, read
from massprops.errors import InputError

ANY = Number("", "", -1e12, 1e12)


@document()
class TrackScenario:
    """What is simulated without images. SI units, degrees, pixels; what is `null` is drawn from the seed."""

    frames: Annotated[int, Number("number of epochs", "", 4, 100_000, whole=True)] = 480
    rate_hz: Annotated[float, Number("epochs a second", "Hz", 1e-3, 1e4)] = 2.0
    rate_deg: Annotated[float, Number("rotation per epoch", "deg", 0, 60)] = 3.0
    features: Annotated[int, Number("number of points", "", 0, 2000, whole=True)] = 16
    span_m: Annotated[float, Number("size of the body", "m", 1e-3, 1e4)] = 2.0
    distance_m: Annotated[float, Number("distance from cam0", "m", 1e-2, 1e6)] = 9.0
    baseline_m: Annotated[float, Number("baseline of the second camera, 0 for one camera", "m", 0, 1e4)] = 1.0
    focal_px: Annotated[float, Number("focal length", "px", 10, 1e5)] = 1000.0
    size: Annotated[tuple[int, int], Listed("width, height", Number("", "px", 1, 100_000, whole=True), count=2)] = (
        1280,
        1024,
    )
    sigma_px: Annotated[float, Number("1-sigma of a track", "px", 0, 50)] = 0.3
    outliers: Annotated[float, Number("share of tracks that are wrong", "", 0, 0.5)] = 0.0
    hide_back: Annotated[bool, YesNo("points on the far side are unseen")] = True
    moments: (
        Annotated[
            tuple[float, float, float],
            Listed("principal moments, any unit", Number("", "", above=0, high=1e30), count=3),
        ]
        | None
    ) = None
    spin: (
        Annotated[tuple[float, float, float], Listed("angular velocity in principal axes, any length", ANY, count=3)]
        | None
    ) = None
    drift_m_s: Annotated[float, Number("speed of the centre of mass", "m/s", -1e4, 1e4)] = 0.002
    range_sigma_m: Annotated[float, Number("noise of a range sensor, 0 for none", "m", 0, 1e4)] = 0.02
    rate_sigma: Annotated[float, Number("noise of body rates, 0 for none", "rad/s", 0, 10)] = 0.0
    attitude_sigma: Annotated[float, Number("noise of an attitude history, 0 for none", "rad", 0, 3)] = 0.0
    orbit: Annotated[bool, YesNo("the orbit is known, and the target falls beside the chaser")] = True
    sun: Annotated[bool, YesNo("the Sun's direction is known")] = True
    field: Annotated[bool, YesNo("the magnetic field is known")] = True
    assumed: Annotated[bool, YesNo("`body.yaml` gives the inertia")] = True
    assumed_sigma: Annotated[float, Number("its relative 1-sigma, drawn so", "", 0, 1)] = 0.005
    effects: Annotated[
        tuple[str, ...],
        Listed("`name`, `name:PIXELS` (rms displacement of the tracks) or `name:parameter=value,...`", Text(""), 100),
    ] = ()
    model: Annotated[str, Text("a `model.yaml` whose effects act besides", longest=4000)] | None = None
    seed: Annotated[int, Number("of everything drawn", "", 0, 2**31 - 1, whole=True)] = 0


RANGES = ranges_of(TrackScenario)
"""Lowest and highest value of every number."""


def track_scenario(given: dict[str, Any], where: str) -> TrackScenario:
    """A scenario of names with values, as a YAML file of `kind: tracks` gives them.

    Raises:
        InputError: an unknown name or a value of the wrong kind.
    """
    content = {k: v for k, v in given.items() if k != "kind" and v is not None}
    if content.get("model") is not None:
        content["model"] = str(content["model"])
    scenario = read(TrackScenario, content, where)
    if scenario.spin is not None and not any(scenario.spin):
        raise InputError(
            f"{where}: spin {scenario.spin}: give a direction other than zero, or 'rate_deg: 0' for no rotation"
        )
    return scenario
