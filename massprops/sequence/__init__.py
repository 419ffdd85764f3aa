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
    Sequence,
    Tracks,
)

__all__ = [
    "AttitudeSeries",
    "Body",
    "Camera",
    "Environment",
    "Orbit",
    "RangeSeries",
    "RateSeries",
    "Sequence",
    "Tracks",
]
