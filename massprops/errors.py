"""The two ways a request can end other than well, each with the exit code that the command gives."""

from __future__ import annotations


class MasspropsError(Exception):
    """Base of what massprops raises on purpose: one line that says what, where, and what to do.

    Attributes:
        exit_code: process exit code of the command that met it.
    """

    exit_code = 2


class InputError(MasspropsError):
    """The input or an option is wrong; nothing useful could be computed."""

    exit_code = 2


class NotPossible(MasspropsError):
    """The data cannot give the answer, or gives it in part; what was computed is kept."""

    exit_code = 3
