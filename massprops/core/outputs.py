"""Which files of a folder massprops wrote, from what each was made, and how a set of files is replaced at once.

A folder's record is `.massprops/outputs.json`: each file with the command that wrote it, the key of what it was made
from, and its hash. Only files in the record are replaced or removed; anything else needs `force`, and an input of the
command is not written over even then. What is replaced goes to `.massprops/previous/`.

A set of files is published in four steps, so that a command killed anywhere leaves the old set or the new one:

1. the new files are finished in `.massprops/new/`;
2. the record says what is about to be replaced, with the new hashes (`pending`);
3. the files are renamed into their places;
4. the record says that it is done.

The next command that writes finishes a pending change. A command that reads refuses a folder with a pending change, and
files that differ from the record.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TextIO

from massprops.core.files import (
    files_below,
    hash_file,
    hash_tree,
    json_text,
    make_folder,
    refuse_special,
    remove,
    remove_folder,
    rename,
    write_whole,
)
from massprops.core.processes import is_alive
from massprops.errors import InputError

OWN = ".massprops"
"""The folder of the record inside an output folder."""
FORMAT = "massprops-outputs/1"
LONGEST_NAME = 255
"""Bytes of a file's name, on the usual file systems."""
LARGEST_RECORD = 100_000_000
"""Bytes; some 400 000 files."""
ENDING_S = 20.0
"""How long children of a command that was killed may take to end; on a loaded machine they wait for a processor."""
BASES = ("reconstruct", "mass")
"""Commands whose files others are derived from: a comparison or an export is of one mesh, and goes when that goes."""


class Outputs:
    """The record of one folder.

    Attributes:
        folder: the output folder.
        files: relative name to `by` (command), `key`, `sha256` (None for a file that changes as it is used) and, for
            derived files, `of` (key of what they were made from).
        trees: relative folder name to `by`, `key`, `sha256`, for folders that only massprops uses.
        folders: relative name of such a folder's parent to the command that made it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.place = folder, folder / OWN
        content = _read(self.place / "outputs.json")
        self.files: dict[str, dict[str, Any]] = content["files"]
        self.trees: dict[str, dict[str, Any]] = content["trees"]
        self.folders: dict[str, str] = content["folders"]
        self.pending: dict[str, Any] | None = content["pending"]

    def save(self) -> None:
        """Writes the record."""
        content = {"format": FORMAT, "files": self.files, "trees": self.trees, "folders": self.folders}
        if self.pending is not None:
            content["pending"] = self.pending
        make_folder(self.place)
        write_whole(self.place / "outputs.json", json_text(content))

    # -- reading

    def intact(self, name: str) -> bool:
        """Whether a file or tree matches the record; what is not in the record counts as intact."""
        if self.pending is not None:
            return False
        path = self.folder / name
        if name in self.trees:
            return bool(hash_tree(path) == self.trees[name]["sha256"])
        entry = self.files.get(name)
        if entry is None or entry["sha256"] is None:
            return True
        try:
            return not path.is_symlink() and hash_file(path) == entry["sha256"]
        except OSError:
            return False

    def complete(self, by: str, key: str) -> bool:
        """Whether all files of a command are present and unchanged, with this key."""
        names = [name for name, entry in self.files.items() if entry["by"] == by and entry["sha256"] is not None]
        return bool(names) and all(self.files[n]["key"] == key and self.intact(n) for n in names)

    @property
    def base(self) -> str | None:
        """Key of the results that others are derived from."""
        return next(
            (e["key"] for e in self.files.values() if e["by"] in BASES and e["sha256"] is not None and "of" not in e),
            None,
        )

    # -- asking

    def _check_place(self, name: str) -> None:
        """Refuses a path outside the folder: names may come from a file that is read, such as a run's list of images."""
        try:
            place = Path(_inside(name)).parts[0]
        except ValueError:
            place = OWN
        if place == OWN:
            raise InputError(f"{self.folder}: {name!r} leads outside this folder")
        if max(len(os.fsencode(part)) for part in Path(name).parts) > LONGEST_NAME:
            raise InputError(f"{self.folder}: a name of over {LONGEST_NAME} bytes cannot be written: {name[:30]!r}...")

    def check(self, by: str, names: Iterable[str], inputs: Iterable[Path] = (), force: bool = False) -> None:
        """Refuses files that this command must not replace.

        Args:
            by: the command that would write.
            names: relative files, and folders ending in "/" that it fills.
            inputs: files and folders that the command reads.
            force: files that are not this command's may be replaced; inputs, links and devices may not.

        Raises:
            InputError: names the file and says what to do.
        """
        given = [p for p in inputs if os.path.lexists(p)]
        names = list(names)
        for name in names:
            path = self.folder / name
            self._check_place(name)
            self._check_parents(path)
            owned = self._owner(name) == by or self.folders.get(name.rstrip("/")) == by
            for source in given:
                _refuse_input(path, source, owned)
        for name in names:
            path = self.folder / name
            if not name.endswith("/"):
                refuse_special(path)
                if path.exists() and not force:
                    self._check_owner(name, by)
            elif path.is_symlink() or (path.exists() and not path.is_dir()):
                raise InputError(f"{path}: is not a folder: choose another place with -o")
            elif self.folders.get(name.rstrip("/")) != by and not force:
                for inner in files_below(path) if path.is_dir() else ():
                    self._check_owner(name + inner, by)

    def _check_parents(self, path: Path) -> None:
        for parent in path.relative_to(self.folder).parents:
            place = self.folder / parent
            if str(parent) != "." and (place.is_symlink() or (place.exists() and not place.is_dir())):
                raise InputError(f"{place}: is not a folder of its own, and no link is followed: choose another -o")

    def refuse_links(self, *paths: Path) -> None:
        """Refuses links in the places where massprops writes, moves and removes files without asking.

        Raises:
            InputError: one of the paths, or anything below the record's folder, is a link.
        """
        for path in (*paths, *(self.place / name for name in files_below(self.place))):
            if path.is_symlink():
                raise InputError(f"{path}: is a link, and no link is followed: choose another place with -o")

    def wrote(self, by: str) -> bool:
        """Whether a command wrote any file here, or was ended as it put its files in place."""
        return any(entry["by"] == by for entry in (*self.files.values(), *self._announced.values()))

    @property
    def _announced(self) -> dict[str, dict[str, Any]]:
        """Files that whoever writes next puts in place."""
        return {} if self.pending is None else self.pending["files"]

    def _owner(self, name: str) -> str | None:
        entry = self._announced.get(name) or self.files.get(name)
        return None if entry is None else entry["by"]

    def _check_owner(self, name: str, by: str) -> None:
        owner = self._owner(name)
        if owner is None:
            raise InputError(
                f"{self.folder / name}: was not written by massprops: choose another place with -o, or --force to replace it"
            )
        if owner != by:
            raise InputError(
                f"{self.folder / name}: was written by 'massprops {owner}': choose another place with -o, "
                "or --force to replace it"
            )

    # -- writing; the caller holds the lock

    def staging(self) -> Path:
        """An empty folder for the files of the next `publish`."""
        new = self.place / "new"
        remove_folder(new)
        make_folder(new)
        return new

    def publish(
        self,
        by: str,
        key: str | None,
        inputs: Iterable[Path] = (),
        force: bool = False,
        derived: bool = False,
        keep: Iterable[str] = (),
        keep_old: bool = True,
    ) -> None:
        """Replaces this command's earlier files by what lies in `staging()`.

        Args:
            by: the command.
            key: of what the files were made from.
            inputs, force: as in `check`.
            derived: the files are made from the folder's own results, and go with them.
            keep: former files of the command that stay.
            keep_old: the command's own former files go to `previous/`; else they are lost.

        Raises:
            InputError: as `check`.
            OSError: the disk refuses; the old files stand, or the next command finishes the change.
        """
        new = self.place / "new"
        entries: dict[str, dict[str, Any]] = {}
        for name in files_below(new):  # not brought to the disk one by one: the hashes tell what a power cut took
            entries[name] = {"by": by, "key": key, "sha256": hash_file(new / name)}
            if derived:
                entries[name]["of"] = self.base
        self.check(by, entries, inputs, force)
        stays = {*entries, *keep}
        gone = {n: e["by"] for n, e in self.files.items() if e["by"] == by and e["sha256"] and n not in stays}
        if by in BASES:
            gone |= {n: e["by"] for n, e in self.files.items() if "of" in e and e["of"] != key}
        if force:  # what was made from the files that are replaced is no longer of this folder
            others = {self.files[n]["by"] for n in entries if n in self.files} - {by}
            gone |= {n: e["by"] for n, e in self.files.items() if e["by"] in others and n not in stays}
        aside = gone | {n: (self.files.get(n) or {"by": "found"})["by"] for n in entries if (self.folder / n).exists()}
        if not keep_old:
            aside = {n: owner for n, owner in aside.items() if owner != by}
        self._change(entries, gone, aside)

    def retract(self, which: Iterable[str] | None = None) -> None:
        """Moves results into `previous/`: all of them, or those of the commands named."""
        names = {
            n: e["by"]
            for n, e in self.files.items()
            if e["sha256"] is not None and (which is None or e["by"] in which or "of" in e)
        }
        if names:
            remove_folder(self.place / "new")
            self._change({}, names, names)

    def start_over(self) -> None:
        """Moves all results into `previous/` and removes the folders that only massprops uses."""
        self.retract()
        for name in list(self.trees):
            self._check_parents(self.folder / name)
            remove_folder(self.folder / name)
            del self.trees[name]
        self.save()

    def forget(self) -> None:
        """Removes the record if the first command in this folder wrote nothing."""
        if not self.files and not self.trees:
            for name in self.folders:
                self._check_parents(self.folder / name)
                remove_folder(self.folder / name)
            self.folders = {}
            remove(self.place / "outputs.json")

    def list_live(self, by: str, *names: str) -> None:
        """Records files that change while they are used: they have an owner but no hash."""
        entry = {"by": by, "key": None, "sha256": None}
        if any(self.files.get(name) != entry for name in names):
            self.files |= {name: dict(entry) for name in names}
            self.save()

    def take_folder(self, name: str, by: str) -> None:
        """Records a folder as used by massprops alone."""
        if self.folders.get(name) != by:
            self.folders[name] = by
            self.save()

    def record_tree(self, name: str, by: str, key: str, digest: str | None) -> None:
        """Records the hash of a folder's content; None removes the entry."""
        if digest is None:
            self.trees.pop(name, None)
        else:
            self.trees[name] = {"by": by, "key": key, "sha256": digest}
        self.save()

    def _change(self, entries: dict[str, Any], gone: dict[str, str], aside: dict[str, str]) -> None:
        for by in sorted(set(aside.values())):
            remove_folder(self.place / "previous" / by)
        self.pending = {"files": entries, "gone": sorted(gone), "aside": aside}
        self.save()
        self.recover()

    def recover(self) -> None:
        """Finishes a change that this process, or a killed one, began."""
        if self.pending is None:
            return
        entries, gone, aside = self.pending["files"], self.pending["gone"], self.pending["aside"]
        new, previous = self.place / "new", self.place / "previous"
        self.refuse_links()
        for name in (*entries, *gone, *aside):
            self._check_parents(self.folder / name)
        for name, by in aside.items():
            kept, path = previous / by / name, self.folder / name
            begun = name not in entries or (new / name).exists()
            if begun and path.is_file() and not path.is_symlink() and not kept.exists():
                make_folder(kept.parent)
                rename(path, kept)
                _remove_empty(path.parent, self.folder)
        for name in entries:
            if (new / name).is_file():
                refuse_special(self.folder / name)
                make_folder((self.folder / name).parent)
                rename(new / name, self.folder / name)
        for name in gone:
            if name not in aside and self.files.get(name, {"sha256": None})["sha256"] is not None:
                remove(self.folder / name)
                _remove_empty((self.folder / name).parent, self.folder)
            self.files.pop(name, None)
        self.files |= entries
        self.pending = None
        self.save()
        remove_folder(new)


@contextlib.contextmanager
def claim(
    folder: Path, by: str, names: Iterable[str] = (), inputs: Iterable[Path] = (), force: bool = False
) -> Iterator[Outputs]:
    """Locks a folder for this process, which writes into it as command `by`; arguments as of `Outputs.check`.

    Raises:
        InputError: it belongs to another command, another process holds the lock, or it cannot be written.
    """
    names, inputs = list(names), list(inputs)
    Outputs(folder).check(by, names, inputs, force)  # before anything is made
    with locked(folder):
        outputs = Outputs(folder)
        outputs.refuse_links()
        try:
            for stale in outputs.place.glob(".*.tmp"):  # of a process that was killed as it wrote
                remove(stale)
            outputs.recover()
        except OSError as error:
            raise _unwritable(folder, error) from None
        outputs.check(by, names, inputs, force)
        try:
            yield outputs
        except BaseException:
            if Outputs(folder).pending is None:
                remove_folder(outputs.place / "new")
            raise


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Locks a folder for this process; the lock ends with the process.

    Raises:
        InputError: another process is at work in the folder, or it cannot be written.
    """
    made = [p for p in (folder, *folder.parents) if not p.exists()]
    place = folder / OWN
    if place.is_symlink():
        raise InputError(f"{place}: is a link, and no link is followed: choose another place with -o")
    try:
        make_folder(place)
        refuse_special(place / "lock")
        handle = os.open(place / "lock", os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{folder}: is a file, not a folder: choose another place with -o") from None
    except OSError as error:
        raise _unwritable(folder, error) from None
    with os.fdopen(handle, "r+", errors="replace") as file:
        _take_lock(file, folder, place / "lock")
        with contextlib.suppress(OSError):  # for people only: a full disk is told by what is written next
            file.seek(0)
            file.truncate(0)
            file.write(f"{os.getpid()}\n")
            file.flush()
        _held[folder] = handle
        try:
            yield
        finally:
            _held.pop(folder, None)
            _remove_unused_record(folder, made)


_held: dict[Path, int] = {}
"""Handles of the locks of this process, by folder."""


def lock_to_pass(folder: Path) -> tuple[int, ...]:
    """File handles to pass to a child process that writes into a folder: the folder stays locked while the child lives."""
    return (_held[folder],) if folder in _held else ()


def _take_lock(file: TextIO, folder: Path, path: Path) -> None:
    """Locks a folder, of which `path` is the lock's file.

    The holder writes its number into the file, and its children share the lock. If the holder is dead its children are
    about to end, and this process waits for them.

    Raises:
        InputError: another process is at work in the folder.
    """
    import fcntl

    limit = time.monotonic() + ENDING_S
    while True:
        with contextlib.suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.exists() and path.stat().st_ino == os.fstat(file.fileno()).st_ino:
                return
            limit = 0.0  # whoever held it took it away, with the folder it had made for nothing
        file.seek(0)
        pid = file.read(20).strip()
        known = pid.isdecimal()
        if (known and is_alive(int(pid))) or time.monotonic() > limit:
            who = f" (process {pid})" if known else ""
            raise InputError(
                f"{folder}: another massprops is at work in this folder{who}: wait for it, or choose another -o"
            )
        time.sleep(0.02)


def _remove_unused_record(folder: Path, made: list[Path]) -> None:
    """After a command that wrote nothing: removes the record's folder and the folders that were made for it."""
    place = folder / OWN
    with contextlib.suppress(OSError):
        if {p.name for p in place.iterdir()} <= {"lock", "new"} and not any((place / "new").glob("*")):
            remove_folder(place)
            for path in made:
                path.rmdir()


def deliver(
    folder: Path,
    by: str,
    contents: Mapping[str, str | bytes],
    key: str | None = None,
    inputs: Iterable[Path] = (),
    force: bool = False,
    derived: bool = False,
    keep: Iterable[str] = (),
) -> None:
    """Claims a folder and publishes files into it; see `Outputs.publish`.

    Raises:
        InputError: as `claim`, or the disk refuses.
    """
    inputs = list(inputs)
    with claim(folder, by, contents, inputs, force) as outputs:
        try:
            new = outputs.staging()
            for name, content in contents.items():
                write_whole(new / name, content)
            outputs.publish(by, key, inputs, force, derived, keep)
        except OSError as error:
            raise _unwritable(folder, error) from None


def verify(folder: Path, *names: str) -> None:
    """Refuses results that were changed after their command wrote them. A missing file is no error here.

    Args:
        folder: a run, or any folder; one without a record is taken as it is.
        names: files and trees of the record; a name ending in "/" stands for the files below it.

    Raises:
        InputError: a change was cut short, or a file was changed, damaged or removed since.
    """
    outputs = Outputs(folder)
    if outputs.pending is not None:
        raise InputError(
            f"{folder}: a command is writing this folder, or was stopped while it replaced files there: wait for it, or give "
            "it again"
        )
    below = tuple(name for name in names if name.endswith("/"))
    chosen = [*names, *(name for name in outputs.files if below and name.startswith(below))]
    for name in chosen:
        if not outputs.intact(name):
            by = (outputs.files.get(name) or outputs.trees[name])["by"]
            raise InputError(
                f"{folder / name}: is not what 'massprops {by}' wrote there (changed, damaged or removed): "
                "give that command again"
            )


def _refuse_input(path: Path, source: Path, own: bool) -> None:
    """An input is never what is written, nor inside it; nor is a file of an input folder, but for one of the command's
    own from an earlier time."""
    target, origin = Path(os.path.realpath(path.parent)) / path.name, Path(os.path.realpath(source))
    same = target == origin or target in origin.parents
    same = same or (path.is_file() and not own and origin in target.parents)
    if not same and path.is_file() and source.is_file():
        same = path.samefile(source)
    if same:
        raise InputError(f"{path}: is, or holds, the input {source}: choose another place with -o")


def _remove_empty(folder: Path, top: Path) -> None:
    with contextlib.suppress(OSError):
        while folder != top:
            folder.rmdir()
            folder = folder.parent


def _unwritable(folder: Path, error: OSError) -> InputError:
    return InputError(f"{folder}: cannot be written ({error.strerror}): choose another place with -o")


def _read(path: Path) -> dict[str, Any]:
    """Reads and checks a record: a manipulated record must not lead to files outside the folder."""
    record: dict[str, Any] = {"files": {}, "trees": {}, "folders": {}, "pending": None}
    try:
        refuse_special(path)
        if path.stat().st_size > LARGEST_RECORD:
            raise ValueError
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return record
    except NotADirectoryError:
        return record
    except (OSError, ValueError, RecursionError):
        raise _no_record(path) from None
    try:
        if content["format"] != FORMAT:
            raise ValueError
        for part in ("files", "trees", "folders"):
            record[part] = {_inside(name): entry for name, entry in content[part].items()}
        entries = [*record["files"].values(), *record["trees"].values()]
        pending = content.get("pending")
        if pending is not None:
            entries += list(pending["files"].values())
            for name, by in pending["aside"].items():
                _inside(f"{by}/{name}")
            for name in (*pending["files"], *pending["gone"]):
                _inside(name)
            record["pending"] = pending
        for entry in entries:
            if not {"by", "key", "sha256"} <= set(entry) or not isinstance(entry["by"], str):
                raise ValueError
            _inside(entry["by"])
    except (KeyError, TypeError, ValueError, AttributeError):
        raise _no_record(path) from None
    return record


def _no_record(path: Path) -> InputError:
    return InputError(
        f"{path}: damaged, so nothing tells which files here are massprops's: choose another place with -o"
    )


def _inside(name: str) -> str:
    """A relative name that stays below its folder."""
    parts = Path(name).parts
    if not parts or Path(name).is_absolute() or ".." in parts:
        raise ValueError(name)
    return name
