"""What the user is told of a run's sequence."""

from __future__ import annotations

from massprops.run.stages.sequence import told


def test_nothing_is_told_of_the_motion_of_a_still_object() -> None:
    warnings = ["the images have no clock", "the object is still"]
    assert told(warnings, "static") == () and told(warnings, "tumbling") == tuple(warnings)
