"""The sequence folder (ASL/EuRoC layout) as plain arrays.

`read_sequence` and `write_sequence` are the only ways in and out of the folder.
"""

from massprops.sequence.data import (
    AttitudeSeries,
    Body,
    Camera,
    Environment,
    Orbit,
    RangeSeries,
    RateSeries,
    RotorSeries,
    Sequence,
    Tracks,
)
from massprops.sequence.read import read_sequence
from massprops.sequence.write import write_sequence

__all__ = [
    "AttitudeSeries",
    "Body",
    "Camera",
    "Environment",
    "Orbit",
    "RangeSeries",
    "RateSeries",
    "RotorSeries",
    "Sequence",
    "Tracks",
    "read_sequence",
    "write_sequence",
]
