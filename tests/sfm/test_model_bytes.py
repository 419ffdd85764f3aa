"""A COLMAP model of unknown origin: counts, links and names that are wrong are one line, and soon."""

from __future__ import annotations

import mmap
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from test_mapping import footage, solve

from massprops.errors import InputError
from massprops.sfm.convert import HALF, to_points, to_views
from massprops.sfm.model_bytes import WALKS, check_lengths, write_model
from massprops.sfm.sparse_import import import_sparse


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> tuple[pycolmap.Reconstruction, object, Path]:
    place = tmp_path_factory.mktemp("model")
    model, _, _, truth = solve(place / "a")
    (place / "m").mkdir()
    model.write_binary(place / "m")
    return model, footage(truth), place / "m"


def test_every_byte_of_a_model_is_accounted_for(solved: tuple) -> None:
    check_lengths(solved[2])
    for name in ("images", "points3D", "rigs", "frames"):
        with (
            (solved[2] / f"{name}.bin").open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            assert WALKS[name](data) == len(data), name


def test_a_disk_that_refuses_is_an_error(solved: tuple, tmp_path: Path) -> None:
    """COLMAP says nothing."""
    import resource

    write_model(solved[0], tmp_path / "a")
    assert {p.name: p.read_bytes() for p in (tmp_path / "a").iterdir()} == {
        p.name: p.read_bytes() for p in solved[2].iterdir()
    }
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        for size in (200, 10_000):
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
            solved[0].write(tmp_path / "a")
            with pytest.raises(OSError, match="Input/output error"):
                write_model(solved[0], tmp_path / "a")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def huge(data: bytes) -> bytes:
    return struct.pack("<Q", 2**40) + data[8:]


@pytest.mark.parametrize("change", [huge, lambda data: data[:-9], lambda data: b""])
@pytest.mark.parametrize("name", WALKS)
def test_a_file_that_announces_more_than_it_holds(
    solved: tuple, tmp_path: Path, name: str, change: Callable[[bytes], bytes]
) -> None:
    path = shutil.copytree(solved[2], tmp_path / "m") / f"{name}.bin"
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(InputError, match=rf"{name}.bin: damaged") as caught:
        import_sparse(tmp_path / "m", solved[1])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("what", ["a point that is none", "a name that is no text", "a size that is none"])
def test_what_no_model_holds(solved: tuple, tmp_path: Path, what: str) -> None:
    m = shutil.copytree(solved[2], tmp_path / "m")
    images, cameras = bytearray((m / "images.bin").read_bytes()), bytearray((m / "cameras.bin").read_bytes())
    name = 8 + 4 + 56 + 4
    if what == "a point that is none":
        first = images.index(b"\0", name) + 1 + 8
        images[first + 16 : first + 24] = struct.pack("<Q", 4_000_000_000)
    elif what == "a name that is no text":
        images[name] = 0x80
    else:
        cameras[16:24] = struct.pack("<Q", 2**63 + 5)
    (m / "images.bin").write_bytes(images)
    (m / "cameras.bin").write_bytes(cameras)
    with pytest.raises(InputError, match="(a damaged|not a readable) COLMAP model") as caught:
        import_sparse(m, solved[1])
    assert len(str(caught.value)) - len(str(m)) < 200


def test_points_are_those_that_colmap_hands_out(solved: tuple) -> None:
    model = solved[0]
    _, ids = to_views(model)
    points = to_points(model, ids)
    assert points.id.tolist() == sorted(model.point3D_ids())
    for row, number in enumerate(points.id.tolist()):
        point = model.point3D(number)
        assert (points.xyz[row] == point.xyz).all() and (points.rgb[row] == point.color).all()
        assert points.error[row] == point.error
        seen = np.flatnonzero(points.obs_point == row)
        assert {(ids[v], *uv) for v, uv in zip(points.obs_view[seen], (points.obs_uv[seen] + HALF).tolist(), strict=True)} == {
            (e.image_id, *model.image(e.image_id).points2D[e.point2D_idx].xy.tolist()) for e in point.track.elements
        }  # fmt: skip
    some = to_points(model, ids[2:4])
    kept = (points.obs_view == 2) | (points.obs_view == 3)
    assert (some.obs_view == points.obs_view[kept] - 2).all() and (some.obs_point == points.obs_point[kept]).all()


def test_a_model_without_anything_has_no_points() -> None:
    assert not len(to_points(pycolmap.Reconstruction(), []).xyz)
