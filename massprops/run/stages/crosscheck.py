"""Stage `crosscheck`: the mesh's inertia against the motion of the same footage."""

from __future__ import annotations

from massprops.run.job import Job

READS = ("publish",)
OPTIONS = ()
METHODS = ("smoother", "momentum-ls")
"""What the verdict rests on; the filters, slow to compile at first, follow with `massprops crosscheck RUN`."""


def run(job: Job) -> dict:
    """Writes `crosscheck.json` into the run folder; the page is made after it."""
    from massprops.crosscheck.crosscheck import crosscheck

    (job.run / "crosscheck.json").unlink(missing_ok=True)
    found = crosscheck(job.run, methods=METHODS, report=False, progress=job.progress)
    return {"verdict": found.verdict, "p_value": found.document["p_value"]}
