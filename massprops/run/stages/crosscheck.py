"""Stage `crosscheck`: the mesh's inertia against the motion of the same footage."""

from __future__ import annotations

from typing import Any

from massprops.core.files import write_json
from massprops.core.outputs import Outputs
from massprops.run.job import Job

READS = ("publish",)
OPTIONS = ()
PUBLISHES = "crosscheck"
METHODS = ("smoother", "momentum-ls")
"""What the verdict rests on; the filters, slow to compile at first, follow with `massprops crosscheck RUN`."""


def run(job: Job) -> dict[str, Any]:
    """Writes `crosscheck.json` into the run folder; the page is made after it."""
    from massprops.consistency.crosscheck import crosscheck
    from massprops.consistency.trust import enter_verdict

    cross_checked = crosscheck(job.run, methods=METHODS, write=False, progress=job.progress)
    outputs = Outputs(job.run)
    write_json(outputs.staging() / "crosscheck.json", cross_checked.document)
    outputs.publish(PUBLISHES, job.key, force=job.force, derived=True)
    trust = enter_verdict(Outputs(job.run), cross_checked.document)
    partial = f"low confidence: {trust['because'][0]}" if trust and trust["level"] == "low" else None
    return {"verdict": cross_checked.verdict, "p_value": cross_checked.document["p_value"], "partial": partial}
