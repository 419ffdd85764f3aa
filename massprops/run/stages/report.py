"""Stage `report`: the one-file page and the short verdict of the run."""

from __future__ import annotations

import json
from typing import Any

from massprops.core.outputs import Outputs
from massprops.run.job import Job

READS = ("publish", "crosscheck")
OPTIONS = ()
PUBLISHES = "report"


def run(job: Job) -> dict[str, Any]:
    """Writes `report.json` and `report.html` into the run folder."""
    from massprops.report.page import publish_report

    stopped = job.run / "work" / "stopped.json"
    verdict = json.loads(stopped.read_text()) if stopped.is_file() else {"exit_code": 0, "reason": "", "stage": None}
    page = publish_report(Outputs(job.run), job.key, verdict, job.force)
    return {"bytes": page.stat().st_size}
