"""What tests share: the place of the real data, which is not part of the project."""

from __future__ import annotations

from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def real_data() -> Path:
    """`../shared/data`, or a skip with the reason."""
    if not DATA.is_dir():
        pytest.skip("../shared/data with real photographs and motion logs is not here")
    return DATA
