"""The folder of a simulated sequence: another simulation may replace it, but no other files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import massprops
from massprops.core.files import hash_of
from massprops.core.outputs import OWN, Outputs, claim
from massprops.errors import InputError

OWNER = "simulate"
PARTS = (
    *("cam0/", "cam1/", "range0/", "tracks0/", "imu0/", "attitude0/", "truth/"),
    *("body.yaml", "environment.yaml"),
)
"""What a simulated sequence is made of."""


@contextmanager
def new_sequence(out: Path, what: object, inputs: Iterable[Path], force: bool = False) -> Iterator[Path]:
    """A folder to write a sequence into; when the block is done, it takes the place of an earlier simulation in `out`.

    Args:
        out: the sequence folder.
        what: scenario, as far as it decides the content.
        inputs: files that the simulation reads.
        force: other files in `out` may be replaced.

    Raises:
        InputError: `out` holds something else, or cannot be written.
    """
    given = list(inputs)
    refuse_others(out, force)
    with claim(out, OWNER, PARTS, given, force) as outputs:
        try:
            new = outputs.staging()
            yield new
            outputs.publish(OWNER, hash_of([massprops.__version__, repr(what)]), given, force, keep_old=False)
        except OSError as error:
            raise InputError(f"{out}: cannot be written ({error.strerror}): choose another place with -o") from None


def refuse_others(folder: Path, force: bool = False) -> None:
    """Only an earlier simulation is written over."""
    if (folder / "run.yaml").exists():
        raise InputError(f"{folder}: holds a run: choose another -o")
    if force or not folder.is_dir() or Outputs(folder).wrote(OWNER):
        return
    if any(entry.name != OWN for entry in folder.iterdir()):
        raise InputError(
            f"{folder}: holds files that are no simulation's: choose another -o, or --force to replace them"
        )
