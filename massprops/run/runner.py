"""Runs the stages of one run folder, each in its own process, and keeps `run.yaml`."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import massprops
from massprops.errors import InputError
from massprops.run.files import hash_of, plain, replace_folder, write_json, write_whole
from massprops.run.job import ReconstructOptions
from massprops.run.stages import ALWAYS, EXTRA, ORDER, load_stage

Watch = Callable[[str, int, int, int, int, str], None]
"""`watch(stage, number, count, done, total, what)`: how far the run is."""


@dataclass
class Outcome:
    """What a run came to.

    Attributes:
        exit_code: 0 done, 2 wrong input, 3 in part.
        reason: why it is not 0, one line.
        partial: why the result is only part of one, though every stage ran.
        warnings: of all stages.
        stages: the entries of `run.yaml`.
    """

    exit_code: int = 0
    reason: str = ""
    partial: str = ""
    warnings: list[str] = field(default_factory=list)
    stages: dict[str, Any] = field(default_factory=dict)


def run_stages(
    run: Path,
    options: ReconstructOptions,
    inputs: Mapping[str, str],
    watch: Watch | None = None,
    order: tuple[str, ...] = ORDER,
    package: str = "massprops.run.stages",
) -> Outcome:
    """Computes what is missing or out of date, in order.

    A stage is current when its folder is there under the key of its inputs: the package's version, its options, and
    the keys of the stages it reads. A stage that cannot finish ends the chain; `ALWAYS` stages still run on what is
    there, and are never kept as current then. Of `EXTRA` stages a failure is a warning, and they are tried again.

    Args:
        run: the run folder, locked by the caller.
        options: what the user asked.
        inputs: sha256 of the source files.
        watch: told of progress.
        order: stage names.
        package: where the stages live.
    """
    outcome = Outcome()
    manifest = _read_manifest(run)
    keys: dict[str, str] = {}
    chosen = asdict(options)
    for number, name in enumerate(order):
        if outcome.exit_code == 2 or (outcome.exit_code and name not in ALWAYS):
            continue
        stage = load_stage(name, package)
        wanted = {k: chosen[k] for k in stage.OPTIONS}
        sources = dict(inputs) if number == 0 else {}
        reads = {r: keys.get(r) for r in stage.READS}
        key = hash_of([massprops.__version__, name, wanted, sources, reads, options.seed])
        keys[name] = key
        folder, before = run / "work" / name, manifest.get(name, {})
        if not outcome.exit_code and before.get("key") == key and folder.is_dir():
            outcome.stages[name] = before
        else:
            if watch:
                watch(name, number, len(order), 0, 0, "")
            entry, code, reason = _run_stage(run, name, package, options, key, number, len(order), watch)
            outcome.stages[name] = entry
            if code and name in EXTRA:
                entry.setdefault("warnings", []).append(f"no {name}: {reason}")
                entry.pop("key", None)
            elif code and not outcome.exit_code:
                outcome.exit_code, outcome.reason = code, reason
            if outcome.exit_code:
                entry.pop("key", None)
            if outcome.exit_code and name not in ALWAYS:
                write_json(
                    run / "work" / "stopped.json",
                    {"exit_code": outcome.exit_code, "reason": outcome.reason, "stage": name},
                )
        partial = (outcome.stages[name].get("facts") or {}).get("partial")
        if partial and not outcome.exit_code and not outcome.partial:
            outcome.partial = str(partial)
            write_json(run / "work" / "stopped.json", {"exit_code": 3, "reason": outcome.partial, "stage": name})
        if watch:
            watch(name, number, len(order), 1, 1, "")
        outcome.warnings += [w for w in outcome.stages[name].get("warnings", []) if w not in outcome.warnings]
        if not outcome.exit_code and not outcome.partial:
            (run / "work" / "stopped.json").unlink(missing_ok=True)
        _write_manifest(run, options, inputs, outcome, manifest, order)
    if outcome.partial and not outcome.exit_code:
        outcome.exit_code, outcome.reason = 3, outcome.partial
        _write_manifest(run, options, inputs, outcome, manifest, order)
    return outcome


def _run_stage(
    run: Path,
    name: str,
    package: str,
    options: ReconstructOptions,
    key: str,
    number: int,
    count: int,
    watch: Watch | None,
) -> tuple[dict[str, Any], int, str]:
    """One stage in a child process: its entry for `run.yaml`, exit code, reason."""
    work = run / "work"
    out = work / f"{name}.tmp-{os.getpid()}"
    shutil.rmtree(out, ignore_errors=True)
    log = work / f"{name}.log"
    threads = options.threads or len(os.sched_getaffinity(0))
    try:
        out.mkdir(parents=True)
        request = work / f"{name}.request.json"
        write_json(
            request,
            {
                "run": run,
                "stage": name,
                "package": package,
                "out": out,
                "options": asdict(options),
                "seed": int(hash_of([options.seed, name])[:8], 16) % (2**31),
                "threads": threads,
            },
        )
        output = log.open("wb")
    except OSError as error:
        return {"status": "failed"}, 2, f"{run}: {error.strerror}: free some space or choose another -o"
    read_end, write_end = os.pipe()
    environment = {
        **os.environ,
        "MASSPROPS_PIPE": str(write_end),
        "OMP_NUM_THREADS": str(threads),
        "OMP_WAIT_POLICY": "passive",
        "OPENBLAS_NUM_THREADS": "1",
        "MKL_NUM_THREADS": "1",
        "GLOG_minloglevel": "1",
        "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
    }
    begun = time.monotonic()
    with output:
        child = subprocess.Popen(
            [sys.executable, "-m", "massprops.run.child", str(request)],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            pass_fds=(write_end,),
            env=environment,
        )
    os.close(write_end)
    said: dict[str, Any] = {}
    try:
        with os.fdopen(read_end) as pipe:
            for line in pipe:
                try:
                    message = json.loads(line)
                except ValueError:
                    continue
                if "progress" in message:
                    if watch:
                        watch(name, number, count, *message["progress"])
                else:
                    said = message
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    except BaseException:
        child.send_signal(signal.SIGKILL)
        child.wait()
        shutil.rmtree(out, ignore_errors=True)
        raise
    entry: dict[str, Any] = {
        "key": key,
        "status": "done",
        "seconds": round(time.monotonic() - begun, 3),
        "cpu_seconds": round(usage.ru_utime + usage.ru_stime, 3),
        "peak_memory_mb": round(usage.ru_maxrss / 1024, 1),
        "facts": plain(said.get("facts", {})),
        "warnings": list(said.get("warnings", [])),
    }
    if "facts" in said:
        try:
            replace_folder(out, work / name)
        except OSError as error:
            return {**entry, "status": "failed"}, 2, f"{run}: {error.strerror}: choose another -o"
        return entry, 0, ""
    entry["status"] = "failed"
    shutil.rmtree(out, ignore_errors=True)
    if "exit_code" in said:
        return entry, int(said["exit_code"]), str(said["error"])
    if "error" in said:
        return entry, 3, f"stage {name} failed: {said['error']} (details in {log})"
    code = child.returncode
    what = signal.Signals(-code).name if code is not None and code < 0 else f"exit code {code}"
    hint = "; most often too little memory: fewer --frames or a smaller --max-size" if code == -signal.SIGKILL else ""
    return entry, 3, f"stage {name} died with {what}{hint} (details in {log})"


def _read_manifest(run: Path) -> dict[str, Any]:
    import yaml

    path = run / "run.yaml"
    if not path.is_file():
        return {}
    try:
        content = yaml.safe_load(path.read_text())
        return dict(content.get("stages", {}))
    except (yaml.YAMLError, AttributeError, TypeError, ValueError):
        return {}


def _write_manifest(
    run: Path,
    options: ReconstructOptions,
    inputs: Mapping[str, str],
    outcome: Outcome,
    before: Mapping[str, Any],
    order: tuple[str, ...],
) -> None:
    import yaml

    stages = {name: outcome.stages.get(name, before.get(name)) for name in order}
    content = {
        "format": "massprops-run/1",
        "massprops": massprops.__version__,
        "inputs": {"source": options.source, "sha256": dict(inputs)},
        "options": plain(asdict(options)),
        "versions": versions(),
        "outcome": {"exit_code": outcome.exit_code, "reason": outcome.reason},
        "stages": {name: entry for name, entry in stages.items() if entry},
    }
    try:
        write_whole(run / "run.yaml", yaml.safe_dump(plain(content), sort_keys=False))
    except OSError as error:
        raise InputError(
            f"{run}: run.yaml cannot be written ({error.strerror}): free some space or choose another -o"
        ) from None


def versions() -> dict[str, str]:
    """Versions of what decides the numbers."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": platform.python_version()}
    for name in (
        "pycolmap",
        "open3d",
        "trimesh",
        "pymeshlab",
        "numpy",
        "scipy",
        "numba",
        "opencv-python-headless",
        "av",
    ):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    return found
