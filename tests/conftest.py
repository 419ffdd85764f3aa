"""What tests share: the place of the real data, which is not part of the project."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

LONGEST = (
    "run/test_end_to_end",
    "estimators/test_methods",
    "diagnose/test_blind",
    "report/test_report_in_chromium",
    "diagnosis/test_pairs",
    "surface/test_surface",
    "surface/test_shading",
    "diagnose/test_diagnose_mujoco",
    "diagnose/test_independent",
    "sfm/test_across",
    "exchange/test_compare",
    "campaign/test_cluster",
    "surface/test_registration",
    "sfm/test_along_motion",
    "cli/test_bad_footage_commands",
    "dense/test_dense",
    "estimators/test_known_wheel",
    "diagnosis/test_momentum_balance",
)
"""Files that take the longest, from a quarter of a minute on: they go first, so that no process is left with one of them at the end.
`test_methods` takes so long where nothing is compiled yet."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    rank = {f"tests/{name}.py": k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.nodeid.split("::")[0], len(rank)))


@pytest.fixture(scope="session")
def real_data() -> Path:
    """`../shared/data`, or a skip with the reason."""
    if not DATA.is_dir():
        pytest.skip("../shared/data with real photographs and motion logs is not here")
    return DATA


@pytest.fixture
def with_package(tmp_path: Path) -> Callable[..., str]:
    """`with_package(group, code, good=text, bad=text)`: what `code` prints where a package is installed whose modules, by
    their texts, are entry points of the group."""

    def printed(group: str, code: str, **modules: str) -> str:
        points = "".join(f"{name} = plug_{name}\n" for name in modules)
        for name, text in modules.items():
            (tmp_path / f"plug_{name}.py").write_text(text)
        info = tmp_path / "plug-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plug\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[{group}]\n{points}")
        path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
        command, env = [sys.executable, "-c", code], {**os.environ, "PYTHONPATH": path}
        return subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout

    return printed
