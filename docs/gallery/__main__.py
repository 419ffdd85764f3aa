"""Runs the scripts: `python docs/gallery [NAME...]`. SHORT=1 runs the short form and leaves pictures in GALLERY_OUT."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent


def main(names: list[str]) -> int:
    scripts = sorted(p for p in HERE.glob("[0-9]*.py") if not names or any(n in p.stem for n in names))
    out = Path(os.environ.get("GALLERY_OUT") or (tempfile.mkdtemp() if os.environ.get("SHORT") else HERE / "output"))
    out.mkdir(parents=True, exist_ok=True)
    failed = 0
    for path in scripts:
        environment = {**os.environ, "GALLERY_OUT": str(out), "OPENBLAS_NUM_THREADS": "1"}
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run(
                [sys.executable, str(path)], cwd=folder, env=environment, capture_output=True, text=True
            )
        if done.returncode or not (out / f"{path.stem}.png").is_file():
            failed += 1
            print(f"FAILED {path.name}\n{done.stderr[-2000:]}")
            continue
        (out / f"{path.stem}.txt").write_text(done.stdout)
        print(f"ok     {path.name}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
