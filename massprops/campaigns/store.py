"""The store of a campaign: one SQLite file, to which rows are only added.

A chunk's rows come in one transaction of a write-ahead log, so a campaign that is killed leaves whole chunks and nothing
else, and loses no run that was finished. The log is brought to the disk every second: a machine that loses power costs
the last second at most, and never the file.
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from massprops.errors import InputError, NotPossible

FORMAT = "massprops-campaign/1"
FILE = "runs.sqlite"
EXTENDED = "extended to "
"""Key of the hash of a configuration with more runs, which took the campaign over; the number follows."""
SYNCHRONISE_S = 1.0
TABLES = """
CREATE TABLE IF NOT EXISTS campaign (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS sessions (id INTEGER PRIMARY KEY, begun TEXT NOT NULL, place TEXT NOT NULL, versions TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS runs (
  point INTEGER NOT NULL, seed INTEGER NOT NULL, data TEXT NOT NULL, error TEXT,
  wall_s REAL, cpu_s REAL, worker TEXT, session INTEGER NOT NULL REFERENCES sessions(id),
  PRIMARY KEY (point, seed)) WITHOUT ROWID;
"""
APPEND_ONLY = "".join(
    f"CREATE TRIGGER IF NOT EXISTS {table}_{verb} BEFORE {verb} ON {table}"
    f" BEGIN SELECT RAISE(ABORT, 'the store is append-only'); END;\n"
    for table in ("campaign", "sessions", "runs")
    for verb in ("UPDATE", "DELETE")
)


@dataclass(frozen=True)
class Row:
    """One finished run.

    Attributes:
        point, seed: which run.
        data: its flat row of numbers and strings.
        error: why it failed, or None.
        wall_s, cpu_s: its share of its chunk's time [s].
        worker: host and process.
        versions: of the code that made it, None for those of the session.
    """

    point: int
    seed: int
    data: dict[str, Any]
    error: str | None = None
    wall_s: float = 0.0
    cpu_s: float = 0.0
    worker: str = ""
    versions: dict[str, str] | None = None


class Store:
    """Rows of one campaign on disk; use as a context manager."""

    def __init__(
        self,
        folder: Path,
        configuration: dict[str, Any],
        digest: str,
        extends: Callable[[Any, str], bool] = lambda runs, digest: False,
    ) -> None:
        """Opens the store, or makes it.

        Args:
            folder: the campaign's.
            configuration: as plain data; digest: its hash.
            extends: whether this configuration is one of so many runs and that hash, with more runs.

        Raises:
            InputError: it belongs to another configuration, is no store, or cannot be written.
        """
        self.path = folder / FILE
        self.session, self.place, self.synchronised = 0, "", time.monotonic()
        self.others: dict[str, int] = {}
        try:
            self.base = sqlite3.connect(self.path, isolation_level=None)
            self.base.execute("PRAGMA journal_mode=WAL")
            self.base.execute("PRAGMA synchronous=NORMAL")
            self.base.executescript(TABLES + APPEND_ONLY)
            known = dict(self.base.execute("SELECT key, value FROM campaign"))
            if not known:
                entries = {"format": FORMAT, "hash": digest, "configuration": json.dumps(configuration, sort_keys=True)}
                self._transaction("INSERT INTO campaign VALUES (?, ?)", list(entries.items()))
        except sqlite3.Error as error:
            raise InputError(
                f"{self.path}: not a campaign's store, or not writable ({error}): choose another -o"
            ) from None
        if known and not self._is_ours(known, digest, configuration, extends):
            self.base.close()
            raise InputError(
                f"{folder}: holds the runs of another configuration (hash {known.get('hash', '?')[:12]}, this one is "
                f"{digest[:12]}): choose another -o, or give the configuration it was begun with"
            )

    def _is_ours(
        self, known: dict[str, str], digest: str, configuration: dict[str, Any], extends: Callable[[Any, str], bool]
    ) -> bool:
        """Whether the store is of this configuration, or of its beginning; it is then noted as extended."""
        runs, last = json.loads(known.get("configuration", "{}")).get("runs"), known.get("hash", "")
        for key in sorted(k for k in known if k.startswith(EXTENDED)):
            runs, last = int(key.removeprefix(EXTENDED)), known[key]
        if known.get("format") != FORMAT:
            return False
        if last == digest:
            return True
        if not extends(runs, last):
            return False
        self._transaction("INSERT INTO campaign VALUES (?, ?)", [(f"{EXTENDED}{configuration['runs']:012d}", digest)])
        return True

    def __enter__(self) -> Store:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Closes it.

        Raises:
            NotPossible: within the context the disk was full or gone.
            InputError: within the context the store proved damaged.
        """
        self.base.close()
        if isinstance(error, sqlite3.OperationalError):
            raise self._full(error) from None
        if isinstance(error, sqlite3.DatabaseError):
            raise InputError(f"{self.path}: damaged ({error}): choose another -o") from None

    def _full(self, error: sqlite3.Error) -> NotPossible:
        return NotPossible(
            f"{self.path}: {error}: free some space, then give the same command again; finished runs are kept"
        )

    def begin(self, place: str, versions: dict[str, str]) -> None:
        """Notes who makes the rows that follow."""
        self.place, self.session = place, self._begun(place, versions)

    def _begun(self, place: str, versions: dict[str, str]) -> int:
        values = (datetime.now(UTC).isoformat(timespec="seconds"), place, json.dumps(versions, sort_keys=True))
        done = self.base.execute("INSERT INTO sessions (begun, place, versions) VALUES (?, ?, ?)", values)
        return int(done.lastrowid or 0)

    def add(self, rows: list[Row]) -> None:
        """Adds rows in one transaction; a run that is there already stays as it is.

        Raises:
            NotPossible: the disk is full or gone.
        """
        try:
            values = [
                (r.point, r.seed, json.dumps(r.data), r.error, r.wall_s, r.cpu_s, r.worker, self._session_of(r))
                for r in rows
            ]
            self._transaction("INSERT OR IGNORE INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?)", values)
            if time.monotonic() - self.synchronised > SYNCHRONISE_S:
                self.base.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchall()
                self.synchronised = time.monotonic()
        except sqlite3.OperationalError as error:
            raise self._full(error) from None

    def _session_of(self, row: Row) -> int:
        if row.versions is None:
            return self.session
        name = json.dumps(row.versions, sort_keys=True)
        if name not in self.others:
            self.others[name] = self._begun(self.place, row.versions)
        return self.others[name]

    def _transaction(self, statement: str, values: list[tuple[Any, ...]]) -> None:
        self.base.execute("BEGIN IMMEDIATE")
        try:
            self.base.executemany(statement, values)
            self.base.execute("COMMIT")
        except BaseException:
            if self.base.in_transaction:  # an interrupt may come just after the commit
                self.base.execute("ROLLBACK")
            raise

    def counts(self) -> dict[int, int]:
        """Finished runs per point."""
        return dict(self.base.execute("SELECT point, COUNT(*) FROM runs GROUP BY point"))

    def failed(self) -> int:
        """How many of the finished runs failed."""
        return int(self.base.execute("SELECT COUNT(*) FROM runs WHERE error IS NOT NULL").fetchone()[0])

    def seeds(self, point: int) -> set[int]:
        """Seeds of the finished runs of a point."""
        return {seed for (seed,) in self.base.execute("SELECT seed FROM runs WHERE point = ?", (point,))}

    def rows(self, point: int) -> list[Row]:
        """The runs of a point in the order of their seeds, however they came."""
        records = self.base.execute(
            "SELECT point, seed, data, error, wall_s, cpu_s, worker FROM runs WHERE point = ? ORDER BY seed", (point,)
        )
        return [Row(p, s, json.loads(d), e, w, c, k) for p, s, d, e, w, c, k in records]

    def sessions(self) -> Iterator[tuple[str, str, dict[str, str], int]]:
        """Begun, place, versions and number of rows of every session."""
        records = self.base.execute(
            "SELECT begun, place, versions, (SELECT COUNT(*) FROM runs WHERE session = sessions.id) FROM sessions ORDER BY id"
        ).fetchall()
        for begun, place, text, count in records:
            yield begun, place, json.loads(text), count
