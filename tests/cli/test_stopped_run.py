"""What `reconstruct` says of a run that could not be brought to its end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from whole import assert_one_line, massprops

from massprops.core.outputs import Outputs, deliver
from massprops.errors import InputError
from massprops.run import reconstruct
from massprops.run.reconstruct import Run


@pytest.mark.parametrize("format", [(), ("--json",)])
def test_a_full_disk_is_told_once(
    capfd: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, format: tuple[str, ...]
) -> None:
    """The disk was full as `massprops.json` was replaced, so no table can be printed of it."""
    run = tmp_path / "run"
    deliver(run, "reconstruct", {"massprops.json": "{}"}, "key")
    outputs = Outputs(run)
    outputs.pending = {"files": {}, "gone": [], "aside": {}}
    outputs.save()
    stopped = Run(run, 2, "the disk is full", [], {"mass": {"status": "done"}})
    with pytest.raises(InputError):
        assert stopped.properties
    monkeypatch.setattr(reconstruct, "reconstruct", lambda *_, **__: stopped)
    said = massprops(capfd, "reconstruct", tmp_path, "-o", run, "-q", *format)
    assert_one_line(said, 2, "the disk is full")
    assert ("the disk is full" in said.out) == bool(format)
