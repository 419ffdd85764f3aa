"""YAML and JSON of unknown origin as plain values, with limits on size, depth, aliases and numbers.

What comes back holds text, whole numbers of 64 bits, finite floats, true, false, nothing, lists, and mappings with
text for keys. YAML's dates, sets, binary data and language tags are not read as such: a date stays text.
"""

from __future__ import annotations

import json
import math
import re
from functools import cache
from pathlib import Path
from typing import Any

from massprops.errors import InputError

LARGEST_BYTES = 4_000_000
"""A filter document of 300 features has 30 kB. The largest JSON, of a run with thousands of images, has under 2 MB."""
MOST_VALUES = 100_000
"""Values of a document with every alias written out."""
DEEPEST = 40
"""Levels of nesting; our own documents have at most 7."""
LARGEST_WHOLE = 2**63 - 1


def load_yaml(path: Path) -> dict[str, Any]:
    """A YAML file that holds names with values.

    Raises:
        InputError: no such file, beyond a limit, not YAML, or not a mapping.
    """
    return parse_yaml(_text(path), str(path))


def load_json(path: Path) -> dict[str, Any]:
    """A JSON file that holds names with values.

    Raises:
        InputError: no such file, beyond a limit, not JSON, or not a mapping.
    """
    return parse_json(_text(path), str(path))


def parse_yaml(text: str, where: str) -> dict[str, Any]:
    """As `load_yaml`, of a text; `where` stands in messages."""
    import yaml

    try:
        content = yaml.load(text, Loader=_loader())
    except yaml.MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InputError(
            f"{where}: not YAML that can be read{line}: {shown(error.problem or 'unknown fault')}"
        ) from None
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"{where}: not YAML that can be read: {shown(error)}") from None
    return _mapping({} if content is None else content, where)


def parse_json(text: str, where: str) -> dict[str, Any]:
    """As `load_json`, of a text."""
    if _depth(text) > DEEPEST:
        raise InputError(f"{where}: nested more than {DEEPEST} levels deep")
    try:
        content = json.loads(text, parse_constant=_no_constant, parse_int=_whole, parse_float=_finite)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not JSON that can be read: {shown(error)}") from None
    return _mapping(content, where)


def shown(value: Any, most: int = 60) -> str:
    """A value for a message: one short line without characters that steer a terminal."""
    text = value if isinstance(value, str) else str(value) if isinstance(value, Exception) else _brief(value, most)
    text = "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))
    return text if len(text) <= most else text[: most - 1] + "…"


def _brief(value: Any, most: int) -> str:
    """`repr` of the beginning of a value only, since all of it may be long."""
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_brief(v, most) for v in value[:8]) + (", …" if len(value) > 8 else "") + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k}: …" for k in list(value)[:4]) + "}"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > LARGEST_WHOLE:
        return "an integer of more than 64 bits"
    return repr(value[: most + 1] if isinstance(value, str | bytes) else value)


def _text(path: Path) -> str:
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise InputError(f"{path}: {size / 1e6:.1f} MB; such a document has at most {LARGEST_BYTES / 1e6:.0f} MB")
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not text in UTF-8 (byte {error.start}): save it as UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _mapping(content: Any, where: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        kind = "list" if isinstance(content, list) else "text" if isinstance(content, str) else type(content).__name__
        raise InputError(f"{where}: expected names with values, found a {kind}")
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


@cache
def _parser() -> Any:
    """What turns text into YAML events: libyaml where PyYAML was built with it, else PyYAML itself, ten times slower."""
    try:
        from yaml._yaml import CParser  # type: ignore[import-not-found]
    except ImportError:
        from yaml.parser import Parser
        from yaml.reader import Reader
        from yaml.scanner import Scanner

        class Plain(Reader, Scanner, Parser):
            def __init__(self, stream: str) -> None:
                Reader.__init__(self, stream)
                Scanner.__init__(self)
                Parser.__init__(self)

        return Plain
    return CParser


@cache
def _loader() -> Any:
    """PyYAML's safe loader with limits."""
    import yaml
    from yaml.composer import Composer
    from yaml.constructor import SafeConstructor
    from yaml.resolver import Resolver

    class Bounded(Composer, SafeConstructor, Resolver, _parser()):  # type: ignore[misc]
        def __init__(self, stream: str) -> None:
            _parser().__init__(self, stream)
            Composer.__init__(self)
            SafeConstructor.__init__(self)
            Resolver.__init__(self)
            self.values, self.level = 0, 0
            self.open: set[str] = set()
            self.sizes: dict[str, int] = {}

        def compose_node(self, parent: Any, index: Any) -> Any:
            event = self.peek_event()
            anchor = event.anchor
            alias = isinstance(event, yaml.AliasEvent)
            if alias and anchor in self.open:
                self.refuse(f"alias *{anchor} stands inside of what it names", event)
            if not alias and event.tag not in (None, "!", "tag:yaml.org,2002:str"):
                self.refuse(f"tag {shown(event.tag, 40)} is not read", event)
            self.values += self.sizes.get(anchor, 1) if alias else 1
            if self.values > MOST_VALUES:
                self.refuse(f"more than {MOST_VALUES} values with aliases written out", event)
            if alias:
                return Composer.compose_node(self, parent, index)
            self.level += 1
            if self.level > DEEPEST:
                self.refuse(f"nested more than {DEEPEST} levels deep", event)
            before = self.values
            if anchor is not None:
                self.open.add(anchor)
            node = Composer.compose_node(self, parent, index)
            self.level -= 1
            if anchor is not None:
                self.open.discard(anchor)
                self.sizes[anchor] = self.values - before + 1
            return node

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            own: set[str] = set()
            for key, _ in node.value:
                if not isinstance(key, yaml.ScalarNode):
                    self.refuse("a list or mapping as a name", key)
                if key.value in own and key.tag != "tag:yaml.org,2002:merge":
                    self.refuse(f"{shown(key.value)!r} is given twice", key)
                own.add(key.value)
            self.flatten_mapping(node)
            # later pairs are the mapping's own, earlier ones merged from elsewhere
            return {key.value: self.construct_object(value, deep=True) for key, value in node.value}

        def refuse(self, problem: str, at: Any) -> None:
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=at.start_mark)

        def whole(self, node: Any) -> int:
            text = node.value
            try:
                value = self.construct_yaml_int(node) if len(text) <= 64 else LARGEST_WHOLE + 1
            except ValueError:
                self.refuse(f"{shown(text)!r} is not a whole number", node)
            if abs(value) > LARGEST_WHOLE:
                self.refuse(f"integer {text[:12]}… of {len(text)} digits is too large", node)
            return value

        def number(self, node: Any) -> float:
            text = node.value
            try:
                value = float(self.construct_yaml_float(node)) if len(text) <= 400 else math.inf
            except ValueError:
                self.refuse(f"{shown(text)!r} is not a number", node)
            if math.isinf(value) and "inf" not in text.lower():
                self.refuse(f"number {text[:20]} is too large", node)
            return value

        def sequence(self, node: Any) -> list[Any]:
            return [self.construct_object(child, deep=True) for child in node.value]

    tag = "tag:yaml.org,2002:"
    Bounded.yaml_constructors = {
        f"{tag}null": SafeConstructor.construct_yaml_null,
        f"{tag}bool": SafeConstructor.construct_yaml_bool,
        f"{tag}int": Bounded.whole,
        f"{tag}float": Bounded.number,
        f"{tag}str": SafeConstructor.construct_yaml_str,
        f"{tag}seq": Bounded.sequence,
        f"{tag}map": Bounded.construct_mapping,
        f"{tag}value": SafeConstructor.construct_yaml_str,
        f"{tag}merge": SafeConstructor.construct_yaml_str,
    }
    Bounded.yaml_implicit_resolvers = {
        first: [(t, pattern) for t, pattern in found if not t.endswith("timestamp")]
        for first, found in Resolver.yaml_implicit_resolvers.items()
    }
    # YAML 1.1 takes 1e-3 for text; everyone else, and YAML 1.2, for a number
    Bounded.add_implicit_resolver(
        f"{tag}float", re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
    )
    return Bounded


__all__ = ["load_json", "load_yaml", "parse_json", "parse_yaml", "shown"]
