"""The page in a real browser: no error on the console, nothing fetched, the mesh drawn, the buttons at work."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from fake_run import add_crosscheck, make_run

from massprops.report import write_report

BROWSER = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium here: sudo apt-get install chromium")
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--disable-dev-shm-usage",
    "--virtual-time-budget=3000",
    "--enable-logging=stderr",
]


def browse(page: Path, folder: Path, *flags: str, size: str = "1000,1500") -> tuple[str, str, dict]:
    """Opens a page; gives what it printed, its console, and the log of its network."""
    net = folder / "net.json"
    command = [str(BROWSER), *FLAGS, f"--user-data-dir={folder / 'profile'}", f"--log-net-log={net}", *flags]
    child = subprocess.Popen(
        [*command, f"--window-size={size}", page.as_uri()],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        out, err = child.communicate(timeout=60)
    finally:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)
    console = "\n".join(line for line in err.splitlines() if "CONSOLE" in line)
    log = net.read_text()
    try:
        return out, console, json.loads(log)
    except ValueError:  # the browser was closed before the last bracket
        return out, console, json.loads(log.rstrip().rstrip(",") + "]}")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = make_run(tmp_path_factory.mktemp("browser") / "probe", hostile=True)
    add_crosscheck(run)
    return write_report(run)


def asked_by_page(net: dict) -> set[str]:
    """Addresses that were asked for, less those of the browser's own housekeeping."""
    found = {e["params"]["url"] for e in net["events"] if isinstance(e.get("params"), dict) and "url" in e["params"]}
    hosts = {u: urlsplit(u).hostname or "" for u in found if not u.startswith(("file:", "data:", "chrome", "devtools"))}
    return {u for u, host in hosts.items() if not host.endswith((".google.com", ".googleapis.com", ".gstatic.com"))}


def test_without_its_policy_too_nothing_is_fetched(page: Path, tmp_path: Path) -> None:
    """The policy in the page forbids requests; without it there must be none to forbid. And one would be noticed."""
    copy = tmp_path / "open.html"
    copy.write_text(re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page.read_text()))
    assert "Content-Security" not in copy.read_text()
    assert asked_by_page(browse(copy, tmp_path, f"--screenshot={tmp_path / 'a.png'}")[2]) == set()
    control = tmp_path / "control.html"
    control.write_text('<img src="http://nowhere.invalid/x.png">')
    assert asked_by_page(browse(control, tmp_path, f"--screenshot={tmp_path / 'b.png'}")[2])


def test_page_draws_the_mesh_without_errors_or_requests(page: Path, tmp_path: Path) -> None:
    shot = tmp_path / "shot.png"
    _, console, net = browse(page, tmp_path, f"--screenshot={shot}")
    assert console == ""
    assert asked_by_page(net) == set()
    image = cv2.imread(str(shot)).astype(int)
    blue, green, red = image[..., 0], image[..., 1], image[..., 2]
    filled = (red > 120) & (red > 2.2 * green) & (red > 2.2 * blue)
    assert filled.sum() > 500, "filled faces are not drawn in red"
    rows, columns = np.nonzero(filled)
    around = image[rows.min() - 40 : rows.max() + 40, columns.min() - 40 : columns.max() + 40].reshape(-1, 3)
    assert len(np.unique(around // 8, axis=0)) > 30, "the mesh has no shading"


def test_buttons_turn_the_mesh_and_hostile_names_stay_words(page: Path, tmp_path: Path) -> None:
    """A probe script beside the page's own: what the canvas shows before and after a button and a key."""
    probe = """<script>window.addEventListener("load", () => {
      const host = document.querySelector(".viewer"), canvas = host.querySelector("canvas"), out = {};
      const look = () => { const gl = canvas.getContext("webgl"), d = new Uint8Array(canvas.width * canvas.height * 4);
        gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, d);
        let drawn = 0, red = 0, sum = 0;
        for (let i = 0; i < d.length; i += 4) if (d[i + 3]) { drawn++; sum = (sum * 31 + d[i] + i) % 1000003; if (d[i] > 110 && d[i] > 2.2 * d[i + 1] && d[i] > 2.2 * d[i + 2]) red++; }
        return { drawn, red, sum }; };
      const after = (act, name, next) => { act(); out[name] = look(); next(); };
      const box = (n) => host.querySelector(`[data-show=${n}]`);
      after(() => {}, "start", () => after(() => host.querySelector("[data-view=top]").click(), "top",
        () => after(() => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" })), "key",
        () => after(() => canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -600 })), "near",
        () => after(() => host.querySelector("[data-view=reset]").click(), "back",
        () => after(() => box("filled").click(), "plain",
        () => after(() => box("cameras").click(), "path", () => {
          const p = document.createElement("pre"); p.id = "probe"; p.textContent = JSON.stringify({ ...out, hit: window.hit || 0 }); document.body.appendChild(p); })))))));
    });</script>"""
    copy = tmp_path / "probe.html"
    copy.write_text(page.read_text().replace("</body>", probe + "</body>"))
    out, console, _ = browse(copy, tmp_path, "--dump-dom", "--virtual-time-budget=6000")
    assert console == ""
    found = json.loads(out.split('id="probe">')[1].split("</pre>")[0])
    assert found["hit"] == 0
    assert found["start"]["drawn"] > 5000 and found["start"]["red"] > 300
    assert found["top"]["sum"] != found["start"]["sum"] != found["key"]["sum"] != found["top"]["sum"]
    assert found["near"]["drawn"] > 1.2 * found["key"]["drawn"]
    assert found["back"] == found["start"]
    assert found["plain"]["red"] < 0.1 * found["start"]["red"]
    assert found["path"]["drawn"] < 0.6 * found["start"]["drawn"]  # farther away, so that the cameras are in view
