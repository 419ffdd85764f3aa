"""A stage in a process of its own: `python -P -m massprops.run.child REQUEST.json`, progress on a pipe.

A crash of a native library is then a message, its memory goes back, and the stage can be run again.
"""

from __future__ import annotations

import errno
import json
import os
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from massprops.core.files import plain
from massprops.core.messages import HANDLE, sayer
from massprops.core.parts import Parts
from massprops.core.processes import die_with_parent, limit_memory, peak_memory_mb
from massprops.errors import MasspropsError
from massprops.run.full_disk import disk_full, no_place
from massprops.run.job import Job, ReconstructOptions
from massprops.run.stages import load_stage


def main() -> int:
    """Runs the requested stage; the last line on the pipe is its result."""
    die_with_parent()
    limit_memory()
    request = json.loads(Path(sys.argv[1]).read_text())
    send = sayer(int(os.environ[HANDLE]))

    def say(content: dict[str, Any]) -> None:
        if "progress" not in content:
            content["peak_memory_mb"] = peak_memory_mb()
        send(plain(content))

    last = [0.0]

    def progress(done: int, total: int, what: str = "") -> None:
        now = time.monotonic()
        if now - last[0] > 0.1 or done == total:
            last[0] = now
            say({"progress": [int(done), int(total), str(what)]})

    job = Job(
        run=Path(request["run"]),
        options=_options(request["options"]),
        out=Path(request["out"]),
        progress=progress,
        seed=request["seed"],
        threads=request["threads"],
        key=request["key"],
        force=request["force"],
        parts=Parts(Path(request["parts"])),
    )
    try:
        facts = load_stage(request["stage"], request["package"]).run(job)
        if job.parts.damaged:
            job.warn(f"{len(job.parts.damaged)} finished parts of {request['stage']} were damaged, and were made again")
        if disk_full(job.out):  # some native libraries write half a file without a word
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(job.run))
        say({"facts": facts or {}, "warnings": job.notes})
    except MasspropsError as error:
        say({"error": str(error), "exit_code": error.exit_code, "warnings": job.notes})
    except OSError as error:
        if error.errno not in NO_PLACE:
            return _unexpected(say, error, job)
        say({"error": no_place(error.filename or job.run, str(error.strerror)), "exit_code": 2, "again": True})
    except MemoryError:
        say(
            {
                "error": "not enough memory: fewer --frames or a smaller --max-size",
                "exit_code": 3,
                "warnings": job.notes,
                "again": True,
            }
        )
    except Exception as error:
        return _unexpected(say, error, job)
    return 0


def _options(read: dict[str, Any]) -> ReconstructOptions:
    """Options as they were before they became JSON, which knows no tuples."""
    if read.get("distance") is not None:
        read["distance"] = tuple(read["distance"])
    for name in ("more", "object", "box"):
        read[name] = tuple(read.get(name) or ())
    return ReconstructOptions(**read)


NO_PLACE = (errno.ENOSPC, errno.EACCES, errno.EPERM, errno.EROFS, errno.EDQUOT, errno.EFBIG)
"""Of the place of writing, not of the work."""


def _unexpected(say: Callable[[dict[str, Any]], None], error: Exception, job: Job) -> int:
    if disk_full(job.out):
        say({"error": no_place(job.run, "the disk is full"), "exit_code": 2, "again": True})
        return 0
    traceback.print_exc()
    say({"error": f"{type(error).__name__}: {error}".splitlines()[0], "unexpected": True, "warnings": job.notes})
    return 1


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # native libraries have crashed in their own clean-up, with the work long done
