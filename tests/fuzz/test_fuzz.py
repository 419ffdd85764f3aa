"""A short, seeded part of `make fuzz`, and every file that fuzzing ever found something with."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from .__main__ import corpus
from .mutations import mutated
from .oracle import fault
from .targets import fresh, restore, targets

SHORT = {"options": 4, "campaign": 10, "videos": 10, "capture": 8}


@pytest.mark.parametrize("name", targets())
def test_hostile_input_is_one_line(name: str, tmp_path: Path) -> None:
    target = targets()[name]()
    fresh(target, tmp_path / "f")

    @seed(7)
    @settings(max_examples=SHORT.get(name, 25), deadline=None, database=None, phases=[Phase.generate],
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(st.data())
    def one(data: st.DataObject) -> None:
        file = data.draw(st.sampled_from(sorted(target.seeds)))
        wrong = fault(target, tmp_path / "f", file, data.draw(mutated(target.seeds[file])))
        restore(target, tmp_path / "f", file)
        assert wrong == ""

    one()
    for file, contents in corpus(name).items():
        for content in contents:
            assert fault(target, tmp_path / "f", file, content) == ""
            restore(target, tmp_path / "f", file)
