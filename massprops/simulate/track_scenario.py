"""What a simulation of tracks is asked for."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from massprops.errors import InputError


@dataclass(frozen=True)
class TrackScenario:
    """What is simulated. SI units, degrees, pixels; None is drawn from the seed.

    Attributes:
        frames: number of epochs; rate_hz: epochs a second; rate_deg: rotation per epoch.
        features: number of points; span_m: size of the body; distance_m: from cam0.
        baseline_m: of the second camera, 0 for one camera; focal_px; size: width, height.
        sigma_px: track noise; outliers: share of tracks that are wrong; hide_back: points on the far side are unseen.
        moments: principal moments, any unit; spin: angular velocity in principal axes, any length.
        drift_m_s: speed of the centre of mass; range_sigma_m, rate_sigma, attitude_sigma: other sensors' noise, 0 for none.
        orbit, sun, field: whether the surroundings are known (and the target falls beside the chaser).
        assumed: whether `body.yaml` gives the inertia; assumed_sigma: its relative 1-sigma, drawn so.
        effects: `name`, `name:PIXELS` (rms displacement of the tracks) or `name:parameter=value,...`.
        model: a `model.yaml` whose effects act besides.
        seed: of everything drawn.
    """

    frames: int = 480
    rate_hz: float = 2.0
    rate_deg: float = 3.0
    features: int = 16
    span_m: float = 2.0
    distance_m: float = 9.0
    baseline_m: float = 1.0
    focal_px: float = 1000.0
    size: tuple[int, int] = (1280, 1024)
    sigma_px: float = 0.3
    outliers: float = 0.0
    hide_back: bool = True
    moments: tuple[float, float, float] | None = None
    spin: tuple[float, float, float] | None = None
    drift_m_s: float = 0.002
    range_sigma_m: float = 0.02
    rate_sigma: float = 0.0
    attitude_sigma: float = 0.0
    orbit: bool = True
    sun: bool = True
    field: bool = True
    assumed: bool = True
    assumed_sigma: float = 0.005
    effects: tuple[str, ...] = ()
    model: str | None = None
    seed: int = 0


RANGES: dict[str, tuple[float, float]] = {
    "frames": (4, 100_000),
    "rate_hz": (1e-3, 1e4),
    "rate_deg": (0.0, 60.0),
    "features": (0, 2000),
    "span_m": (1e-3, 1e4),
    "distance_m": (1e-2, 1e6),
    "baseline_m": (0.0, 1e4),
    "focal_px": (10.0, 1e5),
    "sigma_px": (0.0, 50.0),
    "outliers": (0.0, 0.5),
    "range_sigma_m": (0.0, 1e4),
    "rate_sigma": (0.0, 10.0),
    "attitude_sigma": (0.0, 3.0),
    "assumed_sigma": (0.0, 1.0),
    "seed": (0, 2**31 - 1),
}


def track_scenario(given: dict[str, Any], where: str) -> TrackScenario:
    """A scenario of names with values, as a YAML file of `kind: tracks` gives them.

    Raises:
        InputError: an unknown name or a value of the wrong kind.
    """
    names = {f.name for f in fields(TrackScenario)}
    chosen = {k: v for k, v in given.items() if k != "kind" and v is not None}
    for key in chosen:
        if key not in names:
            raise InputError(f"{where}: scenario key {key!r} is not known; there are {', '.join(sorted(names))}")
    for key in ("moments", "spin", "size", "effects"):
        if key in chosen:
            chosen[key] = tuple(chosen[key])
    scenario = TrackScenario(**chosen)
    for key, (low, high) in RANGES.items():
        value = getattr(scenario, key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise InputError(f"{where}: {key} {value!r}: give a value from {low:g} to {high:g}")
    return scenario
