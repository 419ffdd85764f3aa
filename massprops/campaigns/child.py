"""Runs in a process of their own: `python -P -m massprops.campaigns.child`, requests on stdin, replies on a pipe.

A crash of native code, an endless run, or one that takes all memory then ends this process only.
Per request two lines: `ready` with the versions of the code here, then `rows` or `raised`.
"""

from __future__ import annotations

import json
import os
import select
import sys
import time
import traceback
from pathlib import Path
from typing import Any

IDLE_S = 600.0
"""Without work for so long, the process ends: nothing stays behind on a cluster."""


def main() -> int:
    """Answers requests until stdin ends."""
    from massprops.core.messages import HANDLE, sayer
    from massprops.core.processes import die_with_parent, limit_memory

    die_with_parent()
    limit_memory()
    from massprops.campaigns.draws import drawn
    from massprops.campaigns.kinds import load_kind
    from massprops.campaigns.versions import versions

    say = sayer(int(os.environ.pop(HANDLE)))
    while select.select([sys.stdin], [], [], IDLE_S)[0]:
        line = sys.stdin.readline()
        if not line:
            break
        request = json.loads(line)
        kind = load_kind(request["kind"])
        say({"ready": versions()})
        wall, cpu = time.monotonic(), _cpu()
        try:
            rows = _rows(kind, request, drawn)
            reply: dict[str, Any] = {"rows": rows}
        except Exception as error:
            if os.environ.get("MASSPROPS_DEBUG"):
                traceback.print_exc()
            reply = {"raised": _said(error)}
        say({**reply, "wall_s": time.monotonic() - wall, "cpu_s": _cpu() - cpu})
    return 0


def _rows(kind: Any, request: dict[str, Any], drawn: Any) -> list[dict[str, Any]]:
    from massprops.core.files import plain

    values, seeds, draw = request["parameters"], request["seeds"], request["draw"]
    folder = Path(request["folder"]) if request["folder"] else None
    if draw:
        rows = []
        for seed in seeds:
            chosen = drawn(draw, seed)
            rows += [{**chosen, **row} for row in kind.runs({**values, **chosen}, [seed], folder)]
    else:
        rows = kind.runs(values, seeds, folder)
    if len(rows) != len(seeds):
        raise RuntimeError(f"{len(rows)} rows for {len(seeds)} seeds")
    return [plain(row) for row in rows]


def _cpu() -> float:
    """Processor time of this process and of those it ended [s]."""
    return float(sum(os.times()[:4]))


def _said(error: BaseException) -> str:
    """The error in one line, with where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    text = " ".join(str(error).split())[:300]
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {text}{place}"


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    os._exit(status)  # native libraries have crashed in their own clean-up, with the work long done
