"""No command takes anything of the user's: each way in which one once did."""

from __future__ import annotations

import json
import os
import stat
import sys
from pathlib import Path

import pytest
import trimesh
from whole import assert_one_line, massprops

sys.path.insert(0, str(Path(__file__).parents[1] / "core"))
from faults import KINDS, failing, quick_disk, tree  # noqa: E402

Capture = pytest.CaptureFixture[str]


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture
def part(tmp_path: Path) -> Path:
    folder = tmp_path / "part"
    folder.mkdir()
    trimesh.creation.box((1.0, 2.0, 3.0)).export(folder / "mesh.ply")
    trimesh.creation.box((1.0, 2.0, 3.0)).export(folder / "part.stl")
    return folder


@pytest.fixture
def seq(tmp_path: Path, capfd: Capture) -> Path:
    said = massprops(capfd, "simulate", "tracks", "-o", tmp_path / "seq", "--features", 6, "-q", "--frames", 12)
    assert said.code == 0, said
    return tmp_path / "seq"


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_mass_beside_its_own_mesh(part: Path, capfd: Capture, force: tuple[str, ...]) -> None:
    before = bytes_of(part)
    said = massprops(capfd, "mass", part / "mesh.ply", "-o", part, "--scale", 0.001, *force)
    assert_one_line(said, 2, "mesh.ply", "the input", "-o")
    assert bytes_of(part) == before


def test_mass_over_the_run_of_another_command(part: Path, tmp_path: Path, capfd: Capture) -> None:
    from massprops.core.outputs import deliver

    run = tmp_path / "run"
    deliver(run, "reconstruct", {"mesh.ply": "a", "massprops.json": "{}", "cloud.ply": "c"}, key="k")
    before = bytes_of(run)
    said = massprops(capfd, "mass", part / "part.stl", "-o", run)
    assert_one_line(said, 2, "mesh.ply", "'massprops reconstruct'", "--force")
    assert {n: b for n, b in bytes_of(run).items() if "lock" not in n} == {
        n: b for n, b in before.items() if "lock" not in n
    }
    assert massprops(capfd, "mass", part / "part.stl", "-o", run, "--force").code == 0
    assert not (run / "cloud.ply").exists(), "of two bodies in one folder each would pass for the other"
    assert (run / ".massprops/previous/reconstruct/cloud.ply").read_text() == "c"


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_export_over_its_own_mesh(part: Path, capfd: Capture, force: tuple[str, ...]) -> None:
    before = bytes_of(part)
    for to in ("urdf", "csv"):
        said = massprops(capfd, "export", part / "part.stl", "--to", to, "-o", part / "part.stl", *force)
        assert_one_line(said, 2, "part.stl", "the input")
    assert bytes_of(part) == before


def test_export_beside_the_users_table(part: Path, capfd: Capture) -> None:
    table = part / "part.csv"
    table.write_text("my,own,table\n")
    said = massprops(capfd, "export", part / "part.stl", "--to", "csv")
    assert_one_line(said, 2, "part.csv", "--force")
    assert table.read_text() == "my,own,table\n"
    assert massprops(capfd, "export", part / "part.stl", "--to", "csv", "--force").code == 0
    written = table.read_bytes()
    assert massprops(capfd, "export", part / "part.stl", "--to", "csv").code == 0, "the same again changes nothing"
    assert table.read_bytes() == written != b"my,own,table\n"
    assert not (part / ".massprops").exists(), "the user's folder stays the user's"


def test_export_to_links_and_devices(part: Path, tmp_path: Path, capfd: Capture) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "mine")
    os.mkfifo(tmp_path / "pipe")
    for name in ("link", "pipe"):
        said = massprops(capfd, "export", part / "part.stl", "--to", "json", "-o", tmp_path / name, "--force")
        assert_one_line(said, 2, name, "regular file")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "pipe").is_fifo()
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make, and lose, a device")
@pytest.mark.parametrize("force", [(), ("--force",)])
def test_no_command_replaces_a_device(
    part: Path, seq: Path, tmp_path: Path, capfd: Capture, force: tuple[str, ...]
) -> None:
    """As root, `-o /dev/null` once took it from the whole machine."""
    device, box = tmp_path / "null", part / "part.stl"
    try:
        os.mknod(device, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("no devices can be made in this container")
    (tmp_path / "study.yaml").write_text("kind: drill\nruns: 2\n")
    for arguments in (
        ("export", box, "--to", "json"),
        ("mass", box),
        ("compare", box, box),
        ("estimate", seq, "-q"),
        ("diagnose", seq, "-q"),
        ("simulate", "tracks", "-q"),
        ("reconstruct", seq, "-q"),
        ("campaign", tmp_path / "study.yaml", "-q"),
    ):
        forced = force if arguments[0] in ("export", "mass", "compare", "reconstruct") else ()
        assert_one_line(massprops(capfd, *arguments, "-o", device, *forced), 2, "null: is a ")
        assert stat.S_ISCHR(device.lstat().st_mode), arguments


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_a_campaign_into_the_folder_of_its_configuration(
    tmp_path: Path, capfd: Capture, force: tuple[str, ...]
) -> None:
    configuration = tmp_path / "campaign.yaml"
    configuration.write_text("kind: drill  # mine\nruns: 2\n")
    said = massprops(capfd, "campaign", configuration, "-o", tmp_path, "-q", *force)
    assert_one_line(said, 2, "campaign.yaml", "the input")
    assert [p.name for p in tmp_path.iterdir()] == ["campaign.yaml"]
    assert configuration.read_text() == "kind: drill  # mine\nruns: 2\n"


def test_a_diagnosis_into_the_folder_of_a_run(seq: Path, tmp_path: Path, capfd: Capture) -> None:
    from massprops.core.outputs import deliver

    deliver(tmp_path / "run", "reconstruct", {"mesh.ply": "a"}, key="k")
    deliver(tmp_path / "run", "report", {"report.html": "the run's"}, derived=True)
    before = bytes_of(tmp_path / "run")
    said = massprops(capfd, "diagnose", seq, "-o", tmp_path / "run", "-q")
    assert_one_line(said, 2, "report.html", "written by 'massprops report'", "another place")
    assert bytes_of(tmp_path / "run") == before


@pytest.mark.parametrize("name", ["model.yaml", "report.html"])
def test_a_diagnosis_into_a_folder_that_has_such_a_file(seq: Path, tmp_path: Path, capfd: Capture, name: str) -> None:
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / name).write_text("mine")
    said = massprops(capfd, "diagnose", seq, "-o", tmp_path / "d", "-q")
    assert_one_line(said, 2, name, "not written by massprops", "--force")
    assert [p.read_text() for p in (tmp_path / "d").iterdir()] == ["mine"]


def test_an_estimate_does_not_believe_a_document_it_finds(seq: Path, tmp_path: Path, capfd: Capture) -> None:
    folder = tmp_path / "e"
    folder.mkdir()
    (folder / "thesis.csv").write_text("mine")
    (folder / "estimates.json").write_text(json.dumps({"estimators": [{"history": "thesis.csv"}]}))
    before = bytes_of(folder)
    said = massprops(capfd, "estimate", seq, "-o", folder, "--method", "smoother", "-q")
    assert_one_line(said, 2, "estimates.json", "--force")
    assert bytes_of(folder) == before


def test_a_simulation_over_another_sequence(tmp_path: Path, capfd: Capture) -> None:
    other = tmp_path / "flight"
    (other / "truth").mkdir(parents=True)
    (other / "truth" / "truth.yaml").write_text("mine: true\n")
    (other / "cam0").mkdir()
    (other / "cam0" / "a.png").write_text("mine")
    before = bytes_of(other)
    said = massprops(capfd, "simulate", "tracks", "-o", other, "-q")
    assert_one_line(said, 2, "flight", "no simulation")
    assert bytes_of(other) == before


def test_a_killed_simulation_does_not_block_its_folder(tmp_path: Path, capfd: Capture) -> None:
    (tmp_path / "seq/.massprops/new/truth").mkdir(parents=True)
    (tmp_path / "seq/.massprops/new/truth/half").write_text("x")
    asked = ("simulate", "tracks", "--features", 6, "--frames", 12, "-q", "-o")
    assert massprops(capfd, *asked, tmp_path / "seq").code == 0


def test_a_simulation_that_ends_at_any_change_of_the_disk_is_made_by_the_same_command(
    tmp_path: Path, capfd: Capture
) -> None:
    asked = ("simulate", "tracks", "--features", 6, "--frames", 12, "-q", "-o")
    with quick_disk(tmp_path) as place:
        with failing() as disk:
            massprops(capfd, *asked, place / "whole")
        assert disk.count > 20
        whole = tree(place / "whole")
        for n in range(1, disk.count + 1, 3):
            out = place / f"out{n}"
            with failing(n, KINDS[n % len(KINDS)]):
                massprops(capfd, *asked, out)
            assert massprops(capfd, *asked, out).code == 0, n
            assert tree(out) == whole, n
    assert massprops(capfd, *asked, tmp_path / "one").code == 0
    assert massprops(capfd, *asked, tmp_path / "seq").code == 0, "an earlier simulation is replaced"
    assert (tmp_path / "seq/tracks0/data.csv").read_bytes() == (tmp_path / "one/tracks0/data.csv").read_bytes()
    assert not (tmp_path / "seq/.massprops/new").exists()


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A COLMAP project with silhouettes made by hand."""
    for name in ("images/a.png", "masks/a.png.png", "sparse/0/cameras.bin", "work/notes.txt", "sequence/cam0/a.png"):
        (tmp_path / "proj" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "proj" / name).write_text("mine")
    return tmp_path / "proj"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("images", "-o", ""), "not written by massprops"),
        (("images", "--masks", "masks", "-o", ""), "the input"),
        (("images", "--masks", "masks", "-o", "", "--force"), "the input"),
        (("sequence", "-o", ""), "the input"),
        (("sequence", "-o", "", "--force"), "the input"),
    ],
)
def test_a_run_into_a_project_of_the_user(project: Path, capfd: Capture, arguments: tuple[str, ...], says: str) -> None:
    before = bytes_of(project)
    given = [a if a.startswith("-") else project / a for a in arguments]
    assert_one_line(massprops(capfd, "reconstruct", *given, "-q"), 2, says)
    assert bytes_of(project) == before


def test_a_comparison_into_a_folder_that_has_one(part: Path, capfd: Capture) -> None:
    (part / "compare.json").write_text("mine")
    before = bytes_of(part)
    said = massprops(capfd, "compare", part / "part.stl", part / "mesh.ply", "-o", part)
    assert_one_line(said, 2, "compare.json", "not written by massprops")
    assert bytes_of(part) == before


def test_what_was_edited_is_not_exported(part: Path, tmp_path: Path, capfd: Capture) -> None:
    run = tmp_path / "run"
    assert massprops(capfd, "mass", part / "part.stl", "-o", run).code == 0
    document = json.loads((run / "massprops.json").read_text())
    (run / "massprops.json").write_text(json.dumps({**document, "mass": 1.0}))
    for command in (("export", run, "--to", "json"), ("compare", run, part / "part.stl"), ("crosscheck", run)):
        assert_one_line(massprops(capfd, *command), 2, "massprops.json", "give that command again")
    assert massprops(capfd, "mass", part / "part.stl", "-o", run).code == 0
    assert json.loads((run / "massprops.json").read_text()) == document
    assert massprops(capfd, "export", run, "--to", "json").code == 0


def test_names_that_are_not_text_and_words_that_a_terminal_obeys(part: Path, tmp_path: Path, capfd: Capture) -> None:
    odd = tmp_path / os.fsdecode(b"caf\xe9.stl")
    (part / "part.stl").rename(odd)
    said = massprops(capfd, "mass", odd, "-o", tmp_path / "run")
    assert_one_line(said, 2, "not UTF-8", r"caf\xe9.stl")
    said = massprops(capfd, "mass", tmp_path / "a\x1b]0;owned\x07.stl", "-o", tmp_path / "run")
    assert_one_line(said, 2, r"\x1b]0;owned\x07")
    assert "\x1b" not in said.err and not (tmp_path / "run").exists()
