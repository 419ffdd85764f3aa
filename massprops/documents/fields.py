"""What stands behind a key of a document: its kind, unit, range and meaning, in one place for reading, writing, docs.

A document is a frozen dataclass whose annotations carry these: `sigma_px: Annotated[float, Number("1-sigma of a track",
"px", above=0)]`. `read` makes one of a mapping; pydantic walks it and finds all that is wrong.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any, ClassVar, TypeVar, cast, dataclass_transform, get_type_hints

import numpy as np

from massprops.documents.loading import excerpt
from massprops.errors import InputError

LARGEST = 1e60
"""Of any number that has no range of its own: its fifth power, as of a length in an inertia, is still a float."""

D = TypeVar("D")


@dataclass_transform(frozen_default=True)
def document(others: str = "refused") -> Callable[[type[D]], type[D]]:
    """Decorator of a document: a frozen dataclass whose annotations say what stands behind each key.

    Args:
        others: what becomes of keys that it does not name, `refused` or `ignored`.
    """

    def made(kind: type[D]) -> type[D]:
        # pydantic looks for its configuration under this name
        kind.__pydantic_config__ = {  # type: ignore[attr-defined]
            "extra": "forbid" if others == "refused" else "ignore",
            "arbitrary_types_allowed": True,
        }
        return dataclass(frozen=True)(kind)

    return made


def _value(value: Any) -> str:
    """A value for a message; text in quotes."""
    return excerpt(repr(value[:60])) if isinstance(value, str) else excerpt(value)


class _Field:
    """Base: `check` is what pydantic calls."""

    about: str
    kind: ClassVar[str] = ""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(self.check)

    def check(self, value: Any) -> Any:
        raise NotImplementedError

    def described(self) -> tuple[str, str, str]:
        """Kind, unit and range, in words."""
        return self.kind, "", ""


def _plain_number(value: Any) -> float:
    """A number as a float; text, true and false are none."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise ValueError(f"must be a number, not {_value(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"must be a finite number, not {_value(value)}")
    return number


@dataclass(frozen=True)
class Number(_Field):
    """A finite number. low, high: ends of its range; above, below: ends that are not part of it."""

    about: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    above: float | None = None
    below: float | None = None
    whole: bool = False

    @property
    def ends(self) -> tuple[float, float]:
        """Lowest and highest value, open ends as if closed."""
        low = self.low if self.low is not None else self.above if self.above is not None else -LARGEST
        high = self.high if self.high is not None else self.below if self.below is not None else LARGEST
        return low, high

    def words(self) -> str:
        """The range, empty when any finite number will do."""
        if self.low is not None and self.high is not None:
            return f"from {self.low:g} to {self.high:g}"
        ends = ((self.above, "above"), (self.low, "at least"), (self.below, "below"), (self.high, "at most"))
        return " and ".join(f"{word} {end:g}" for end, word in ends if end is not None)

    def _missed(self, number: float) -> str:
        """The range for a message, with the end that every number has where that is the one it lies beyond."""
        words, end = self.words(), ""
        if number > self.ends[1] and self.high is None and self.below is None:
            end = f"at most {LARGEST:g}"
        elif number < self.ends[0] and self.low is None and self.above is None:
            end = f"at least {-LARGEST:g}"
        return " and ".join(part for part in (words, end) if part)

    def inside(self, number: float) -> bool:
        low, high = self.ends
        return low <= number <= high and number not in (self.above, self.below)

    def check(self, value: Any) -> float | int:
        number = _plain_number(value)
        if self.whole and (number != int(number) or isinstance(value, float) and abs(number) >= 2**53):
            raise ValueError(f"must be a whole number, not {_value(value)}")
        if not self.inside(number):
            raise ValueError(f"must be {self._missed(number)}, not {_value(value)}")
        return int(value) if self.whole else number

    def described(self) -> tuple[str, str, str]:
        return "whole number" if self.whole else "number", self.unit, self.words()


@dataclass(frozen=True)
class Array(_Field):
    """Finite numbers of a given shape, None for any length; `{rows, cols, data}` and a flat list are read too.

    gaps: whether `null` may stand for a number, read as NaN.
    """

    about: str
    unit: str = ""
    shape: tuple[int | None, ...] = (3,)
    low: float = -LARGEST
    high: float = LARGEST
    gaps: bool = False

    def words(self) -> str:
        sizes = " x ".join("n" if s is None else str(s) for s in self.shape)
        return f"{sizes} finite numbers" + (
            f" from {self.low:g} to {self.high:g}" if self.low > -LARGEST or self.high < LARGEST else ""
        )

    def check(self, value: Any) -> np.ndarray:
        if isinstance(value, dict) and "data" in value:
            value = value["data"]
        flat: list[float] = []
        try:
            sizes = _flatten(value, flat, self.gaps)
        except ValueError:
            raise ValueError(f"must be {self.words()}, not {_value(value)}") from None
        array = np.array(flat)
        if None not in self.shape and len(flat) == math.prod(cast("tuple[int, ...]", self.shape)):
            sizes = cast("tuple[int, ...]", self.shape)
        fits = len(sizes) == len(self.shape) and all(
            want in (None, got) for want, got in zip(self.shape, sizes, strict=True)
        )
        if not fits or ((array < self.low) | (array > self.high)).any():
            raise ValueError(f"must be {self.words()}, not {_value(value)}")
        return array.reshape(sizes)

    def described(self) -> tuple[str, str, str]:
        low, high = self.low > -LARGEST, self.high < LARGEST
        sizes = " x ".join("n" if s is None else str(s) for s in self.shape)
        return f"{sizes} numbers", self.unit, f"each from {self.low:g} to {self.high:g}" if low or high else ""


def _flatten(value: Any, flat: list[float], gaps: bool = False) -> tuple[int, ...]:
    """Appends all numbers of nested lists; gives their shape.

    Raises:
        ValueError: not numbers, or lists of unequal lengths.
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, list | tuple):
        flat.append(math.nan if gaps and value is None else _plain_number(value))
        return ()
    inner = {_flatten(v, flat, gaps) for v in value}
    if len(inner) > 1:
        raise ValueError("lists of unequal lengths")
    return (len(value), *(inner.pop() if inner else ()))


@dataclass(frozen=True)
class Text(_Field):
    """A short text; `choices` names all that are known."""

    about: str
    choices: tuple[str, ...] = ()
    longest: int = 1000
    kind: ClassVar[str] = "text"

    def check(self, value: Any) -> str:
        if not isinstance(value, str) or len(value) > self.longest:
            raise ValueError(f"must be a text of at most {self.longest} characters, not {_value(value)}")
        if self.choices and value not in self.choices:
            raise ValueError(f"is {value!r:.60}; only {' or '.join(self.choices)} is known")
        return value

    def described(self) -> tuple[str, str, str]:
        return self.kind, "", ", ".join(f"`{c}`" for c in self.choices)


@dataclass(frozen=True)
class YesNo(_Field):
    """true or false."""

    about: str
    kind: ClassVar[str] = "true or false"

    def check(self, value: Any) -> bool:
        if not isinstance(value, bool):
            raise ValueError(f"must be true or false, not {_value(value)}")
        return value


@dataclass(frozen=True)
class Listed(_Field):
    """A list, every entry of one kind; read as a tuple."""

    about: str
    of: _Field
    longest: int = 100_000
    count: int | None = None

    def check(self, value: Any) -> tuple[Any, ...]:
        wanted = f"a list of {self.count} {self.of.described()[0]}s" if self.count else "a list"
        if not isinstance(value, list | tuple) or self.count not in (None, len(value)):
            raise ValueError(f"must be {wanted}, not {_value(value)}")
        if len(value) > self.longest:
            raise ValueError(f"must be a list of at most {self.longest} entries, not of {len(value)}")
        try:
            return tuple(self.of.check(v) for v in value)
        except ValueError as error:
            raise ValueError(f"must be {wanted}, each of which {error}") from None

    def described(self) -> tuple[str, str, str]:
        kind, unit, words = self.of.described()
        return (f"list of {self.count} x {kind}" if self.count else f"list, each: {kind}"), unit, words


@dataclass(frozen=True)
class Names(_Field):
    """Names with values of any kind, checked elsewhere."""

    about: str
    kind: ClassVar[str] = "names with values"

    def check(self, value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise ValueError(f"must be names with values, not {_value(value)}")
        return {str(k): v for k, v in value.items()}


@dataclass(frozen=True)
class Nested(_Field):
    """About a part that is a document of its own; checks nothing besides."""

    about: str
    many: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return handler(source)


@cache
def _adapter(kind: Any) -> Any:
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def read(kind: type[D], content: dict[str, Any], where: str) -> D:
    """A document of a mapping.

    Args:
        kind: dataclass with annotated fields.
        content: as `massprops.documents.loading` gives it.
        where: file, for messages.

    Raises:
        InputError: a key that is missing or unknown, or a value of the wrong kind or out of range.
    """
    from pydantic import ValidationError

    try:
        return cast("D", _adapter(cast("Any", kind)).validate_python(content))
    except ValidationError as error:
        raise InputError(_message(kind, error.errors(include_url=False)[0], where)) from None


def unread(kind: type, content: dict[str, Any], where: str) -> tuple[dict[str, Any], list[str]]:
    """The content without the keys that the document does not know, and a warning for each of them.

    For files that other programs write too. A key that is nearly a known one is more likely misspelt than meant for
    someone else.

    Raises:
        InputError: a key that is nearly a known one.
    """
    known = keys(kind)
    kept, strange = {}, []
    for key, value in content.items():
        if key in known:
            kept[key] = value
            continue
        near = difflib.get_close_matches(key.casefold(), known, n=1, cutoff=0.8)
        if near and near[0] not in content:
            raise InputError(f"{where}: no key {excerpt(key)!r}; did you mean {near[0]!r}?")
        strange.append(key)
    return kept, [f"{where}: {excerpt(key)} is not read" for key in strange]


def as_written(kind: type, content: dict[str, Any], where: str) -> dict[str, Any]:
    """`content`, checked as it will be when it is read again.

    Raises:
        InputError: as `read`.
    """
    read(kind, content, where)
    return content


def keys(kind: type) -> list[str]:
    """Names of the keys of a document."""
    return [f.name for f in fields(kind)]


def field_of(kind: type, key: str) -> Any:
    """What stands behind a key, or None."""
    hint = get_type_hints(kind, include_extras=True).get(key)
    for part in (hint, *getattr(hint, "__args__", ())):
        for extra in getattr(part, "__metadata__", ()):
            if isinstance(extra, _Field):
                return extra
    return None


def ranges_of(kind: type) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of every number of a document that has both."""
    field_by_key = {key: field_of(kind, key) for key in keys(kind)}
    return {
        key: field.ends
        for key, field in field_by_key.items()
        if isinstance(field, Number) and max(map(abs, field.ends)) < LARGEST
    }


def no_key(key: str, known: Iterable[str], what: str = "key") -> str:
    """What to say to a name that is not known: the nearest one that is, else all of them."""
    names = list(known)
    folded = {name.casefold(): name for name in names}
    near = difflib.get_close_matches(key.casefold(), list(folded), n=1, cutoff=0.5)
    hint = f"did you mean {folded[near[0]]!r}?" if near else f"there are {excerpt(', '.join(names), 240) or 'none'}"
    return f"no {what} {excerpt(key)!r}; {hint}"


def unknown(what: str, given: object, known: Iterable[str], where: str = "") -> InputError:
    """The error for a name that is not known."""
    return InputError(f"{where + ': ' if where else ''}{no_key(str(given), known, what)}")


def _message(kind: type, error: Any, where: str) -> str:
    """One line of one of pydantic's errors."""
    place = [part for part in error["loc"] if isinstance(part, int) or not part.startswith("function-")]
    *outer, last = place or ["document"]
    within = "".join(f" {p + 1}:" if isinstance(p, int) else f" {p}:" for p in outer)
    if error["type"] == "unexpected_keyword_argument":
        return f"{where}:{within} {no_key(str(last), keys(_inside(kind, outer)))}"
    name = f"entry {last + 1}" if isinstance(last, int) else last
    if error["type"] == "missing":
        field = field_of(_inside(kind, outer), str(last))
        about = f"; give {last}: {field.about}" if field is not None else ""
        return f"{where}:{within} no {last}{about}"
    if error["type"] == "value_error":
        return f"{where}:{within} {name} {error['ctx']['error']}"
    expected = {"dataclass_type": "names with values", "list_type": "a list", "tuple_type": "a list"}
    wanted = expected.get(error["type"], error["msg"].lower())
    return f"{where}:{within} {name} must be {wanted}, not {_value(error['input'])}"


def _inside(kind: type, place: list[Any]) -> type:
    """The document at a place within another."""
    for part in place:
        if isinstance(part, int):
            continue
        inner_kind = inner(get_type_hints(kind)[part])
        kind = inner_kind if inner_kind is not None else kind
    return kind


def inner(hint: Any) -> type | None:
    """The document within an annotation such as `tuple[Effect, ...] | None`, or None."""
    if isinstance(hint, type) and is_dataclass(hint):
        return hint
    return next((d for d in map(inner, getattr(hint, "__args__", ())) if d is not None), None)
