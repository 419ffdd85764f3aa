"""The page in a real browser: no error on the console, nothing fetched, the mesh drawn, the buttons at work."""

from __future__ import annotations

import base64
import hashlib
import html
import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from fake_run import add_crosscheck, add_everything, make_run

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
        out, err = child.communicate(timeout=180)
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
def everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(add_everything(make_run(tmp_path_factory.mktemp("browser") / "whole", count=10)))


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


def with_scripts(page: str, *codes: str) -> str:
    """The page with scripts of the test, which its policy lets run by their hashes."""
    hashes = ["'sha256-" + base64.b64encode(hashlib.sha256(code.encode()).digest()).decode() + "'" for code in codes]
    assert "script-src 'sha256" in page
    page = page.replace("script-src ", f"script-src {' '.join(hashes)} ", 1)
    return page.replace("</body>", "".join(f"<script>{code}</script>" for code in codes) + "</body>")


def answer(out: str) -> Any:
    """What a probe left in the page."""
    return json.loads(html.unescape(out.split('id="probe">')[1].split("</pre>")[0]))


LOOK = """const host = document.querySelector(".viewer"), canvas = host.querySelector("canvas"), out = {};
  const look = () => { const gl = canvas.getContext("webgl"), d = new Uint8Array(canvas.width * canvas.height * 4);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, d);
    let drawn = 0, red = 0, blue = 0, sum = 0, across = 0;
    for (let i = 0; i < d.length; i += 4) if (d[i + 3]) { drawn++; across += (i / 4) % canvas.width; sum = (sum * 31 + d[i] + i) % 1000003;
      if (d[i] > 110 && d[i] > 2.2 * d[i + 1] && d[i] > 2.2 * d[i + 2]) red++; if (d[i + 2] > 1.6 * d[i]) blue++; }
    return { drawn, red, blue, sum, middle: across / drawn / canvas.width }; };
  const click = (what) => host.querySelector(what).click();
  const key = (name, shift) => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: name, shiftKey: !!shift }));"""


def probed(page: Path, folder: Path, steps: str) -> dict[str, Any]:
    """Runs steps on the first viewer of a page: each names in `out` what it saw."""
    code = (
        f'window.addEventListener("load", () => {{ {LOOK} {steps} '
        'const p = document.createElement("pre"); p.id = "probe"; p.textContent = JSON.stringify({ ...out, hit: window.hit || 0 });'
        " document.body.appendChild(p); });"
    )
    copy = folder / "probe.html"
    copy.write_text(with_scripts(page.read_text(), code))
    out, console, _ = browse(copy, folder, "--dump-dom", "--virtual-time-budget=6000")
    assert console == ""
    found: dict[str, Any] = answer(out)
    return found


def test_buttons_turn_the_mesh_and_hostile_names_stay_words(page: Path, tmp_path: Path) -> None:
    found = probed(
        page, tmp_path,
        """out.start = look(); click("[data-view=top]"); out.top = look(); key("ArrowLeft"); out.key = look();
        canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -600 })); out.near = look();
        click("[data-view=reset]"); out.back = look(); key("ArrowRight", true); out.moved = look();
        click("[data-view=reset]"); click("[data-show=cameras]"); out.path = look();""",
    )  # fmt: skip
    assert found["hit"] == 0
    assert found["start"]["drawn"] > 5000 and found["start"]["red"] > 300
    assert found["top"]["sum"] != found["start"]["sum"] != found["key"]["sum"] != found["top"]["sum"]
    assert found["near"]["drawn"] > 1.2 * found["key"]["drawn"]
    assert found["back"] == found["start"]
    assert found["moved"]["middle"] > found["start"]["middle"] + 0.01
    assert found["path"]["sum"] != found["start"]["sum"] and found["path"]["red"] < 0.6 * found["start"]["red"]


def test_colours_cloud_and_film(everything: Path, tmp_path: Path) -> None:
    found = probed(
        everything, tmp_path,
        """const keys = () => [...host.querySelectorAll("[data-keys]")].filter((p) => !p.hidden).map((p) => p.dataset.keys);
        out.modes = [...host.querySelectorAll("[data-mode]")].map((b) => b.dataset.mode); out.colour = look();
        for (const mode of ["measured", "deviation", "images"]) { click(`[data-mode=${mode}]`); out[mode] = look(); out[mode].keys = keys(); }
        out.pressed = host.querySelectorAll("[data-mode][aria-pressed=true]").length;
        click("[data-show=cloud]"); out.cloud = look(); click("[data-show=cloud]");
        const time = host.querySelector("input[type=range]"), film = host.querySelector(".film");
        out.hidden = film.hidden; time.value = 3; time.dispatchEvent(new Event("input")); out.third = look();
        out.film = [film.hidden, film.src.slice(0, 15), host.querySelector("output").textContent];
        time.value = 7; time.dispatchEvent(new Event("input")); out.seventh = look();""",
    )  # fmt: skip
    assert found["modes"] == ["colour", "measured", "deviation", "images"] and found["pressed"] == 1
    assert found["measured"]["red"] > found["colour"]["red"] + 300
    assert found["deviation"]["sum"] != found["measured"]["sum"] and found["images"]["blue"] > 300
    assert [found[m]["keys"] for m in ("measured", "deviation", "images")] == [["measured"], ["deviation"], ["images"]]
    assert 100 < found["cloud"]["drawn"] < found["images"]["drawn"]
    assert found["hidden"] is True and found["film"] == [False, "data:image/jpeg", "1.50 s"]
    assert found["third"]["sum"] != found["seventh"]["sum"]


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
    """How a page lies in windows of three widths. Headless Chromium has none under 500 px, so the page is in frames."""
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
    out, console, _ = browse(frame, folder, "--dump-dom", "--virtual-time-budget=60000", size="2600,900")
    assert console == ""
    return sorted(answer(out), key=lambda found: found["width"])


@pytest.mark.parametrize("kind", ["everything", "page"])
def test_a_page_fits_its_window_and_is_accessible(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    found = fits(request.getfixturevalue(kind), tmp_path)
    assert [one["width"] for one in found] == list(WIDTHS)
    for one in found:
        assert one["page"] <= one["width"], one
        assert one["beyond"] == [] and one["spilt"] == [] and one["broken"] == [], one["width"]
    if not found[0]["axe"]:
        pytest.skip("fits; not seen by axe: pip install axe-core-python")
