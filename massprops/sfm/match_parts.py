"""Batches of matched pairs as finished parts: rows of COLMAP's database, taken out to be kept and put back as they were.

What a pair of images comes to depends on their features, the cameras' priors and the settings, and on nothing that was
matched before: a batch that is put back in place of being matched leaves the same database.
"""

from __future__ import annotations

import contextlib
import hashlib
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np

from massprops.core.files import hash_of
from massprops.core.parts import Arrays, Parts

TABLES = ("matches", "two_view_geometries")
"""Of COLMAP's database, by pair of images."""

MATCHED_FROM = ("cameras", "images", "keypoints", "descriptors")


class MatchParts:
    """The kept batches of one database.

    Attributes:
        database: COLMAP's, with cameras and features.
        parts: where they are kept.
    """

    def __init__(self, database: Path, parts: Parts | None = None) -> None:
        self.database, self.parts = database, parts or Parts()
        self._content = content_of(database) if self.parts.folder is not None else ""

    def matched(
        self, settings: object, pairs: list[tuple[str, str]], numbers: list[int], match: Callable[[], None]
    ) -> None:
        """Matches a batch into the database, or puts back what it came to before.

        Args:
            settings: of matching, whose text tells them apart.
            pairs: names of the images.
            numbers: COLMAP's number of each pair.
            match: matches and verifies the batch into the database.
        """
        if self.parts.folder is None:
            return match()
        made: list[Arrays] = []

        def make() -> Arrays:
            match()
            made.append(taken(self.database, numbers))
            return made[0]

        stored_matches = self.parts.made(f"matches {hash_of([self._content, str(settings), pairs])}", make)
        if not made:
            put_back(self.database, stored_matches)
        return None


def content_of(database: Path) -> str:
    """sha256 of all that matching depends on."""
    total = hashlib.sha256()
    with contextlib.closing(sqlite3.connect(database)) as base:
        for table in MATCHED_FROM:
            for row in base.execute(f"SELECT * FROM {table} ORDER BY 1"):
                for cell in row:
                    content = cell if isinstance(cell, bytes) else str(cell).encode()
                    total.update(b"%d " % len(content) + content)
    return total.hexdigest()


def taken(database: Path, numbers: list[int]) -> Arrays:
    """The rows of some pairs, as a small database of their own in memory."""
    with contextlib.closing(sqlite3.connect(":memory:", isolation_level=None)) as base:
        base.execute("ATTACH ? AS theirs", (str(database),))
        base.execute("CREATE TEMP TABLE wanted (pair_id INTEGER PRIMARY KEY)")
        base.executemany("INSERT OR IGNORE INTO wanted VALUES (?)", [(n,) for n in numbers])
        for table in TABLES:
            base.execute(
                f"CREATE TABLE {table} AS SELECT * FROM theirs.{table} WHERE pair_id IN (SELECT pair_id FROM wanted)"
            )
        return {"rows": np.frombuffer(base.serialize(), np.uint8)}


def put_back(database: Path, rows: Arrays) -> None:
    """Writes rows that were `taken` from a database into it, or into one like it."""
    with contextlib.closing(sqlite3.connect(":memory:", isolation_level=None)) as base:
        base.deserialize(rows["rows"].tobytes())
        base.execute("ATTACH ? AS theirs", (str(database),))
        base.execute("BEGIN")
        for table in TABLES:
            base.execute(f"INSERT OR REPLACE INTO theirs.{table} SELECT * FROM {table}")
        base.execute("COMMIT")
