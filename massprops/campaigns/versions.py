"""The versions of the code that decide a run's numbers, besides its configuration."""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("numpy", "scipy", "numba")


@cache
def versions() -> dict[str, str]:
    """Versions of Python (without the patch level), of massprops with a digest of its source, and of the arithmetic."""
    import massprops

    installed = {
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "massprops": massprops.__version__,
        "source": _digest(Path(massprops.__file__).parent),
    }
    for name in PACKAGES:
        try:
            installed[name] = version(name)
        except PackageNotFoundError:
            installed[name] = "none"
    return installed


def _digest(folder: Path) -> str:
    """The first 12 digits of the sha256 of every Python file, by relative name: two checkouts of one version differ."""
    whole = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        whole.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes() + b"\0")
    return whole.hexdigest()[:12]


def difference(ours: dict[str, str], theirs: dict[str, str]) -> str:
    """The first entry that differs, as "numpy 2.1 here, 2.0 there", or nothing."""
    for name in ours:
        if theirs.get(name) != ours[name]:
            return f"{name} {ours[name]} here, {theirs.get(name, 'none')} there"
    return ""
