"""Every command's help, as the terminal shows it."""

from __future__ import annotations

import os
import subprocess
import sys

from massprops_cli.main import COMMANDS


def pages() -> dict[str, str | bytes]:
    parts = [
        "# Command line",
        "",
        "A command whose result is a folder needs `-o`: `reconstruct`, `mass`, `simulate`, `campaign`. The others print "
        "their result, and keep it where `-o` is given. `-v` says what is done, `-vv` also what the libraries say.",
        "",
        "| exit code | |",
        "|---|---|",
        "| 0 | done |",
        "| 2 | the input or an option is wrong; one line says what to do |",
        "| 3 | done in part, or not possible from this data; the reason is in `report.json`, what was computed is kept |",
        "| 130 | interrupted; the same command continues a run or a campaign |",
        "",
    ]
    for name in COMMANDS:
        parts += [f"## {name}", "", "```text", shown(name), "```", ""]
    return {"commands.md": "\n".join(parts)}


def shown(name: str) -> str:
    code = "from massprops_cli.main import main; main()"
    environment = {**os.environ, "COLUMNS": "100"}
    done = subprocess.run(
        [sys.executable, "-c", code, name, "-h"], capture_output=True, text=True, check=True, env=environment
    )
    return done.stdout.rstrip()
