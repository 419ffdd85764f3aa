"""Unscented Kalman filter of a tumbling body: relative translation, rotation, k1, k2, principal axes and features.

Source: kabir2025 section 2.2, generalised: attitude by a multiplicative error (the paper's additive quaternion is an
option), relative translation, any number of features that come and go, and attitude, rate and range measurements.
"""

from massprops.estimators.unscented.state import Measurements, Noise, Run, Settings, State, filter_epochs
from massprops.sensing.pinhole import Pinhole as Camera

__all__ = ["Camera", "Measurements", "Noise", "Run", "Settings", "State", "filter_epochs"]
