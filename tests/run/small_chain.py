"""A chain of four small stages that publish as the real ones do, run in this process or in its own."""

from __future__ import annotations

import json
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from massprops.core.outputs import claim
from massprops.errors import MasspropsError
from massprops.run.child import NO_PLACE
from massprops.run.job import Job, ReconstructOptions
from massprops.run.runner import Outcome, run_stages
from massprops.run.stages import load_stage

ORDER = ("first", "second", "publish", "report")
FLAGS: set[str] = set()
"""What goes wrong, where the stages run in this process."""
STAGES = {
    "first": """
        READS, OPTIONS = (), ("frames",)
        def run(job):
            if "refuse" in FLAGS:
                raise InputError("the input is wrong")
            write_whole(job.out / "n", str(job.options.frames))
            return {"n": job.options.frames}
    """,
    "second": """
        READS, OPTIONS = ("first",), ("density",)
        def run(job):
            if "fail" in FLAGS:
                raise NotPossible("nothing to be seen")
            value = float((job.work("first") / "n").read_text()) * (job.options.density or 1000.0)
            write_whole(job.out / "value", repr(value))
            return {"value": value}
    """,
    "publish": """
        READS, OPTIONS, PUBLISHES = ("first", "second"), (), "reconstruct"
        def run(job):
            outputs = Outputs(job.run)
            new = outputs.staging()
            (new / "masks").mkdir()
            write_whole(new / "masks" / "a.png", (job.work("first") / "n").read_text())
            if job.work("second").is_dir():
                value = (job.work("second") / "value").read_text()
                write_whole(new / "massprops.json", '{"volume": %s}' % value)
                write_whole(new / "mesh.ply", value)
            outputs.publish(PUBLISHES, job.key, force=job.force)
            return {}
    """,
    "report": """
        READS, OPTIONS, PUBLISHES = ("publish",), (), "report"
        def run(job):
            outputs = Outputs(job.run)
            stopped = (job.run / "work" / "stopped.json").exists()
            write_whole(outputs.staging() / "report.html", f"stopped: {stopped}")
            outputs.publish(PUBLISHES, job.key, derived=True, keep_old=False)
            return {}
    """,
}
HEAD = """
from massprops.core.files import write_whole
from massprops.core.outputs import Outputs
from massprops.errors import InputError, NotPossible
try:
    from small_chain import FLAGS
except ImportError:
    FLAGS = set()
"""


def make_package(folder: Path) -> str:
    """Writes the stages as a package; its name."""
    name = f"chain_{abs(hash(str(folder))) % 10**8}"
    (folder / name).mkdir()
    (folder / name / "__init__.py").write_text("")
    for stage, body in STAGES.items():
        (folder / name / f"{stage}.py").write_text(HEAD + textwrap.dedent(body))
    return name


def go(run: Path, package: str, **options: Any) -> Outcome:
    """The chain in a run folder, as `reconstruct` calls it."""
    with claim(run, "reconstruct", ["run.yaml", "massprops.json", "mesh.ply", "masks/", "work/"]):
        return run_stages(run, ReconstructOptions(**options), {"a": "1"}, order=ORDER, package=package)


def converse(chain: Any, name: str, number: int, request: Path, output: Any) -> tuple[Any, dict[str, Any], Any]:
    """In place of `_Chain._run_child`: the stage in this process, where faults can be counted."""
    asked = json.loads(request.read_text())
    job = Job(
        chain.run,
        ReconstructOptions(**asked["options"]),
        Path(asked["out"]),
        key=asked["key"],
        force=asked["force"],
    )
    used = SimpleNamespace(ru_utime=0.0, ru_stime=0.0, ru_maxrss=0)
    said: dict[str, Any]
    try:
        said = {"facts": load_stage(name, chain.package).run(job), "warnings": job.notes}
    except MasspropsError as error:
        said = {"error": str(error), "exit_code": error.exit_code}
    except OSError as error:
        said = {"error": str(error.strerror), "exit_code": 2} if error.errno in NO_PLACE else {"error": str(error)}
    return SimpleNamespace(returncode=0), said, used


sys.modules.setdefault("small_chain", sys.modules[__name__])
