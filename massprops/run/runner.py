"""Runs the stages of one run folder, each in its own process, and keeps `run.yaml`."""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import massprops
from massprops.core.files import (
    hash_of,
    hash_tree,
    make_folder,
    plain,
    remove,
    remove_folder,
    replace_folder,
    write_json,
    write_whole,
)
from massprops.core.log import log
from massprops.core.messages import HANDLE
from massprops.core.outputs import BASES, OWN, Outputs, lock_to_pass
from massprops.core.processes import address_space_hint, child_environment, processors, python_module
from massprops.documents.loading import load_json, load_yaml
from massprops.errors import InputError
from massprops.run.full_disk import disk_full, no_place
from massprops.run.job import ReconstructOptions
from massprops.run.stages import ALWAYS, EXTRA, ORDER, Stage, load_stage

Watch = Callable[[str, int, int, int, int, str], None]
"""`watch(stage, number, count, done, total, what)`: how far the run is."""

COMMAND = "reconstruct"


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
    force: bool = False,
) -> Outcome:
    """Computes what is missing, out of date or damaged, in order.

    A stage is current when its folder is there under the key of its inputs (the package's version, its options, and
    the keys of the stages it reads), and its files, in `work/` and published, are what it wrote. A stage that cannot
    finish ends the chain; `ALWAYS` stages still run on what is there, and are never kept as current then. Of `EXTRA`
    stages a failure is a warning, and they are tried again, as are those that had to do without them.

    An input that is refused before any stage is done leaves an earlier run in the folder as it was. From the first
    stage that is done, the folder is the new run's, and what the earlier one left goes out of sight.

    Args:
        run: the run folder, locked by the caller.
        options: what the user asked.
        inputs: sha256 of the source files.
        watch: told of progress.
        order: stage names.
        package: where the stages live.
        force: files in the folder that are not massprops' may be replaced.
    """
    return _Chain(run, options, inputs, watch, order, package, force).go()


class _Chain:
    """One pass over the stages of a run folder."""

    def __init__(
        self,
        run: Path,
        options: ReconstructOptions,
        inputs: Mapping[str, str],
        watch: Watch | None,
        order: tuple[str, ...],
        package: str,
        force: bool,
    ) -> None:
        self.run, self.options, self.inputs, self.watch = run, options, inputs, watch
        self.order, self.package, self.force = order, package, force
        self.stages = {name: load_stage(name, package) for name in order}
        self.keys = _keys(self.stages, options, inputs)
        self.before, self.outcome_before = _read_manifest(run)
        self.outcome = Outcome()
        self.begun, self.partial_stage = False, ""
        self.outputs = _own_work(run, force)

    def go(self) -> Outcome:
        """Runs the chain; see `run_stages`."""
        outcome = self.outcome
        for number, name in enumerate(self.order):
            if outcome.exit_code == 2 or (outcome.exit_code and name not in ALWAYS):
                continue
            if not outcome.exit_code and self._current(name):
                outcome.stages[name] = self.before[name]
                remove_folder(self._parts(name).parent)
                log.info("stage %s: kept, its inputs are as they were", name)
            else:
                if name in ALWAYS:
                    self._record_outcome()
                if not self._make(name, number):
                    self._forget_refused()
                    return outcome
            self._note_partial(name)
            if self.watch:
                self.watch(name, number, len(self.order), 1, 1, "")
            outcome.warnings += [w for w in outcome.stages[name].get("warnings", []) if w not in outcome.warnings]
            if self.begun:
                self._write_manifest()
        self._record_outcome()
        if outcome.partial and not outcome.exit_code:
            outcome.exit_code, outcome.reason = 3, outcome.partial
        if (self.begun or self.outcome_before is not None) and self.outcome_before != self._conclusion:
            self._write_manifest()  # the last command may have been killed before it could tell
        return outcome

    @property
    def _conclusion(self) -> dict[str, Any]:
        return {"exit_code": self.outcome.exit_code, "reason": self.outcome.reason}

    def _current(self, name: str) -> bool:
        """Whether a stage need not be run; says so where only damage makes it run again."""
        key, before = self.keys[name], self.before.get(name, {})
        tree = self.outputs.trees.get(f"work/{name}")
        if before.get("key") != key or tree is None or tree["key"] != key:
            return False
        if not self.outputs.intact(f"work/{name}"):
            self.outcome.warnings.append(f"work/{name} was changed, damaged or removed, and is computed again")
            return False
        owner = getattr(self.stages[name], "PUBLISHES", None)
        if owner is not None and not self.outputs.complete(owner, key):
            if any(entry["by"] == owner for entry in self.outputs.files.values()):
                self.outcome.warnings.append(
                    f"what stage {name} published was changed or removed, and is computed again"
                )
            return False
        return True

    def _make(self, name: str, number: int) -> bool:
        """Runs one stage and keeps what it wrote; False where it refused the input before anything was changed."""
        outcome, work = self.outcome, self.run / "work"
        if self.watch:
            self.watch(name, number, len(self.order), 0, 0, "")
        out = work / f"{name}.tmp-{os.getpid()}"
        entry, code, reason = self._run_stage(name, number, out)
        try:
            self.outputs = Outputs(self.run)  # the stage itself may have published, or have been stopped as it did
            self.outputs.recover()
            if code == 2 and not self.begun and name not in EXTRA:
                outcome.exit_code, outcome.reason = code, reason
                return False
            self._begin()
            if not code:
                replace_folder(out, work / name)
                self.outputs.record_tree(f"work/{name}", COMMAND, self.keys[name], entry.pop("sha256"))
                remove_folder(self._parts(name).parent)
            elif not outcome.exit_code:
                self._drop(name)
        except OSError as error:
            code, reason = 2, no_place(self.run, str(error.strerror))
            entry["status"] = "failed"
        finally:
            remove_folder(out)
        outcome.stages[name] = entry
        if code and name in EXTRA:
            entry.setdefault("warnings", []).append(f"no {name}: {reason}")
            entry.pop("key", None)
        elif code and not outcome.exit_code:
            outcome.exit_code, outcome.reason = code, reason
        if outcome.exit_code or self._lacks_what_it_reads(name):
            entry.pop("key", None)
        if outcome.exit_code and name not in ALWAYS:
            for later in self.order:  # what follows is made of what is there: only of what is sound
                if not self.outputs.intact(f"work/{later}"):
                    self._drop(later)
            self._write_stopped(outcome.exit_code, outcome.reason, name)
        return True

    def _lacks_what_it_reads(self, name: str) -> bool:
        """Whether a stage had to do without what another one makes, and is to be made again once that is there."""
        made = (self.outcome.stages.get(read) for read in self.stages[name].READS)
        return any(entry is not None and "key" not in entry for entry in made)

    def _begin(self) -> None:
        """From here on the folder is this run's: what an earlier one left, and is not of it, goes out of sight."""
        if self.begun:
            return
        outputs = self.outputs
        base = next((self.keys[n] for n, s in self.stages.items() if getattr(s, "PUBLISHES", None) in BASES), None)
        held = outputs.base
        if held is not None and held != base:
            outputs.retract()
            if held != f"{base}-stopped":
                self.outcome.warnings.append(
                    f"the earlier results in this folder belong to other inputs or options: they are now in {OWN}/previous"
                )
        for name in self.order:
            if self.before.get(name, {}).get("key") != self.keys[name]:
                self._drop(name)
        outputs.list_live(COMMAND, "run.yaml")
        self.begun = True
        self._write_manifest()

    def _drop(self, name: str) -> None:
        """Takes away what an earlier run left of a stage."""
        self.before.pop(name, None)
        self._parts(name)
        if f"work/{name}" in self.outputs.trees:
            self.outputs.record_tree(f"work/{name}", COMMAND, "", None)
        remove_folder(self.run / "work" / name)

    def _forget_refused(self) -> None:
        """Leaves nothing in a folder in which nothing came about."""
        if not (self.run / "run.yaml").exists():
            Outputs(self.run).forget()

    def _note_partial(self, name: str) -> None:
        outcome = self.outcome
        facts = outcome.stages[name].get("facts")
        partial = facts.get("partial") if isinstance(facts, dict) else None
        if partial and not outcome.exit_code and not outcome.partial:
            outcome.partial, self.partial_stage = str(partial), name

    def _record_outcome(self) -> None:
        """Makes `stopped.json` say what this run came to; the last command may have met a full disk, or been killed."""
        if self.outcome.exit_code:  # written where it failed
            return
        path = self.run / "work" / "stopped.json"
        if not self.outcome.partial:
            if path.exists():
                remove(path)
            return
        try:
            stopped = load_json(path)
        except InputError:
            stopped = {}
        if stopped != {"exit_code": 3, "reason": self.outcome.partial, "stage": self.partial_stage}:
            self._write_stopped(3, self.outcome.partial, self.partial_stage)

    def _write_stopped(self, code: int, reason: str, stage: str) -> None:
        try:
            write_json(self.run / "work" / "stopped.json", {"exit_code": code, "reason": reason, "stage": stage})
        except OSError as error:
            raise _no_manifest(self.run, error) from None

    def _run_stage(self, name: str, number: int, out: Path) -> tuple[dict[str, Any], int, str]:
        """One stage in a child process, which writes into `out`: its entry for `run.yaml`, exit code, reason."""
        written = self.run / "work" / f"{name}.log"
        try:
            request = self._write_request(name, out)
            output = written.open("wb")
        except OSError as error:
            return {"status": "failed"}, 2, no_place(self.run, str(error.strerror))
        begun = time.monotonic()
        with output:
            child, answer, usage = self._run_child(name, number, request, output)
        entry: dict[str, Any] = {
            "key": self.keys[name],
            "status": "done",
            "seconds": round(time.monotonic() - begun, 3),
            "cpu_seconds": round(usage.ru_utime + usage.ru_stime, 3),
            # what the system says of a child is never less than its parent had in memory as it began
            "peak_memory_mb": round(answer.get("peak_memory_mb") or usage.ru_maxrss / 1024, 1),
            "facts": plain(answer.get("facts", {})),
            "warnings": list(answer.get("warnings", [])),
        }
        log.info(
            "stage %s: %s", name, ", ".join(f"{k} {entry[k]}" for k in ("seconds", "cpu_seconds", "peak_memory_mb"))
        )
        log.debug("stage %s: %s", name, entry["facts"])
        if "facts" in answer:
            entry["sha256"] = hash_tree(out)
            return entry, 0, ""
        entry["status"] = "failed"
        if "exit_code" in answer and not answer.get("again"):  # as it would be the next time
            remove_folder(self._parts(name).parent)
        return entry, *_what_failed(name, answer, child.returncode, written)

    def _parts(self, name: str) -> Path:
        """Where a stage keeps what it has finished of its work, until it is done; what it kept under another key goes."""
        place = self.run / "work" / f"{name}.parts"
        for former in place.glob("*"):
            if former.name != self.keys[name]:
                remove_folder(former)
        return place / self.keys[name]

    def _write_request(self, name: str, out: Path) -> Path:
        remove_folder(out)
        make_folder(out)
        request = self.run / "work" / f"{name}.request.json"
        content = {
            "run": self.run,
            "stage": name,
            "package": self.package,
            "out": out,
            "options": asdict(self.options),
            "seed": int(hash_of([self.options.seed, name])[:8], 16) % (2**31),
            "threads": self._threads,
            "key": self.keys[name] + ("-stopped" if self.outcome.exit_code else ""),
            "force": self.force,
            "parts": self._parts(name),
        }
        write_json(request, content)
        return request

    @property
    def _threads(self) -> int:
        return self.options.threads or processors()

    def _run_child(self, name: str, number: int, request: Path, output: Any) -> tuple[Any, dict[str, Any], Any]:
        """Starts a stage's process and listens to it until it ends: the process, its last word, what it used."""
        read_end, write_end = os.pipe()
        environment = child_environment(
            **{HANDLE: str(write_end)},
            OMP_NUM_THREADS=str(self._threads),
            OMP_WAIT_POLICY="passive",
            OPENBLAS_NUM_THREADS="1",
            MKL_NUM_THREADS="1",
            GLOG_minloglevel="1",
        )
        answer: dict[str, Any] = {}
        child: subprocess.Popen[bytes] | None = None
        try:
            with os.fdopen(read_end) as pipe:
                try:
                    child = subprocess.Popen(
                        python_module("massprops.run.child", str(request)),
                        stdin=subprocess.DEVNULL,
                        stdout=output,
                        stderr=subprocess.STDOUT,
                        pass_fds=(write_end, *lock_to_pass(self.run)),
                        env=environment,
                    )
                finally:
                    os.close(write_end)
                for line in pipe:
                    try:
                        message = json.loads(line)
                    except ValueError:
                        continue
                    if "progress" not in message:
                        answer = message
                    elif self.watch:
                        self.watch(name, number, len(self.order), *message["progress"])
            _, status, usage = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
            if child.returncode < 0 and not answer and disk_full(self.run / "work"):
                answer = {"error": no_place(self.run, "the disk is full"), "exit_code": 2, "again": True}
        except BaseException:
            if child is not None:
                child.send_signal(signal.SIGKILL)
                child.wait()
            remove_folder(self.run / "work" / f"{name}.tmp-{os.getpid()}")
            raise
        return child, answer, usage

    def _write_manifest(self) -> None:
        import yaml

        stages = {name: self.outcome.stages.get(name, self.before.get(name)) for name in self.order}
        content = {
            "format": "massprops-run/1",
            "massprops": massprops.__version__,
            "inputs": {"source": self.options.source, "sha256": dict(self.inputs)},
            "options": plain(asdict(self.options)),
            "versions": versions(),
            "outcome": self._conclusion,
            "stages": {name: entry for name, entry in stages.items() if entry},
        }
        try:
            dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
            text = yaml.dump(plain(content), Dumper=dumper, sort_keys=False)
            write_whole(self.run / "run.yaml", text, self.outputs.place)
            self.outcome_before = self._conclusion
        except OSError as error:
            raise _no_manifest(self.run, error) from None


def _keys(stages: Mapping[str, Stage], options: ReconstructOptions, inputs: Mapping[str, str]) -> dict[str, str]:
    """The key of each stage: a hash of everything that its result depends on."""
    keys: dict[str, str] = {}
    chosen = asdict(options)
    for number, (name, stage) in enumerate(stages.items()):
        wanted = {k: chosen[k] for k in stage.OPTIONS}
        sources = dict(inputs) if number == 0 else {}
        reads = {r: keys.get(r) for r in stage.READS}
        keys[name] = hash_of([massprops.__version__, name, wanted, sources, reads, options.seed])
    return keys


def _own_work(run: Path, force: bool) -> Outputs:
    """The run's record, with any interrupted change finished and `work/` claimed.

    Raises:
        InputError: `work/` is somebody else's, or cannot be written.
    """
    outputs = Outputs(run)
    try:
        outputs.recover()
        outputs.check(COMMAND, ["work/"], force=force)
        work = run / "work"
        outputs.refuse_links(*work.glob("*"), *work.glob("*.parts/*"))
        outputs.take_folder("work", COMMAND)
        make_folder(work)
        for stale in (*work.glob("*.tmp-*"), *work.glob(".*.old"), *work.glob(".*.tmp")):
            remove_folder(stale) if stale.is_dir() else remove(stale)
    except OSError as error:
        raise InputError(f"{run}: cannot be written ({error.strerror}): choose another place with -o") from None
    return outputs


def _what_failed(name: str, answer: Mapping[str, Any], code: int | None, written: Path) -> tuple[int, str]:
    """Exit code and reason of a stage that did not finish."""
    if "exit_code" in answer:
        return int(answer["exit_code"]), str(answer["error"])
    if "error" in answer:
        return (
            3,
            f"stage {name} failed: {str(answer['error']).rstrip('.')}{address_space_hint()} (details in {written})",
        )
    what = signal.Signals(-code).name if code is not None and code < 0 else f"exit code {code}"
    hint = "; most often too little memory: fewer --frames or a smaller --max-size" if code == -signal.SIGKILL else ""
    return 3, f"stage {name} died with {what}{hint or address_space_hint()} (details in {written})"


def _no_manifest(run: Path, error: OSError) -> InputError:
    return InputError(f"{run}: run.yaml cannot be written ({error.strerror}): free some space or choose another -o")


def _read_manifest(run: Path) -> tuple[dict[str, dict[str, Any]], Any]:
    """The stages' entries of `run.yaml` and its outcome; what cannot be read counts as not done."""
    try:
        content = load_yaml(run / "run.yaml")
        return {str(name): dict(entry) for name, entry in content["stages"].items()}, content.get("outcome")
    except (InputError, AttributeError, TypeError, ValueError, KeyError):
        return {}, None


def versions() -> dict[str, str]:
    """Versions of what decides the numbers."""
    return dict(_versions())


@functools.cache
def _versions() -> dict[str, str]:
    import platform
    from importlib.metadata import PackageNotFoundError, version

    package_versions = {"python": platform.python_version()}
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
            package_versions[name] = version(name)
        except PackageNotFoundError:
            package_versions[name] = "missing"
    return package_versions
