"""`python -m tests.fuzz.guided`: inputs that reach new lines of massprops are mutated further (atheris, libFuzzer).

Each target runs in a process of its own, since libFuzzer does not come back. What is judged wrong is the oracle's
business, as in `python -m tests.fuzz`; the tokens that readers trip over go to libFuzzer as its dictionary.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path

MOST_BYTES = 20_000


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000, help="for all targets together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=60.0, help="for all targets together, at most")
    parser.add_argument("--alone", metavar="PLACE", help=argparse.SUPPRESS)
    parser.add_argument("target", nargs="*", default=[])
    asked = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        print("guided: atheris is not installed (pip install atheris): only the inputs of tests.fuzz were tried")
        return 0
    if asked.alone:
        run_alone(asked.target[0], Path(asked.alone), asked.inputs, asked.seed, 60 * asked.minutes)
        return 0
    from .targets import targets

    names = asked.target or list(targets())
    total = wrong = 0
    for name in names:
        tried, found = several(name, asked.inputs // len(names), asked.seed, asked.minutes / len(names))
        print(f"{name}: {tried} guided inputs, {found} findings", flush=True)
        total, wrong = total + tried, wrong + found
    print(f"all: {total} guided inputs, {wrong} findings")
    return 1 if wrong else 0


def several(name: str, inputs: int, seed: int, minutes: float) -> tuple[int, int]:
    """Inputs tried of one target, in a process of its own, and kinds of findings."""
    from .__main__ import keep

    with tempfile.TemporaryDirectory(prefix="massprops-guided-") as place:
        with (Path(place) / "log").open("wb") as log:  # what libFuzzer says of its own work
            subprocess.run(
                [sys.executable, "-m", "tests.fuzz.guided", name, "--alone", place, "--inputs", str(inputs),
                 "--seed", str(seed), "--minutes", str(minutes)],
                stdin=subprocess.DEVNULL, stderr=log, check=False,
            )  # fmt: skip
        told = Path(place) / "told.json"
        if not told.is_file():
            print(f"  {name}: the process ended before its first input", flush=True)
            return 0, 1
        said = json.loads(told.read_text())
        if said["in_work"]:
            content = (Path(place) / "input").read_bytes()
            print(f"  {name}: the process died over an input: {keep(name, said['file'], content)}", flush=True)
        return said["tried"], said["found"] + said["in_work"]


def run_alone(name: str, place: Path, inputs: int, seed: int, limit_s: float) -> None:
    """libFuzzer over one target; what came of it is told in `told.json`, written before and after each input."""
    import atheris

    with atheris.instrument_imports(include=["massprops", "massprops_cli"]):
        from .targets import targets

        target = targets()[name]()
        _import_readers()
    from .__main__ import corpus, keep, kind_of
    from .oracle import fault
    from .targets import fresh, restore

    files = sorted(target.seeds)
    folder = place / "f"
    fresh(target, folder)
    kinds: set[str] = set()
    said = {"tried": 0, "found": 0, "in_work": 0, "file": ""}

    def tell(**changes: object) -> None:
        said.update(changes)  # type: ignore[arg-type]
        (place / "told.json").write_text(json.dumps(said))

    def one(data: bytes) -> None:
        if not data:
            return
        file, content = files[data[0] % len(files)], data[1:]
        (place / "input").write_bytes(content)
        tell(in_work=1, file=file)
        wrong = fault(target, folder, file, content)
        restore(target, folder, file)
        if wrong and kind_of(wrong) not in kinds:
            kinds.add(kind_of(wrong))
            print(f"  {name}: {wrong}: {keep(name, file, content)}", flush=True)
        tell(tried=said["tried"] + 1, found=len(kinds), in_work=0)  # type: ignore[operator]

    seeds = place / "seeds"
    seeds.mkdir()
    kept = corpus(name)
    for number, file in enumerate(files):
        for k, content in enumerate([*target.seeds[file], *kept.get(file, [])]):
            (seeds / f"{number}-{k}").write_bytes(bytes([number]) + content)
    (place / "tokens").write_text(dictionary())
    options = [f"-runs={inputs}", f"-seed={seed}", f"-max_total_time={max(1, int(limit_s))}", f"-max_len={MOST_BYTES}",
               f"-dict={place / 'tokens'}", "-verbosity=0", "-rss_limit_mb=0", "-timeout=600", f"-artifact_prefix={place}/"]  # fmt: skip
    atheris.Setup([sys.argv[0], *options, str(seeds)], one)
    atheris.Fuzz()


def _import_readers() -> None:
    """All modules of massprops that read something, so that they are instrumented."""
    import contextlib
    import pkgutil

    import massprops

    for module in pkgutil.walk_packages(massprops.__path__, "massprops."):
        if module.name.split(".")[1] in ("documents", "sequence", "exchange", "mass", "capture", "core", "campaigns"):
            with contextlib.suppress(ImportError):
                __import__(module.name)


def dictionary() -> str:
    """The tokens of the mutations in libFuzzer's notation; it takes none of over 64 bytes."""
    from .mutations import TOKENS

    lines = []
    for token in TOKENS:
        if 0 < len(token) <= 60:
            lines.append('"' + "".join(f"\\x{b:02x}" for b in token) + '"')
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
