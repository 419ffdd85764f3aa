"""YAML and JSON beyond a limit are one clear line; what is within comes back as plain values."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from massprops.documents import bounded_yaml
from massprops.documents.loading import excerpt, load_json, load_yaml, parse_json, parse_yaml
from massprops.errors import InputError

BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(9)
)
MERGED = "a: &a {k: 1}\n" + "".join(
    f"m{i}: &m{i} {{<<: [{', '.join([f'*m{i - 1}' if i else '*a'] * 9)}]}}\n" for i in range(9)
)

REFUSED = {
    "bomb": (BOMB, "line 6: more than 100000 values"),
    "bomb of merges": (MERGED, "more than 100000 values"),
    "cycle": ("a: &x [*x, *x]", "stands inside of what it names"),
    "cycle of mappings": ("a: &x {b: *x}", "stands inside"),
    "deep": ("a: " + "[" * 200, "more than 40 levels"),
    "deeper than a parser goes": ("a: " + "[" * 100_000, "not YAML"),
    "400 digits": ("a: " + "9" * 400, "of 400 digits is too large"),
    "5000 digits": ("a: " + "9" * 5000, "of 5000 digits is too large"),
    "hexadecimal": ("a: 0x" + "f" * 100, "too large"),
    "large float": ("a: 1.0e+999", "too large"),
    "base 60": ("a: 1:30", "line 1: '1:30' would be read to the base 60"),
    "base 60 with a point": ("a: 1:30.5", "to the base 60"),
    "python": ("a: !!python/object/apply:os.system [ls]", "tag .* is not read"),
    "binary": ("a: !!binary aGVsbG8=", "is not read"),
    "set": ("a: !!set {x}", "is not read"),
    "list as name": ("? [1]\n: 2", "as a name"),
    "twice": ("a: 1\nb: 2\na: 3", "line 3: 'a' is given twice"),
    "list": ("- 1", "holds a list: give names with values"),
    "control characters": ("a: \x1b[31m", "not YAML"),
    "two documents": ("a: 1\n---\nb: 2", "another document"),
}


@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.parametrize("parser", ["libyaml", "python"])
def test_refused_in_one_line(case: str, parser: str, monkeypatch: pytest.MonkeyPatch) -> None:
    text, says = REFUSED[case]
    if parser == "python":
        monkeypatch.setitem(sys.modules, "yaml._yaml", None)
        monkeypatch.delitem(sys.modules, bounded_yaml.__name__)
    if case == "control characters" or parser == "python" and case == "python":
        says = "not YAML"
    with pytest.raises(InputError, match=says) as caught:
        parse_yaml(text, "file.yaml")
    assert (
        str(caught.value).startswith("file.yaml: ") and "\n" not in str(caught.value) and len(str(caught.value)) < 200
    )


def test_plain_values_come_back() -> None:
    text = "a: 1e-3\nb: 2024-01-01\non: yes\nc: &c {x: 1}\nd: {<<: *c, y: ~}\ne: [1.5, .5e3, 0x10]\n"
    want = {"a": 1e-3, "b": "2024-01-01", "on": True, "c": {"x": 1}, "d": {"x": 1, "y": None}, "e": [1.5, 500.0, 16]}
    assert parse_yaml(text, "f") == want
    assert parse_yaml("", "f") == {}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[" * 100_000, "levels"),
        ('{"a": NaN}', "NaN is no JSON"),
        ('{"a": ' + "9" * 5000 + "}", "5000 digits"),
        ('{"a": 1e999}', "too large"),
        ("[1]", "holds a list"),
        ("{", "not JSON"),
    ],
)
def test_json_too(text: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        parse_json(text, "f.json")
    assert parse_json('{"a": [1, 2.5, "[[["]}', "f") == {"a": [1, 2.5, "[[["]}


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    for content, says in ((b"\xff\xfea\x00", "UTF-8"), (b"a: 1\n" * 1_000_000, "5.0 MB"), (None, "no such file")):
        if content is None:
            path.unlink()
        else:
            path.write_bytes(content)
        for read in (load_yaml, load_json):
            with pytest.raises(InputError, match=says):
                read(path)
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\n")
    assert load_yaml(path) == {"a": 1}


def test_what_is_shown_steers_no_terminal() -> None:
    assert excerpt("a\x1b[31m\nb") == "a?[31m b"
    assert len(excerpt(list(range(10**6)))) < 70 and len(excerpt("x" * 10**6)) == 60
    assert "more than 64 bits" in excerpt(10**5000)
