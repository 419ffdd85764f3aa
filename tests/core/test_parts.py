"""Finished parts outlive the process that made them, and are not believed when they are damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from massprops.core.parts import Arrays, Parts


def test_what_was_made_is_not_made_again(tmp_path: Path) -> None:
    made: list[str] = []

    def make(name: str) -> Arrays:
        made.append(name)
        return {"a": np.arange(5.0), "b": np.array([[1, 2]], np.uint8)}

    for _ in range(2):
        parts = Parts(tmp_path / "new" / "key")
        for name in ("one", "two/../x\udce9"):
            found = parts.made(name, lambda name=name: make(name))  # type: ignore[misc]
            assert np.array_equal(found["a"], np.arange(5.0)) and found["b"].dtype == np.uint8
    assert made == ["one", "two/../x\udce9"]
    assert Parts().made("one", lambda: make("again"))["a"][1] == 1.0 and made[-1] == "again", "kept nowhere"


def test_a_damaged_part_is_made_again_and_named(tmp_path: Path) -> None:
    Parts(tmp_path).made("one", lambda: {"a": np.zeros(3)})
    (file,) = tmp_path.iterdir()
    for content in (b"", file.read_bytes()[:-1], file.read_bytes() + b"x", bytes(400)):
        file.write_bytes(content)
        parts = Parts(tmp_path)
        assert np.array_equal(parts.made("one", lambda: {"a": np.ones(3)})["a"], np.ones(3))
        assert parts.damaged == ["one"]


def test_a_full_disk_costs_the_part_and_no_more(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert np.array_equal(Parts(tmp_path / "file" / "x").made("one", lambda: {"a": np.ones(3)})["a"], np.ones(3))


def test_work_done_twice_on_other_data_has_parts_of_its_own(tmp_path: Path) -> None:
    parts = Parts(tmp_path)
    for number, inner in enumerate((parts, parts.within("a"), parts.within("b"), parts.within("a").within("b"))):
        assert inner.made("one", lambda number=number: {"n": np.array(number)})["n"] == number  # type: ignore[misc]
    assert parts.within("a").made("one", lambda: {"n": np.array(9)})["n"] == 1
    for file in tmp_path.iterdir():
        file.write_bytes(b"")
    parts.within("b").made("one", lambda: {"n": np.array(2)})
    assert parts.damaged == ["b: one"], "and what was damaged is told once, of all"
