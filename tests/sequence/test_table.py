"""A table is read as its header says, whatever order and units that is; what is not understood is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from massprops.documents.tables import ATTITUDE, GYROSCOPE, RANGE, TRACKS
from massprops.errors import InputError
from massprops.sequence.table import check_times, read_table

NS = np.array([1_000_000_000, 1_500_000_000], np.int64)


def write(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "data.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    ("text", "scale"),
    [
        ("#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1]\n1000000000,1,2,3\n1500000000,4,5,6\n", 1.0),
        ("#timestamp [us],w_x [deg s^-1],w_y [deg/s],w_z [deg*s^-1]\n1000000,1,2,3\n1500000,4,5,6\n", np.pi / 180),
        ("#timestamp [s],w_x [mrad s^-1],w_y [mrad/s],w_z [mrad s-1]\n1.0,1,2,3\n1.5,4,5,6\n", 1e-3),
        ("\n\n#timestamp [ms],w_z [rpm],w_x [rpm],w_y [rpm]\n1000,3,1,2\n1500,6,4,5\n", np.pi / 30),
        ("# made by hand\n#w_z,timestamp,w_y,extra,w_x\n3,1000000000,2,x,1\n6,1500000000,5,x,4\n", 1.0),
        ("timestamp;w_x;w_y;w_z\r\n1000000000;1;2;3\r\n1500000000;4;5;6\r\n", 1.0),
        ("#timestamp [ns]\tw_x\tw_y\tw_z\n1000000000\t1\t2\t3\n1500000000\t4\t5\t6\n", 1.0),
        (
            "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2]\n"
            "1000000000,1,2,3,9\n1500000000,4,5,6,9\n",
            1.0,
        ),
        ("1000000000,1,2,3\n1500000000,4,5,6\n", 1.0),
        (b"\xef\xbb\xbf#timestamp [ns],w_x,w_y,w_z\n1000000000,1,2,3\n1500000000,4,5,6\n", 1.0),
        ('"#timestamp [ns]","w_x","w_y","w_z"\n1000000000,1,2,3\n1500000000,4,5,6\n', 1.0),
    ],
)
def test_header_says_where_columns_are_and_in_what_unit(tmp_path: Path, text: str | bytes, scale: float) -> None:
    rows = read_table(write(tmp_path, text), GYROSCOPE)
    assert rows.columns["timestamp"].tolist() == NS.tolist() and rows.left_out == 0
    values = np.column_stack([rows.columns[f"w_{a}"] for a in "xyz"])
    assert np.allclose(values, scale * np.array([[1, 2, 3], [4, 5, 6]]), rtol=1e-12)


def test_seconds_keep_their_nanoseconds(tmp_path: Path) -> None:
    rows = read_table(write(tmp_path, "#timestamp [s],range [mm]\n1403636579.763555584,1500\n"), RANGE)
    assert rows.columns["timestamp"].tolist() == [1403636579763555584] and rows.columns["range"].tolist() == [1.5]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("#timestamp [ns],range [furlong]\n1,2\n", r"range: unit \[furlong\] is not known; give it in \[m\]"),
        ("#timestamp [fortnight],range [m]\n1,2\n", "unit .fortnight. is not known"),
        ("#timestamp [ns],range [rad]\n1,2\n", "unit .rad. is not known"),
        ("#timestamp [ns],distance [m]\n1,2\n", "no column range"),
        ("#timestamp,range,range\n1,2,3\n", "names the column range 2 times"),
        ("#timestamp,range\n1,2\n#timestamp,range\n", "line 3: a second header"),
        ("#timestamp,range\n1,x\n2,\n", "none of its 2 rows can be read; the first is line 2"),
        ("range\n1\n", "no column timestamp"),
        ("#timestamp,\x1b]0;evil\x07\n1,2\n", "no column range; it has timestamp, .]0;evil."),
        ("#timestamp,range\n1," + "2" * 200_000, "more than 100000 characters"),
        ("#timestamp [ns],range [m]\n1,2\n".encode("utf-16"), "UTF-16"),
    ],
)
def test_what_is_not_understood_is_one_line(tmp_path: Path, text: str | bytes, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        read_table(write(tmp_path, text), RANGE)
    assert "\x1b" not in str(caught.value) and "\n" not in str(caught.value) and len(str(caught.value)) < 400


def test_every_documented_header_is_read(tmp_path: Path) -> None:
    for table in (TRACKS, RANGE, GYROSCOPE, ATTITUDE):
        path = write(tmp_path, table.header + "\n" + ",".join(["1"] * len(table.columns)) + "\n")
        assert {k: v.tolist() for k, v in read_table(path, table).columns.items()} == dict.fromkeys(table.names, [1])


def test_a_row_on_another_clock_is_named(tmp_path: Path) -> None:
    stamps = np.arange(100, dtype=np.int64) * 10**8
    for odd, line in ((1_700_000_000 * 10**9, 102), (-(4 * 10**18), 2)):
        stamp = np.sort(np.append(stamps, odd))
        with pytest.raises(InputError, match=f"line {line}: its time is .* from the other rows"):
            check_times(tmp_path, stamp, np.arange(2, 103))
    check_times(tmp_path, stamps, np.arange(2, 102))
    with pytest.raises(InputError, match="1e?[+0-9]* ns apart: give timestamps in nanoseconds"):
        check_times(tmp_path, stamps // 10**8, np.arange(2, 102))
    # bursts, minutes apart, of one record
    check_times(tmp_path, np.concatenate([stamps, stamps + 600 * 10**9]), np.arange(2, 202))


def test_memory_is_counted_before_it_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, "#timestamp,range\n" + "1000000000,2\n" * 1000)
    monkeypatch.setattr("massprops.memory.machine_bytes", lambda: 10_000)
    with pytest.raises(InputError, match="rows would take .* GB of memory"):
        read_table(path, RANGE)
