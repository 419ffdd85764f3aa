"""Whose files are whose; a set of files is replaced as one, whatever fails on the way."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path
from typing import Any

import pytest
from faults import KINDS, failing, quick_disk, tree

from massprops.core.outputs import Outputs, claim, deliver, locked, verify
from massprops.errors import InputError

OLD = {"a.json": "old a", "b/c.ply": "old c", "gone.txt": "old"}
NEW = {"a.json": "new a", "b/c.ply": "new c", "d.html": "new d"}


def write(folder: Path, by: str, contents: dict[str, str], key: str, **options: object) -> None:
    with claim(folder, by, contents, **options) as outputs:  # type: ignore[arg-type]
        new = outputs.staging()
        for name, text in contents.items():
            (new / name).parent.mkdir(exist_ok=True)
            (new / name).write_text(text)
        outputs.publish(by, key)


def shown(folder: Path) -> dict[str, str]:
    return {n: b.decode() for n, b in tree(folder).items() if not n.startswith(".massprops")}


def test_a_set_takes_the_place_of_the_set_before_and_that_one_is_kept(tmp_path: Path) -> None:
    write(tmp_path, "one", OLD, "k1")
    (tmp_path / "b" / "mine").write_text("mine")
    write(tmp_path, "one", NEW, "k2")
    assert shown(tmp_path) == {**NEW, "b/mine": "mine"}
    kept = tmp_path / ".massprops" / "previous" / "one"
    assert {n: (kept / n).read_text() for n in OLD} == OLD
    assert Outputs(tmp_path).complete("one", "k2") and not Outputs(tmp_path).complete("one", "k1")


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_anywhere_leaves_one_set_and_the_same_command_makes_the_new_one(tmp_path: Path, kind: str) -> None:
    with quick_disk(tmp_path) as place:
        sweep(place, kind)


def sweep(tmp_path: Path, kind: str) -> None:
    with failing() as disk:
        write(tmp_path / "whole", "one", OLD, "k1")
        first = disk.count
        write(tmp_path / "whole", "one", NEW, "k2")
    assert 10 < first < disk.count < 60
    for n in range(1, disk.count - first + 1):
        folder = tmp_path / f"{n}"
        write(folder, "one", OLD, "k1")
        with failing(n, kind):
            try:
                write(folder, "one", NEW, "k2")
            except (OSError, InputError) as error:
                assert "No space" in str(error) or "Input/output" in str(error)
        try:
            verify(folder, *OLD, *NEW)
        except InputError as error:
            assert "give it again" in str(error)
        else:
            assert shown(folder) in (OLD, NEW), n
        write(folder, "one", NEW, "k2")
        assert tree(folder) == tree(tmp_path / "whole"), n


def test_what_others_wrote_is_refused_and_with_force_set_aside(tmp_path: Path) -> None:
    write(tmp_path, "one", OLD, "k1")
    (tmp_path / "d.html").write_text("mine")
    with pytest.raises(InputError, match=r"d\.html: was not written by massprops.*--force"):
        write(tmp_path, "one", NEW, "k2")
    with pytest.raises(InputError, match="written by 'massprops one'"):
        deliver(tmp_path, "two", {"a.json": "x"})
    assert shown(tmp_path) == {**OLD, "d.html": "mine"}
    deliver(tmp_path, "two", {"d.html": "x"}, force=True)
    assert (tmp_path / "d.html").read_text() == "x"
    assert (tmp_path / ".massprops/previous/found/d.html").read_text() == "mine"


def test_an_input_is_not_written_over_even_with_force(tmp_path: Path) -> None:
    source = tmp_path / "b" / "c.ply"
    source.parent.mkdir()
    source.write_text("mine")
    (tmp_path / "link").hardlink_to(source)
    for given in (source, source.parent, tmp_path / "link"):
        with pytest.raises(InputError, match="the input"), claim(tmp_path, "one", ["b/c.ply"], [given], force=True):
            pass
    with pytest.raises(InputError, match="holds, the input"), claim(tmp_path, "one", ["b/"], [source], force=True):
        pass
    assert source.read_text() == "mine" and not (tmp_path / ".massprops").exists()


def test_only_regular_files_are_written_and_no_link_is_followed(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "x").write_text("mine")
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "x").symlink_to(outside / "x")
    os.mkfifo(folder / "pipe")
    (folder / "sub").symlink_to(outside)
    for name in ("x", "pipe", "sub/x", "sub/"):
        with pytest.raises(InputError, match="link|pipe|not a folder"), claim(folder, "one", [name], force=True):
            pass
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / ".massprops").symlink_to(outside)
    with pytest.raises(InputError, match="is a link"):
        deliver(tmp_path / "other", "one", {"a": "x"})
    assert [p.name for p in outside.iterdir()] == ["x"] and (outside / "x").read_text() == "mine"
    assert stat.S_ISFIFO((folder / "pipe").lstat().st_mode)


def test_a_name_that_no_disk_takes_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="over 255 bytes"), claim(tmp_path / "out", "c", [f"a/{'ä' * 130}"]):
        pass
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["../x", "a/../../x", "/x", "", ".massprops/x", ".massprops/../../x"])
def test_no_name_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="leads outside this folder"), claim(tmp_path / "out", "c", [name]):
        pass
    assert not (tmp_path / "out").exists()


def test_what_was_changed_cut_or_removed_is_not_read(tmp_path: Path) -> None:
    write(tmp_path, "one", OLD, "k1")
    verify(tmp_path, "a.json", "b/", "unknown")
    (tmp_path / "b/c.ply").write_text("old")
    with pytest.raises(InputError, match=r"c\.ply: is not what 'massprops one' wrote"):
        verify(tmp_path, "b/")
    (tmp_path / "a.json").unlink()
    with pytest.raises(InputError, match=r"a\.json: .*give that command again"):
        verify(tmp_path, "a.json")


def test_what_is_derived_goes_with_what_it_was_derived_from(tmp_path: Path) -> None:
    write(tmp_path, "mass", {"mesh.ply": "1"}, "k1")
    deliver(tmp_path, "compare", {"compare.json": "of 1"}, derived=True)
    write(tmp_path, "mass", {"mesh.ply": "1"}, "k1")
    assert (tmp_path / "compare.json").exists()
    write(tmp_path, "mass", {"mesh.ply": "2"}, "k2")
    assert not (tmp_path / "compare.json").exists()
    assert (tmp_path / ".massprops/previous/compare/compare.json").read_text() == "of 1"


@pytest.mark.parametrize(
    "content",
    [
        "{",
        "[]",
        json.dumps({"format": "massprops-outputs/1", "files": {"../x": {}}, "trees": {}, "folders": {}}),
        json.dumps(
            {
                "format": "massprops-outputs/1",
                "files": {"a": {"by": "../..", "key": "", "sha256": ""}},
                "trees": {},
                "folders": {},
            }
        ),
    ],
)
def test_a_damaged_or_hostile_record_leads_nowhere(tmp_path: Path, content: str) -> None:
    (tmp_path / ".massprops").mkdir()
    (tmp_path / ".massprops" / "outputs.json").write_text(content)
    with pytest.raises(InputError, match="choose another place"):
        Outputs(tmp_path)


def test_nothing_is_left_where_nothing_was_written(tmp_path: Path) -> None:
    with pytest.raises(KeyError), claim(tmp_path / "new" / "folder", "one", ["a"]) as outputs:
        (outputs.staging() / "a").write_text("half")
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_a_second_command_is_told_who_holds_the_folder(tmp_path: Path) -> None:
    with (
        locked(tmp_path),
        pytest.raises(InputError, match=rf"at work in this folder \(process {os.getpid()}\)"),
        locked(tmp_path),
    ):
        pass
    with locked(tmp_path):
        pass


def test_names_that_are_no_text_are_told_by_their_bytes(tmp_path: Path) -> None:
    import yaml

    from massprops.core.inputs import hash_input

    (tmp_path / os.fsdecode(b"caf\xe9.png")).write_text("x")
    found = hash_input(tmp_path)
    assert list(found) == [r"caf\xe9.png"]
    assert yaml.safe_load(yaml.safe_dump(found).encode()) == found


def victim(tmp_path: Path) -> Path:
    """A folder of the user's, outside of what is written."""
    outside = tmp_path / "outside"
    (outside / "one").mkdir(parents=True)
    (outside / "one" / "x").write_text("mine")
    return outside


@pytest.mark.parametrize("link", ["previous", "new", "previous/one"])
def test_links_beside_the_record_lead_nowhere(tmp_path: Path, link: str) -> None:
    """A folder that somebody else hands over, with links where old results are kept and cleared away."""
    outside, out = victim(tmp_path), tmp_path / "out"
    write(out, "one", OLD, "k1")
    (out / ".massprops" / link).parent.mkdir(exist_ok=True)
    (out / ".massprops" / link).symlink_to(outside)
    with pytest.raises(InputError, match="is a link, and no link is followed"):
        write(out, "one", NEW, "k2")
    assert {p.name: p.read_text() for p in outside.rglob("*") if p.is_file()} == {"x": "mine"}


@pytest.mark.parametrize("what", ["files", "gone", "aside", "trees", "folders"])
def test_a_record_does_not_lead_through_links_of_its_folder(tmp_path: Path, what: str) -> None:
    outside, out = victim(tmp_path), tmp_path / "out"
    (out / ".massprops" / "new" / "sub").mkdir(parents=True)
    (out / ".massprops" / "new" / "sub" / "x").write_text("theirs")
    (out / "sub").symlink_to(outside)
    entry = {"by": "one", "key": "", "sha256": "0"}
    record: dict[str, Any] = {"format": "massprops-outputs/1", "files": {}, "trees": {}, "folders": {}}
    if what in record:
        record[what] = {"sub/one": "one" if what == "folders" else entry}
    else:
        record["pending"] = {"files": {}, "gone": [], "aside": {}}
        record["pending"][what] = ["sub/one/x"] if what == "gone" else {"sub/one/x": "one"}
        record["files"] = {"sub/one/x": entry} if what == "gone" else {}
    if what == "files":
        record |= {"files": {}, "pending": {"files": {"sub/x": entry}, "gone": [], "aside": {}}}
    (out / ".massprops" / "outputs.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match="no link is followed"):
        {"trees": Outputs.start_over, "folders": Outputs.forget}.get(what, Outputs.recover)(Outputs(out))
    assert {p.name: p.read_text() for p in outside.rglob("*") if p.is_file()} == {"x": "mine"}
