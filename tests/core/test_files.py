"""The file layer: what a disk refuses is an error, also where a library would keep it to itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from massprops.core.files import write_image


@contextmanager
def small_files(size: int) -> Iterator[None]:
    """Within this no file may grow beyond so many bytes."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(
    ("name", "options"),
    [("a.png", ()), ("a.png", (cv2.IMWRITE_PNG_COMPRESSION, 1)), ("A.JPG", (cv2.IMWRITE_JPEG_QUALITY, 97))],
)
def test_an_image_is_written_as_opencv_writes_it_or_not_at_all(
    tmp_path: Path, name: str, options: tuple[int, ...]
) -> None:
    image = np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / name), image, list(options))
    write_image(tmp_path / "below" / name, image, options)
    assert (tmp_path / "below" / name).read_bytes() == (tmp_path / name).read_bytes()
    with small_files(500), pytest.raises(OSError):
        write_image(tmp_path / "below" / name, image, options)
