"""The page: whole and in part, safe, small, and asking for nothing from outside."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from fake_run import HOSTILE, add_crosscheck, add_everything, make_run, spacecraft

from massprops.geometry.vectors import sphere
from massprops.report import write_report
from massprops.report.data import read_run
from massprops.report.html import between, number, text
from massprops.report.meshes import Shape, decimated, read_shape
from massprops.report.page import UNREADABLE, all_sections, page
from massprops.report.scene import Frame, Scene, read_scene
from massprops.report.sections.cameras import coverage, mollweide
from massprops.report.sections.numbers import bar
from massprops.report.viewer import viewer


class Page(HTMLParser):
    """Tags, addresses, sections and the visible words of a page."""

    VOID = frozenset({"meta", "link", "img", "input", "br", "line", "circle", "rect"})

    def __init__(self, source: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.tags: list[tuple[str, dict]] = []
        self.sections: list[str] = []
        self.open: list[str] = []
        self.words = ""
        self.feed(source)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        found = dict(attrs)
        self.tags.append((tag, found))
        self.addresses += [found[k] for k in ("src", "href", "xlink:href", "data", "action") if k in found]
        if tag == "section":
            self.sections.append(found.get("id", ""))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-1:]}"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if self.open[-1:] not in (["script"], ["style"]):
            self.words += data


def parsed(run: Path) -> Page:
    return Page(write_report(run).read_text())


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = make_run(tmp_path_factory.mktemp("runs") / "probe")
    add_crosscheck(folder)
    return folder


def test_a_whole_run_has_every_section_and_its_numbers(run: Path) -> None:
    found = parsed(run)
    assert found.open == []
    assert found.sections == ["summary", "numbers", "frames", "cameras", "crosscheck", "stages"]
    document = json.loads((run / "massprops.json").read_text())
    for said in (
        number(document["volume"]),
        number(document["principal_moments"][2]),
        number(document["inertia"][0][0], 6),
    ):
        assert said in found.words
    assert between(document["interval_90"]["volume"]) in found.words
    assert "stereo baseline" in found.words and "0.40 %" in found.words
    assert document["warnings"][0] in found.words
    assert "smoother" in found.words and "consistent" in found.words
    assert "0.410 px" in found.words and "123 456" in found.words
    assert UNREADABLE not in found.words
    assert sum(tag == "figure" for tag, _ in found.tags) == 12


def test_a_page_made_again_does_not_tell_of_the_one_before(run: Path) -> None:
    first = write_report(run).read_text()
    manifest = yaml.safe_load((run / "run.yaml").read_text())
    manifest["stages"]["report"] = {"status": "failed", "warnings": ["the disk was full"]}
    (run / "run.yaml").write_text(yaml.safe_dump(manifest))
    assert write_report(run).read_text() == first


def test_nothing_is_asked_from_outside(run: Path) -> None:
    source = write_report(run).read_text()
    found = Page(source)
    assert found.addresses and all(a.startswith(("data:", "#")) for a in found.addresses)
    assert not re.search(r"https?:|//cdn|@import|url\((?!#)", source)
    policy = next(a["content"] for t, a in found.tags if t == "meta" and "content" in a and "default" in a["content"])
    assert policy.startswith("default-src 'none'")


def test_what_comes_from_outside_is_escaped(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", hostile=True)
    add_crosscheck(run, name=HOSTILE)
    source = write_report(run).read_text()
    assert "<script>window.hit" not in source and "onerror='window" not in source
    found = Page(source)
    assert found.words.count("<script>window.hit=1</script>") >= 4  # warning, reason, input, estimator: as words
    assert all("onerror" not in attributes for _, attributes in found.tags)


def test_model_units_claim_ratios_only(tmp_path: Path) -> None:
    words = parsed(make_run(tmp_path / "run", metric=False)).words
    assert "No length was given" in words and "Only ratios are meaningful" in words
    assert "kg m²" not in words and "Mass density" not in words and "smallest principal moment" not in words


def test_a_stopped_run_gets_a_page_with_the_reason(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run")
    reason = "the body does not turn: film it from more sides"
    (run / "report.json").write_text(json.dumps({"exit_code": 3, "reason": reason, "stage": "sfm"}))
    for name in ("massprops.json", "mesh.ply", "work/dense/dense.json", "work/surface/surface.json"):
        (run / name).unlink()
    found = parsed(run)
    assert reason in found.words and "sfm" in found.words and "Done in part" in found.words
    assert "numbers" not in found.sections and "frames" in found.sections and "cameras" in found.sections
    assert UNREADABLE not in found.words
    (run / "work" / "sfm" / "views.npz").write_bytes(b"cut short")
    assert "cameras" not in parsed(run).sections


def test_an_empty_folder_and_broken_files(tmp_path: Path) -> None:
    assert "no results" in parsed(tmp_path).words
    run = make_run(tmp_path / "run")
    (run / "massprops.json").write_text("{")
    (run / "run.yaml").write_text("a: [")
    (run / "mesh.ply").write_bytes(b"ply\nno mesh")
    (run / "work" / "silhouettes" / "masks" / "cam0" / "000003.png.png").write_bytes(b"")
    (run / "work" / "capture" / "frames" / "cam0" / "000002.png").unlink()
    found = parsed(run)
    assert sum(tag == "figure" for tag, _ in found.tags) == 11


def test_one_section_that_fails_leaves_the_others(run: Path, tmp_path: Path) -> None:
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    document = json.loads((copy / "massprops.json").read_text())
    del document["inertia"], document["recommended"]
    (copy / "massprops.json").write_text(json.dumps(document))
    found = parsed(copy)
    assert found.words.count(UNREADABLE) == 1 and "frames" in found.sections and "summary" in found.sections


def test_sections_are_found_by_name() -> None:
    modules = all_sections()
    assert [m.ORDER for m in modules] == sorted({m.ORDER for m in modules})
    assert all(isinstance(m.TITLE, str) and callable(m.render) for m in modules)


def test_many_large_frames_and_faces_stay_small(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", count=40)
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (960, 1280, 3), dtype=np.uint8)
    encoded = cv2.imencode(".png", noise)[1].tobytes()
    for file in (run / "work" / "capture" / "frames" / "cam0").iterdir():
        file.write_bytes(encoded)
    from massprops.run.stages.publish import mesh_ply

    mesh = spacecraft().subdivide().subdivide().subdivide()
    flags = np.ones(len(mesh.faces), np.uint8)
    assert len(mesh.faces) > 100_000
    (run / "mesh.ply").write_bytes(mesh_ply(np.asarray(mesh.vertices), np.asarray(mesh.faces), flags, None))
    assert write_report(run).stat().st_size < 6_000_000


def test_lightened_mesh_keeps_shape_flags_and_distances() -> None:
    mesh = spacecraft().subdivide().subdivide()
    v, f = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    light = decimated(Shape(v, f, mesh.triangles_center[:, 0] > 0, v[:, 2]), most=6000)
    assert len(light.faces) <= 6000
    middle = light.vertices[light.faces].mean(1)
    assert (light.observed == (middle[:, 0] > 0)).mean() > 0.98
    assert light.distance is not None and np.abs(light.distance - light.vertices[:, 2]).max() < 0.1
    import trimesh

    assert trimesh.Trimesh(light.vertices, light.faces).volume == pytest.approx(mesh.volume, rel=0.01)


def test_measured_faces_come_from_the_mesh_file(run: Path) -> None:
    shape = read_shape(run, 1.0)
    assert shape is not None
    assert np.array_equal(shape.observed, shape.vertices[shape.faces].mean(1)[:, 2] > -0.6)


def test_viewer_data_unpacks_to_the_mesh() -> None:
    mesh = spacecraft()
    v, f = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    observed = np.arange(len(f)) % 3 > 0
    axes = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    scene = Scene(frusta=np.array([[[0, 0, 9.0], [1, 1, 8], [1, -1, 8], [-1, -1, 8], [-1, 1, 8]]]))
    source = viewer(Shape(v, f, observed), centre=np.array([0.1, 0.2, 0.3]), axes=axes, scene=scene)
    data = json.loads(re.search(r'application/json">(.*)</script>', source).group(1))  # type: ignore[union-attr]
    middle, size = 0.5 * (v.min(0) + v.max(0)), np.linalg.norm(v - 0.5 * (v.min(0) + v.max(0)), axis=1).max()

    def unpack(name: str, kind: str) -> np.ndarray:
        return np.frombuffer(base64.b64decode(data[name]), kind)

    assert np.allclose(unpack("vertices", "<i2").reshape(-1, 3) / 32767 * size + middle, v, atol=1e-4)
    assert np.array_equal(unpack("faces", "<u2").reshape(-1, 3), f)
    assert np.array_equal(np.unpackbits(unpack("filled", "u1"), bitorder="little")[: len(f)] == 0, observed)
    assert np.allclose(data["axes"], axes.T)
    assert np.allclose(np.array(data["centre"]) * size + middle, [0.1, 0.2, 0.3], atol=1e-4)
    assert data["reach"] > np.linalg.norm(data["frusta"][0][0])


def test_what_stood_still_is_not_said_to_move(run: Path) -> None:
    mesh = spacecraft()
    shape = Shape(np.asarray(mesh.vertices), np.asarray(mesh.faces), np.ones(len(mesh.faces), bool))
    film = tuple(Frame("data:,", f"{i} s", np.eye(3)) for i in range(2))
    assert "play the motion" in viewer(shape, scene=Scene(film=film))
    still = viewer(shape, scene=Scene(film=film, still=True))
    assert "go round the object" in still and "play the motion" not in still
    data = read_run(run)
    facts = {**data.facts, "footage": {**data.facts["footage"], "motion": "static"}}
    assert read_scene(replace(data, facts=facts)).still and not read_scene(data).still


def test_coverage_of_caps() -> None:
    cap = (1 - np.cos(np.radians(35))) / 2
    assert coverage(np.array([[0, 0, 1.0]])) == pytest.approx(cap, abs=2e-3)
    assert coverage(np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, 1.0]])) == pytest.approx(2 * cap, abs=2e-3)
    assert coverage(sphere(200)) == 1.0


def test_map_has_equal_areas_and_comes_back() -> None:
    from massprops.report.sections.cameras import _from_mollweide

    rng = np.random.default_rng(1)
    unit = rng.normal(size=(4000, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    place = mollweide(unit)
    assert np.allclose(_from_mollweide(place[:, 0], place[:, 1]), unit, atol=1e-6)
    assert ((place[:, 0] / 2) ** 2 + place[:, 1] ** 2).max() <= 1 + 1e-9
    inner = ((place[:, 0] / 2) ** 2 + place[:, 1] ** 2 < 0.5).mean()
    assert inner == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(
    ("value", "digits", "said"),
    [
        (3.92719, 4, "3.927"), (-0.018522, 3, "−0.0185"), (0, 5, "0"), (123456.7, 4, "123457"), (2.5e-9, 3, "2.50×10⁻⁹"),
        (-7.1e12, 2, "−7.1×10¹²"), (float("nan"), 3, "–"), (None, 3, "–"), (1000.4, 4, "1000"), (0.00012345, 3, "0.000123"),
    ],
)  # fmt: skip
def test_numbers_for_people(value: float, digits: int, said: str) -> None:
    assert number(value, digits) == said


def test_interval_bar_says_its_ends() -> None:
    assert "−3.0 / +2.0 %" in bar(2.0, [1.94, 2.04])
    assert "−3.0 / +2.0 %" in bar(-2.0, [-2.04, -1.94]).replace("+2.0 / −3.0", "−3.0 / +2.0")
    assert bar(2.0, None) == "" and text("<") == "&lt;"


def test_page_is_pure_text_of_its_data(run: Path) -> None:
    from massprops.report.data import read_run

    assert page(read_run(run)) == page(read_run(run))


def test_a_page_runs_its_own_script_and_no_other(tmp_path: Path) -> None:
    """By the hash of the script in the page's policy: one that slipped in through a name would not run."""
    import hashlib

    source = write_report(make_run(tmp_path / "<img src=x onerror=alert(1)>.mp4", hostile=True)).read_text()
    assert "<img src=x" not in source and "&lt;img src=x onerror=alert(1)&gt;.mp4" in source
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', source)
    assert policy is not None
    rules = dict(rule.split(maxsplit=1) for rule in policy[1].split("; "))
    scripts = re.findall(r"<script>(.*?)</script>", source, re.DOTALL)
    digests = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts]
    assert len(digests) == 1 and rules["script-src"] == f"'sha256-{digests[0]}'"
    assert rules["default-src"] == "'none'" and rules["base-uri"] == rules["form-action"] == "'none'"


def test_images_left_out_cameras_and_lens_are_said(tmp_path: Path) -> None:
    run = make_run(tmp_path)
    capture, sfm = run / "work" / "capture" / "footage.json", run / "work" / "sfm" / "sfm.json"
    footage, solved = json.loads(capture.read_text()), json.loads(sfm.read_text())
    footage["left_out"] = [{"source_name": "<b>\udcff.heic", "reason": "not an image that can be read"}]
    solved["lens"] = "camera 0: k1 (held-out error in px: no distortion 0.310, k1 0.290)"
    solved["cameras"] = [
        {"id": i, "device": "phone", "images": 9 - i, "given": 9, "focal_px": [1000.0 + i, 1000.0 + i],
         "focal_sigma_relative": 0.001, "focal_prior_px": 990.0, "focal_source": "exif"}
        for i in (0, 1)
    ]  # fmt: skip
    capture.write_text(json.dumps(footage))
    sfm.write_text(json.dumps(solved))
    words = Page(write_report(run).read_text()).words
    assert "Left out: <b>\\udcff.heic (not an image that can be read)" in words
    assert "8 of 9 images placed, 1001.0 px ± 0.1 % (EXIF says 990.0)" in words and "k1 0.290" in words


def test_everything_a_run_may_have_stands_on_its_page(tmp_path: Path) -> None:
    found = parsed(add_everything(make_run(tmp_path / "run", count=10)))
    assert UNREADABLE not in found.words and "residuals" in found.sections and "comparison" in found.sections
    for said in (
        "density assumed: 1000 kg/m³ (water)", "Confidence medium", "Shape against motion: consistent", "Difference from CAD:",
        "mesh and motion together", "recommended", "Points in common", "Mean residual over the sensor",
    ):  # fmt: skip
        assert said in found.words, said
    # given 0.3 px to each coordinate of each observation
    shown = re.search(r"the median is ([0-9.]+) px", found.words)
    assert shown is not None and float(shown.group(1)) == pytest.approx(0.3 * 2**0.5, abs=0.05)
