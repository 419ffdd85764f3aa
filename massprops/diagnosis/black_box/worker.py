"""A user's simulator in a process of its own, asked over pipes, one line of JSON each way.

    python -P -m massprops.diagnosis.black_box.worker FILE.py:function

The parent's end is `Simulator`. The child says first what parameters there are, then answers each request.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massprops.core.messages import Listener, Silence, sayer
from massprops.effect_contract import first_line
from massprops.errors import InputError, NotPossible

SECONDS = 60.0
"""By the clock that one answer may take."""
KINDS = {"attitude": 4, "rates": 3}
"""What a simulator may give, and how many numbers an epoch; `tracks` besides, (n, cameras, features, 2)."""


@dataclass(frozen=True)
class Given:
    """One parameter: where the search begins, what is common, and its unit."""

    name: str
    start: float
    size: float
    unit: str


class Simulator:
    """The parent's end of a simulator.

    Attributes:
        text: as the user named it; parameters: what it takes.
    """

    def __init__(self, text: str, seconds: float = SECONDS) -> None:
        """Starts it.

        Raises:
            InputError: it cannot be loaded, or does not say what it takes.
        """
        from massprops.core.processes import child_environment, python_module

        if ":" not in text:
            raise InputError(f"--simulator {text}: give it as module:function or FILE.py:function")
        self.text, self.seconds = text, seconds
        self._child = subprocess.Popen(
            python_module("massprops.diagnosis.black_box.worker", text), env=child_environment(OPENBLAS_NUM_THREADS="1"),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        assert self._child.stdout is not None
        self._listener = Listener(self._child.stdout.fileno())
        try:
            first = self._read("it cannot be loaded")
        except NotPossible as stop:
            raise InputError(str(stop)) from None
        if "wrong" in first:
            self.close()
            raise InputError(f"--simulator {text}: {first['wrong']}")
        self.parameters = tuple(Given(n, *v) for n, v in first["parameters"].items())

    def __call__(self, times: np.ndarray, values: np.ndarray) -> dict[str, np.ndarray] | str:
        """What it gives at times (n,) [s] for parameters (p,), or why it gives nothing.

        Raises:
            NotPossible: it does not answer.
        """
        named = {q.name: float(v) for q, v in zip(self.parameters, values, strict=True)}
        request = json.dumps({"times": times.tolist(), "parameters": named}) + "\n"
        assert self._child.stdin is not None
        try:
            self._child.stdin.write(request.encode())
            self._child.stdin.flush()
        except OSError:
            raise NotPossible(f"--simulator {self.text}: its process ended: call it by itself to see why") from None
        answer = self._read("it does not answer")
        if "wrong" in answer:
            return str(answer["wrong"])
        return {k: np.array(v, float) for k, v in answer["given"].items()}

    def close(self) -> None:
        """Ends its process."""
        self._child.kill()
        self._child.wait()
        for pipe in (self._child.stdin, self._child.stdout):
            if pipe is not None:
                pipe.close()

    def _read(self, what: str) -> dict[str, Any]:
        try:
            return self._listener.next(self.seconds)
        except Silence as silence:
            self.close()
            late = f"{what} within {self.seconds:g} s"
            why = "its process ended: call it by itself to see why" if silence.why == "ended" else late
            raise NotPossible(f"--simulator {self.text}: {why}") from None


def _load(text: str) -> Any:
    """The function that a text names, and its module's `PARAMETERS`."""
    place, _, name = text.rpartition(":")
    if place.endswith(".py"):
        spec = importlib.util.spec_from_file_location("massprops_simulator_of_user", Path(place).resolve())
        if spec is None or spec.loader is None or not Path(place).is_file():
            raise ImportError("no such file")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    else:
        try:
            module = importlib.import_module(place)
        except ModuleNotFoundError as error:
            if error.name != place.partition(".")[0]:
                raise
            raise ImportError("no such module; a file is FILE.py:function") from None
    return getattr(module, name), module.PARAMETERS


def _parameters(given: Any) -> dict[str, tuple[float, float, str]]:
    if not isinstance(given, dict) or not 0 < len(given) <= 100:
        raise ValueError("PARAMETERS must be a dictionary of name: (start, common size, unit), 1 to 100 of them")
    out = {}
    for name, value in given.items():
        start, size, unit = value
        if not np.isfinite([start, size]).all() or size <= 0:
            raise ValueError(f"parameter {name}: start must be finite and the common size above 0")
        out[str(name)] = (float(start), float(size), str(unit))
    return out


def _answer(function: Any, request: dict[str, Any]) -> dict[str, Any]:
    times = np.array(request["times"])
    given = function(times, request["parameters"])
    if not isinstance(given, dict) or not given or not set(given) <= {*KINDS, "tracks"}:
        raise ValueError("it must give a dictionary with attitude, rates or tracks")
    out = {}
    for kind, value in given.items():
        array = np.asarray(value, float)
        if kind in KINDS and array.shape != (len(times), KINDS[kind]):
            raise ValueError(f"{kind} must be {(len(times), KINDS[kind])}, not {array.shape}")
        if kind in KINDS and not np.isfinite(array).all():
            raise ValueError(f"{kind} is not finite")
        if kind == "tracks" and (array.ndim != 4 or len(array) != len(times) or array.shape[3] != 2):
            raise ValueError(f"tracks must be ({len(times)}, cameras, features, 2), not {array.shape}")
        out[kind] = array.tolist()
    return {"given": out}


def _main(text: str) -> None:
    from massprops.core.processes import die_with_parent, limit_memory

    die_with_parent()
    limit_memory()
    # what the user's code prints goes nowhere: the pipe is for answers
    say = sayer(os.dup(1))
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        function, given = _load(text)
        say({"parameters": _parameters(given)})
    except (Exception, SystemExit) as error:  # noqa: BLE001  a user's own code
        say({"wrong": f"it cannot be loaded: {first_line(error)}"})
        return
    for line in sys.stdin:
        try:
            say(_answer(function, json.loads(line)))
        except (Exception, SystemExit) as error:  # noqa: BLE001  a user's own code
            say({"wrong": first_line(error)})


if __name__ == "__main__":
    _main(sys.argv[1])
