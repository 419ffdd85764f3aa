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
        "`reconstruct`, `mass`, `simulate` and `campaign` write a folder, so they need `-o`. The other commands print their "
        "result, and also store it if you give `-o`. With `-v` a command logs what it does, with `-vv` in detail.",
        "",
        "| exit code | |",
        "|---|---|",
        "| 0 | done |",
        "| 2 | the input or an option is wrong; one line tells what to do |",
        "| 3 | done in part, or not possible from this data; the reason is in `report.json`, and finished results are kept |",
        "| 130 | interrupted; to continue a run or a campaign, give the same command again |",
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
