"""How much is said of what is done: `-v` what massprops does, `-vv` also details and what the libraries say."""

from __future__ import annotations

import logging
import sys

from massprops.core.log import LEVELS, log_to

FLAGS = {"-v": 1, "-vv": 2, "--verbose": 1}


def verbosity(arguments: list[str]) -> tuple[int, list[str]]:
    """The level that `-v` and `-vv` ask for, wherever they stand before a `--`, and the other arguments."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    level = sum(FLAGS.get(a, 0) for a in arguments[:end])
    return min(level, max(LEVELS)), [a for a in arguments[:end] if a not in FLAGS] + arguments[end:]


def start_log(level: int) -> None:
    """Log lines go to stderr from here on; level 0 leaves the log as it is."""
    if level:
        log_to(sys.stderr, level)
        logging.captureWarnings(level > 1)
