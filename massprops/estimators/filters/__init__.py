"""The error-state filter of a tumbling body: relative translation, rotation, inertia and features.

One state and one initial covariance (`setup`), channels of tracks, attitude, rates and range (`sight`), one gate and update
rules that take each other's place: unscented (`correction`) and linearised (`linearised`). The inertia is five numbers in
any body axes (`body_axes`), if need be under the planet's gravity (`gravity`); or k1, k2 in principal axes
(`principal_axes`, `prediction`). `outcome` and `verdict` say what a run is worth. Source: kabir2025 section 2.2,
generalised: attitude by a multiplicative error (the paper's additive quaternion is an option), relative translation, and any
number of features that come and go.
"""

from massprops.estimators.filters.state import Measurements, Noise, Run, Settings, State, filter_epochs
from massprops.sensing.pinhole import Pinhole as Camera

__all__ = ["Camera", "Measurements", "Noise", "Run", "Settings", "State", "filter_epochs"]
