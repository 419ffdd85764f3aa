"""Damaged npz files are a ValueError, before memory is taken."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from massprops.documents import arrays
from massprops.documents.arrays import open_arrays


def test_damaged_files(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, x=np.arange(1000.0))
    good = path.read_bytes()
    with open_arrays(path) as z:
        assert z["x"].sum() == 499500
    for data in (b"", b"x", good[:100], good[:-30], good[:200] + b"\0" * 50 + good[250:]):
        path.write_bytes(data)
        with pytest.raises((ValueError, OSError)), open_arrays(path) as z:
            z["x"]


def test_a_header_that_announces_more_than_there_is(tmp_path: Path) -> None:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as packed:
        packed.writestr("x.npy", head.getvalue() + b"\0" * 64)
    with pytest.raises(ValueError, match="announces more"), open_arrays(tmp_path / "a.npz") as z:
        z["x"]


def test_objects_are_not_unpickled(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", x=np.array([{}], object))
    with pytest.raises(ValueError), open_arrays(tmp_path / "a.npz") as z:
        z["x"]


@pytest.mark.parametrize("packing", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_what_unpacks_to_more_than_there_can_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packing: int) -> None:
    monkeypatch.setattr(arrays, "LARGEST_PACKED", 100_000)
    data = io.BytesIO()
    np.save(data, np.zeros(20_000))
    with zipfile.ZipFile(tmp_path / "a.npz", "w", packing) as packed:
        packed.writestr("x.npy", data.getvalue())
    if packing == zipfile.ZIP_STORED:
        with open_arrays(tmp_path / "a.npz") as z:
            assert z["x"].shape == (20_000,)
    else:
        with pytest.raises(ValueError, match=r"0\.0 GB of arrays in 0\.0 MB"), open_arrays(tmp_path / "a.npz"):
            pass


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.npz")
    with pytest.raises(ValueError, match="no regular file"), open_arrays(tmp_path / "a.npz"):
        pass
