"""Every reader of a user's text gives back what was written, or says in one line what is wrong: no other error.

Files of bytes and whole folders are changed at random in `tests/fuzz`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from drawn import arrays, numbers, quickly, turns
from hypothesis import given
from hypothesis import strategies as st

from massprops.capture.choice import parse as parse_choice
from massprops.core.files import json_text
from massprops.documents.fields import Number
from massprops.documents.loading import load_json, load_text, load_yaml, parse_json, parse_yaml
from massprops.documents.scale_json import read_scale
from massprops.documents.tables import ATTITUDE, GYROSCOPE, RANGE, ROTOR, STATE, TRACKS
from massprops.effect_file import read_effect
from massprops.effects import effects
from massprops.errors import InputError, MasspropsError
from massprops.estimators.prior import read_filter
from massprops.exchange.mesh_files import read_mesh
from massprops.mass.document import read_document
from massprops.model import document_of, load_model, model_of
from massprops.report.data import read_json
from massprops.sequence import AttitudeSeries, RangeSeries, RateSeries, Sequence, write_sequence
from massprops.sequence.read import read_sequence
from massprops.sequence.table import read_table
from massprops.sequence.truth import read_truth
from massprops.sfm.scale.distance import read_named
from massprops.sfm.scale.marker import parse as parse_marker
from massprops.simulation.scenario import load_scenario
from massprops_cli.simulate import _distortion, _hidden, _size

TEXTS = st.text(max_size=200) | st.text("0123456789.,-+e:[]{}#\n \"'", max_size=120)
KEYS = st.text("abcdefgh_1", min_size=1, max_size=6)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | numbers(-1e9, 1e9) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=8,
)
DOCUMENTS = st.dictionaries(KEYS, PLAIN, max_size=4)


def in_one_line(read: Callable[[], object]) -> None:
    """Reads, or is refused in one line."""
    try:
        read()
    except MasspropsError as error:
        assert str(error) and "\n" not in str(error)


READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "text": ("a.txt", load_text),
    "yaml": ("a.yaml", load_yaml),
    "json": ("a.json", load_json),
    "scenario": ("a.yaml", load_scenario),
    "model": ("model.yaml", load_model),
    "filter": ("filter.yaml", read_filter),
    "mass properties": ("massprops.json", read_document),
    "scale": ("work/scale/scale.json", lambda path: read_scale(path.parents[2])),
    "a page's JSON": ("a.json", read_json),
    "picked points": ("points.csv", lambda path: read_named(path.parent)),
    "truth": ("truth/truth.yaml", lambda path: read_truth(path.parents[1])),
    "mesh": ("a.obj", read_mesh),
}


@pytest.mark.parametrize("name", READERS)
def test_a_text_is_read_or_refused_in_one_line(name: str, tmp_path: Path) -> None:
    where, read = READERS[name]
    (tmp_path / where).parent.mkdir(parents=True, exist_ok=True)

    @quickly
    @given(TEXTS | DOCUMENTS.map(json.dumps) | DOCUMENTS.map(yaml.safe_dump))
    def one(text: str) -> None:
        (tmp_path / where).write_text(text, encoding="utf-8", errors="replace")
        in_one_line(lambda: read(tmp_path / where))

    one()


@pytest.mark.parametrize("table", [TRACKS, GYROSCOPE, ATTITUDE, RANGE, ROTOR, STATE], ids=lambda t: t.header[:30])
def test_a_table_is_read_or_refused_in_one_line(table: Any, tmp_path: Path) -> None:
    @quickly
    @given(TEXTS, st.booleans())
    def one(text: str, headed: bool) -> None:
        (tmp_path / "data.csv").write_text(
            f"{table.header}\n{text}" if headed else text, encoding="utf-8", errors="replace"
        )
        in_one_line(lambda: read_table(tmp_path / "data.csv", table))

    one()


@quickly
@given(TEXTS, st.sampled_from(["object", "box"]))
def test_what_an_option_says_is_read_or_refused_in_one_line(text: str, option: str) -> None:
    in_one_line(lambda: parse_choice(option, text))
    in_one_line(lambda: parse_marker(text))
    for read in (_size, _distortion, _hidden):
        in_one_line(lambda read=read: read(text))  # type: ignore[misc]


@pytest.mark.parametrize("side", ["0", "-1", "nan", "inf", "1e999"])
def test_a_marker_has_a_side(side: str) -> None:
    with pytest.raises(InputError, match="sizes must be above 0"):
        parse_marker(f"4x4_50:{side}")


@quickly
@given(arrays(4, 500.0), st.text("abc .", max_size=8))
def test_a_box_comes_back_low_corner_first(four: np.ndarray, file: str) -> None:
    x, y = np.sort(four[:2]), np.sort(four[2:])
    value = f"{file}:{x[1]!r},{y[0]!r},{x[0]!r},{y[1]!r}".replace("np.float64(", "").replace(")", "")
    try:
        found = parse_choice("box", value)
    except InputError:
        assert min(x[1] - x[0], y[1] - y[0]) < 2
    else:
        assert found.numbers == (x[0], y[0], x[1], y[1]) and found.file == file and found.is_box


@quickly
@given(st.floats(1e-3, 1e3), st.integers(2, 20), st.integers(2, 20))
def test_a_board_comes_back(side: float, columns: int, rows: int) -> None:
    found = parse_marker(f"4x4_50:{columns}x{rows}:{side!r}")
    assert (found.dictionary, found.side_m, found.board) == ("DICT_4X4_50", side, (columns, rows))


@quickly
@given(DOCUMENTS)
def test_plain_documents_come_back(content: dict[str, Any]) -> None:
    assert parse_json(json_text(content), "it") == content
    back = parse_yaml(yaml.safe_dump(content, allow_unicode=True), "it")
    assert back.keys() == content.keys()


@quickly
@given(st.integers(2, 12), st.data())
def test_a_sequence_comes_back(tmp_path: Path, n: int, data: st.DataObject) -> None:
    stamps = np.arange(n, dtype=np.int64) * 10**8 + data.draw(st.integers(0, 10**15))
    q = np.stack([data.draw(turns()) for _ in range(n)])
    w, r = data.draw(arrays((n, 3), 5.0)), 1.0 + np.abs(data.draw(arrays(n, 100.0)))
    sequence = Sequence(
        rates=RateSeries(stamps, w, 0.01), range=RangeSeries(stamps, r, 0.5),
        attitude=AttitudeSeries(stamps, q, np.full(n, 1e-3)),
    )  # fmt: skip
    back = read_sequence(write_sequence(tmp_path / "s", sequence))
    assert back.rates is not None and back.range is not None and back.attitude is not None
    for series in (back.rates, back.range, back.attitude):
        np.testing.assert_array_equal(series.timestamp_ns, stamps)
    np.testing.assert_allclose(back.rates.w, w, rtol=1e-8)
    np.testing.assert_allclose(back.range.range_m, r, rtol=1e-8)
    assert np.abs(np.abs(np.sum(back.attitude.q * q, axis=1)) - 1.0).max() < 1e-8


@pytest.mark.parametrize("name", [name for name, effect in effects().items() if "mesh" not in effect.NEEDS])
def test_a_model_comes_back(name: str, tmp_path: Path) -> None:
    parameters = effects()[name].PARAMETERS

    @quickly
    @given(st.lists(st.floats(1e-6, 0.4), min_size=len(parameters), max_size=len(parameters)))
    def one(values: list[float]) -> None:
        model = model_of({name: np.array(values)})
        (tmp_path / "model.yaml").write_text(yaml.safe_dump(document_of(model)))
        back = load_model(tmp_path / "model.yaml")
        assert back.names == model.names
        np.testing.assert_array_equal(back.values[0], model.values[0])

    one()


@pytest.mark.parametrize("text", ["", "NAME = 1", "def torque(:", "raise SystemExit", "\0", "import no_such_module"])
def test_a_file_that_is_no_effect_is_refused_in_one_line(text: str, tmp_path: Path) -> None:
    """Each one starts a process, so few are tried."""
    (tmp_path / "effect.py").write_text(text)
    with pytest.raises(InputError) as said:
        read_effect(tmp_path / "effect.py")
    assert "\n" not in str(said.value)


@quickly
@given(st.floats(), numbers(-9.0, 9.0), st.floats(0.0, 9.0), st.booleans())
def test_a_number_is_taken_within_its_range_and_refused_beyond(
    value: float, low: float, span: float, open_end: bool
) -> None:
    field = (
        Number("of a test", "m", above=low, high=low + span)
        if open_end
        else Number("of a test", low=low, high=low + span)
    )
    inside = np.isfinite(value) and low <= value <= low + span and not (open_end and value == low)
    if inside:
        assert field.check(value) == value
    else:
        with pytest.raises(ValueError, match="must be"):
            field.check(value)
    assert f"{low + span:g}" in field.words()
