"""The log: what is done and how long it takes. It is written with `-v` only."""

from __future__ import annotations

import logging
from typing import TextIO

LEVELS = {0: logging.WARNING, 1: logging.INFO, 2: logging.DEBUG}
FORMAT = "%(relativeCreated)7.0f ms  %(name)s: %(message)s"

log = logging.getLogger("massprops")
log.addHandler(logging.NullHandler())


def log_to(stream: TextIO, level: int) -> None:
    """Sends the log to a stream: level 1 what massprops does, 2 also its details and what the libraries log."""
    handler = logging.StreamHandler(stream)
    handler.setFormatter(logging.Formatter(FORMAT))
    target = logging.getLogger() if level > 1 else log
    target.handlers = [h for h in target.handlers if not isinstance(h, logging.StreamHandler)] + [handler]
    target.setLevel(LEVELS[level])
