"""Opens pages in headless Chromium: what they print, ask for, and how they lie in windows of three widths."""

from __future__ import annotations

import base64
import hashlib
import html
import importlib.util
import json
import os
import shutil
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

BROWSER = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium here: sudo apt-get install chromium")
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
        out, err = child.communicate(timeout=180)
    finally:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)
    # pages of the browser's own have a console too: without a network they wait for a font
    console = "\n".join(line for line in err.splitlines() if "CONSOLE" in line and "source: chrome://" not in line)
    log = net.read_text()
    try:
        return out, console, json.loads(log)
    except ValueError:  # the browser was closed before the last bracket
        return out, console, json.loads(log.rstrip().rstrip(",") + "]}")


def with_scripts(page: str, *codes: str) -> str:
    """The page with scripts of the test, which its policy lets run by their hashes."""
    hashes = ["'sha256-" + base64.b64encode(hashlib.sha256(code.encode()).digest()).decode() + "'" for code in codes]
    for own in ("script-src 'none'", "script-src 'sha256"):  # a page without scripts of its own allows none
        if own in page:
            kept = "" if own.endswith("'none'") else "'sha256"
            page = page.replace(own, f"script-src {' '.join(hashes)} {kept}", 1)
            break
    else:
        raise AssertionError("the page has no policy for scripts")
    return page.replace("</body>", "".join(f"<script>{code}</script>" for code in codes) + "</body>")


def answer(out: str) -> Any:
    """What a probe left in the page."""
    return json.loads(html.unescape(out.split('id="probe">')[1].split("</pre>")[0]))


AXE = importlib.util.find_spec("axe_core_python")
FITS = """window.addEventListener("load", async () => {
  const inside = (e) => { for (let p = e.parentElement; p; p = p.parentElement) if (["auto", "scroll", "hidden"].includes(getComputedStyle(p).overflowX) && p !== document.documentElement) return true; return false; };
  const name = (e) => e.tagName.toLowerCase() + "." + e.className + ": " + e.textContent.slice(0, 40);
  const shown = [...document.body.querySelectorAll("*")].filter((e) => e.getClientRects().length && !e.closest("svg"));
  const beyond = shown.filter((e) => e.getBoundingClientRect().right > innerWidth + 1 && !inside(e)).map(name);
  const spilt = shown.filter((e) => e.scrollWidth > e.clientWidth + 2 && e.clientWidth && getComputedStyle(e).overflowX === "visible" && getComputedStyle(e).display !== "inline").map(name);
  const answer = document.querySelector(".answer .scroll");
  if (answer && answer.scrollWidth > answer.clientWidth + 1) spilt.push("the answer is cut");
  const ran = window.axe ? await axe.run(document, { resultTypes: ["violations"] }) : { violations: [] };
  const broken = ran.violations.map((v) => `${v.id}: ${v.nodes.map((n) => n.target.join(" ")).slice(0, 4)}`);
  parent.postMessage({ width: innerWidth, page: document.documentElement.scrollWidth, height: document.documentElement.scrollHeight, beyond, spilt, broken, axe: !!window.axe }, "*");
});"""


WIDTHS = (390, 768, 1400)


def fits(page: Path, folder: Path) -> list[dict[str, Any]]:
    """How a page lies in windows of three widths. Headless Chromium has none under 500 px, so the page is in frames, in a window
    that shows next to nothing of them: what lies in them is the same, and it need not be painted."""
    codes = [FITS]
    if AXE is not None and AXE.submodule_search_locations:
        codes.insert(0, (Path(AXE.submodule_search_locations[0]) / "axe.min.js").read_text())
    (folder / "inner.html").write_text(with_scripts(page.read_text(), *codes))
    frames = "".join(f'<iframe src="inner.html" style="width:{w}px;height:844px;border:0"></iframe>' for w in WIDTHS)
    frame = folder / "frame.html"
    frame.write_text(
        f"<!doctype html>{frames}<script>const all = []; "
        'addEventListener("message", (e) => { all.push(e.data); if (all.length < 3) return; '
        'const p = document.createElement("pre"); p.id = "probe"; '
        "p.textContent = JSON.stringify(all); document.body.appendChild(p); });</script>"
    )
    out, console, _ = browse(frame, folder, "--dump-dom", "--virtual-time-budget=10000", size="400,300")
    assert console == ""
    return sorted(answer(out), key=lambda found: found["width"])


def check_page(page: Path, folder: Path) -> None:
    """Asserts that a page fits its window at three widths, and that axe finds nothing."""
    found = fits(page, folder)
    assert [one["width"] for one in found] == list(WIDTHS)
    for one in found:
        assert one["page"] <= one["width"], one
        assert one["beyond"] == [] and one["spilt"] == [] and one["broken"] == [], one["width"]
    if not found[0]["axe"]:
        pytest.skip("fits; not seen by axe: pip install axe-core-python")
