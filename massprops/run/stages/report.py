"""Stage `report`: the one-file page and the short verdict of the run."""

from __future__ import annotations

import json

from massprops.run.files import write_json
from massprops.run.job import Job

READS = ("publish", "crosscheck")
OPTIONS = ()


def run(job: Job) -> dict:
    """Writes `report.json` and `report.html` into the run folder."""
    from massprops.report import write_report

    stopped = job.run / "work" / "stopped.json"
    verdict = json.loads(stopped.read_text()) if stopped.is_file() else {"exit_code": 0, "reason": "", "stage": None}
    write_json(job.run / "report.json", {"format": "massprops-report/1", **verdict})
    page = write_report(job.run)
    return {"bytes": page.stat().st_size}
