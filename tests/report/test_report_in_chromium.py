"""The page in a real browser: no error on the console, nothing fetched, the mesh drawn, the buttons at work."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from browser import answer, browse, check_page, needs_browser, with_scripts
from fake_run import HOSTILE, add_crosscheck, add_everything, make_run

import massprops
from massprops.campaigns.configuration import plan_of
from massprops.campaigns.run import run_campaign
from massprops.report import write_report
from massprops.report.runs import write_runs

pytestmark = needs_browser


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


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs compared, one with hostile names and no scale."""
    folder = tmp_path_factory.mktemp("runs")
    two = [make_run(folder / "one", count=3), make_run(folder / "two", metric=False, hostile=True, count=3)]
    write_report(two[0])
    return write_runs(folder, two)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign")
    run_campaign(
        plan_of({"kind": "drill", "name": HOSTILE, "runs": 12, "fails": 0.2, "grid": {"sigma": [1, 2]}}),
        folder,
        workers=1,
    )
    return folder / "report.html"


@pytest.fixture(scope="module")
def estimates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("estimates")
    seen = massprops.simulate("tracks", folder / "seq", frames=100, seed=8)
    massprops.estimate(seen.folder, folder / "out", method=["ekf", "momentum-ls"])
    return folder / "out" / "report.html"


@pytest.mark.parametrize("kind", ["everything", "page", "runs", "campaign", "estimates"])
def test_a_page_fits_its_window_and_is_accessible(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    check_page(request.getfixturevalue(kind), tmp_path)
