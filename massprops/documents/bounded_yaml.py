"""PyYAML's safe loader with limits on values, depth, aliases, tags and numbers."""

from __future__ import annotations

import math
import re
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.resolver import Resolver

from massprops.documents.limits import DEEPEST, LARGEST_WHOLE, MOST_VALUES, excerpt

try:  # libyaml where PyYAML was built with it, else PyYAML itself, ten times slower
    from yaml._yaml import CParser as Parser
except ImportError:
    from yaml import parser, reader, scanner

    class Parser(reader.Reader, scanner.Scanner, parser.Parser):  # type: ignore[no-redef]
        """What turns text into YAML events."""

        def __init__(self, stream: str) -> None:
            reader.Reader.__init__(self, stream)
            scanner.Scanner.__init__(self)
            parser.Parser.__init__(self)


class Bounded(Composer, SafeConstructor, Resolver, Parser):
    """The safe loader that refuses what goes beyond a limit."""

    def __init__(self, stream: str) -> None:
        Parser.__init__(self, stream)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self.values, self.level = 0, 0
        self.open: set[str] = set()
        self.sizes: dict[str, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        event: Any = self.peek_event()
        anchor = event.anchor
        alias = isinstance(event, yaml.AliasEvent)
        if alias and anchor in self.open:
            self.refuse(f"alias *{anchor} stands inside of what it names", event)
        if not alias and event.tag not in (None, "!", "tag:yaml.org,2002:str"):
            self.refuse(f"tag {excerpt(event.tag, 40)} is not read", event)
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
        names_given: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                self.refuse("a list or mapping as a name", key)
            if key.value in names_given and key.tag != "tag:yaml.org,2002:merge":
                self.refuse(f"{excerpt(key.value)!r} is given twice", key)
            names_given.add(key.value)
        self.flatten_mapping(node)
        # later pairs are the mapping's own, earlier ones merged from elsewhere
        return {key.value: self.construct_object(value, deep=True) for key, value in node.value}

    def refuse(self, problem: str, at: Any) -> None:
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=at.start_mark)

    def decimal(self, node: Any) -> str:
        """A number as it is written; YAML 1.1 takes 1:30 for ninety, which nobody means who writes it."""
        if ":" in node.value:
            self.refuse(
                f"{excerpt(node.value)!r} would be read to the base 60: write it in decimals, or in quotes", node
            )
        return str(node.value)

    def whole(self, node: Any) -> int:
        text = self.decimal(node)
        try:
            value = self.construct_yaml_int(node) if len(text) <= 64 else LARGEST_WHOLE + 1
        except ValueError:
            self.refuse(f"{excerpt(text)!r} is not a whole number", node)
        if abs(value) > LARGEST_WHOLE:
            self.refuse(f"integer {text[:12]}… of {len(text)} digits is too large", node)
        return value

    def number(self, node: Any) -> float:
        text = self.decimal(node)
        try:
            value = float(self.construct_yaml_float(node)) if len(text) <= 400 else math.inf
        except ValueError:
            self.refuse(f"{excerpt(text)!r} is not a number", node)
        if math.isinf(value) and "inf" not in text.lower():
            self.refuse(f"number {text[:20]} is too large", node)
        return value

    def sequence(self, node: Any) -> list[Any]:
        return [self.construct_object(child, deep=True) for child in node.value]


TAG = "tag:yaml.org,2002:"
Bounded.yaml_constructors = {
    f"{TAG}null": SafeConstructor.construct_yaml_null,
    f"{TAG}bool": SafeConstructor.construct_yaml_bool,
    f"{TAG}int": Bounded.whole,
    f"{TAG}float": Bounded.number,
    f"{TAG}str": SafeConstructor.construct_yaml_str,
    f"{TAG}seq": Bounded.sequence,
    f"{TAG}map": Bounded.construct_mapping,
    f"{TAG}value": SafeConstructor.construct_yaml_str,
    f"{TAG}merge": SafeConstructor.construct_yaml_str,
}
Bounded.yaml_implicit_resolvers = {
    first: [(t, pattern) for t, pattern in found if not t.endswith("timestamp")]
    for first, found in Resolver.yaml_implicit_resolvers.items()
}
# YAML 1.1 takes 1e-3 for text; everyone else, and YAML 1.2, for a number
Bounded.add_implicit_resolver(
    f"{TAG}float", re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)
