"""YAML and JSON of unknown origin as plain values, with limits on size, depth, aliases and numbers.

What comes back holds text, whole numbers of 64 bits, finite floats, true, false, nothing, lists, and mappings with
text for keys. YAML's dates, sets, binary data and language tags are not read as such: a date stays text.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

from massprops.documents.limits import DEEPEST, LARGEST_WHOLE, excerpt
from massprops.errors import InputError

LARGEST_BYTES = 4_000_000
"""A filter document of 300 features has 30 kB. The largest JSON, of a run with thousands of images, has under 2 MB."""


def load_yaml(path: Path) -> dict[str, Any]:
    """A YAML file that holds names with values.

    Raises:
        InputError: no such file, beyond a limit, not YAML, or not a mapping.
    """
    return parse_yaml(load_text(path), str(path))


def load_json(path: Path) -> dict[str, Any]:
    """A JSON file that holds names with values.

    Raises:
        InputError: no such file, beyond a limit, not JSON, or not a mapping.
    """
    return parse_json(load_text(path), str(path))


def parse_yaml(text: str, where: str) -> dict[str, Any]:
    """As `load_yaml`, of a text; `where` stands in messages."""
    import yaml

    from massprops.documents.bounded_yaml import Bounded

    try:
        content = yaml.load(text, Loader=Bounded)  # type: ignore[arg-type]
    except yaml.MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InputError(
            f"{where}: not YAML that can be read{line}: {excerpt(error.problem or 'unknown fault')}"
        ) from None
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"{where}: not YAML that can be read: {excerpt(error)}") from None
    return _mapping({} if content is None else content, where)


def parse_json(text: str, where: str) -> dict[str, Any]:
    """As `load_json`, of a text."""
    if _depth(text) > DEEPEST:
        raise InputError(
            f"{where}: nested more than {DEEPEST} levels deep, more than such a document ever is: give another"
        )
    try:
        content = json.loads(text, parse_constant=_no_constant, parse_int=_whole, parse_float=_finite)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not JSON that can be read: {excerpt(error)}") from None
    return _mapping(content, where)


def load_text(path: Path) -> str:
    """A document as text, a byte order mark left out.

    Raises:
        InputError: no such file, not UTF-8, or larger than any document is.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise InputError(
                f"{path}: {size / 1e6:.1f} MB is too large for such a document, which has at most "
                f"{LARGEST_BYTES / 1e6:.0f} MB: give another file"
            )
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not text in UTF-8 (byte {error.start}): save it as UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _mapping(content: Any, where: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        kind = "list" if isinstance(content, list) else "text" if isinstance(content, str) else type(content).__name__
        raise InputError(f"{where}: holds a {kind}: give names with values, as 'name: value'")
    return content


def _depth(text: str) -> int:
    """Levels of nesting of a JSON text, brackets within its strings left out."""
    depth = deepest = 0
    for mark in re.finditer(r'"(?:[^"\\]|\\.)*"|[\[\]{}]', text):
        c = mark.group()
        depth += (c in "[{") - (c in "]}")
        deepest = max(deepest, depth)
    return deepest


def _no_constant(name: str) -> Any:
    raise ValueError(f"{name} is no JSON number")


def _whole(text: str) -> int:
    if len(text) > 20 or abs(int(text)) > LARGEST_WHOLE:
        raise ValueError(f"integer {text[:12]}… of {len(text)} digits is too large")
    return int(text)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"number {text[:20]} is too large")
    return value


__all__ = ["load_json", "load_text", "load_yaml", "parse_json", "parse_yaml", "excerpt"]
