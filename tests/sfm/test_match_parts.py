"""What was matched before a process died is put back, byte for byte, and not matched again."""

from __future__ import annotations

import contextlib
import sqlite3
import zlib  # noqa: F401  must precede pycolmap
from functools import partial
from pathlib import Path

import numpy as np
import pycolmap
import pytest
import scene
from test_mapping import features, footage

from massprops.core.parts import Parts
from massprops.core.progress import silent
from massprops.sfm import attempt as ways
from massprops.sfm.database import write_database
from massprops.sfm.mapping import MappingOptions, match, verify
from massprops.sfm.match_parts import TABLES, MatchParts

OPTIONS = MappingOptions(masked=True, seed=3, threads=1)


def rows(database: Path) -> dict[str, list[tuple]]:
    base = sqlite3.connect(database)
    found = {t: base.execute(f"SELECT * FROM {t} ORDER BY pair_id").fetchall() for t in TABLES}
    base.close()
    return found


class Scene:
    """Eight views, their features, and databases of them."""

    def __init__(self, folder: Path, noise: float = 0.05) -> None:
        self.folder = folder
        views, points = scene.make(8, 120, focal=820.0, noise=noise, step_deg=10)
        self.footage, self.features = footage(views), features(views, points)
        self.pairs = [(views.names[i], views.names[j]) for i in range(8) for j in range(i + 1, 8)]

    def database(self, name: str) -> tuple[Path, dict[str, int]]:
        (self.folder / name).mkdir()
        path = self.folder / name / "database.db"
        return path, write_database(path, self.footage, self.features)


def go(made: Scene, name: str, parts: Parts | None, fails_after: int = 100) -> tuple[Path, int]:
    """Matches all pairs four at a time; the database, and batches that were matched."""
    database, ids = made.database(name)
    count = 0

    def counted(pairs: list[tuple[str, str]]) -> None:
        nonlocal count
        if count == fails_after:
            raise KeyboardInterrupt
        count += 1
        match(database, pairs, OPTIONS)

    with contextlib.suppress(KeyboardInterrupt):
        ways._in_batches(counted, MatchParts(database, parts), ids, OPTIONS, silent)(made.pairs)
    return database, count


def test_batches_that_were_done_are_put_back_as_they_were(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ways, "BATCH", 4)
    made = Scene(tmp_path)
    whole, count = go(made, "whole", None)
    assert count == 7 and len(rows(whole)["matches"]) == 28
    _, count = go(made, "killed", Parts(tmp_path / "parts"), fails_after=3)
    assert count == 3
    again, count = go(made, "again", Parts(tmp_path / "parts"))
    assert count == 4, "three of seven were there"
    assert rows(again) == rows(whole)
    third, count = go(made, "third", Parts(tmp_path / "parts"))
    assert count == 0 and rows(third) == rows(whole)
    with pycolmap.Database.open(third) as base:
        assert base.num_verified_image_pairs() == len(rows(whole)["two_view_geometries"]) > 20


def test_batches_of_other_features_or_settings_are_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ways, "BATCH", 4)
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    go(Scene(tmp_path / "one"), "a", Parts(tmp_path / "parts"))
    assert go(Scene(tmp_path / "two", noise=0.06), "a", Parts(tmp_path / "parts"))[1] == 7
    monkeypatch.setattr("test_match_parts.OPTIONS", MappingOptions(masked=True, seed=4, threads=1))
    assert go(Scene(tmp_path / "one"), "b", Parts(tmp_path / "parts"))[1] == 7


def test_verifying_in_batches_changes_nothing(tmp_path: Path) -> None:
    made = Scene(tmp_path)
    own = {n: np.arange(len(f[0])) for n, f in made.features.items()}
    matches = {(a, b): np.column_stack([own[a][:60], own[b][:60]]).astype(np.uint32) for a, b in made.pairs}
    found = []
    for name, size in (("whole", 28), ("batches", 4)):
        database, ids = made.database(name)
        for start in range(0, 28, size):
            verify(database, ids, {p: matches[p] for p in made.pairs[start : start + size]}, OPTIONS)
        found.append(rows(database))
    assert found[0] == found[1] and len(found[0]["two_view_geometries"]) > 0


def test_without_a_place_nothing_is_kept(tmp_path: Path) -> None:
    made = Scene(tmp_path)
    database, _ = made.database("a")
    MatchParts(database).matched(OPTIONS, made.pairs[:2], [], partial(match, database, made.pairs[:2], OPTIONS))
    assert len(rows(database)["matches"]) == 2
