"""A disk without room, as it shows itself to a stage."""

from __future__ import annotations

from pathlib import Path

PROBE = 1 << 18
"""Bytes that must still fit."""


def disk_full(folder: Path) -> bool:
    """Whether `PROBE` more bytes do not fit; native libraries tell it in words of their own, abort, or say nothing."""
    file = folder / ".probe"
    try:
        file.write_bytes(b"\0" * PROBE)
    except FileNotFoundError:
        return False  # somebody removed the folder
    except OSError:
        return True
    finally:
        file.unlink(missing_ok=True)
    return False


def no_place(where: str | Path, why: str) -> str:
    """What is said of it."""
    return f"{where}: {why}: free some space or choose another -o"
