"""One whole command line, as a user gives it: exit code, standard output and standard error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from massprops_cli.main import run


@dataclass(frozen=True)
class Said:
    """What a command left: its exit code and both streams, those of its child processes and libraries included."""

    code: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        """Lines on standard error that are no progress."""
        return self.err.strip().splitlines()


def massprops(capfd: Any, *arguments: object) -> Said:
    """Runs `massprops ARGUMENTS` to its end."""
    capfd.readouterr()
    code = run([str(a) for a in arguments])
    out, err = capfd.readouterr()
    return Said(code, out, err)


def assert_one_line(said: Said, code: int, *says: str) -> None:
    """Exit code, one line on standard error that says `says`, nothing else, no traceback."""
    assert said.code == code, said
    assert len(said.lines) == 1 and said.lines[0].startswith("massprops: "), said
    for part in says:
        assert part in said.lines[0], said
    assert "Traceback" not in said.err + said.out and "unexpected" not in said.err, said
    assert len(said.lines[0]) < 400, said
