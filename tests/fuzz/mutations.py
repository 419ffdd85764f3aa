"""Mutations of a file, drawn by hypothesis: bytes, tokens, lines and cells, with values that readers trip over."""

from __future__ import annotations

import re

from hypothesis import strategies as st

NUMBERS = [
    b"0", b"-1", b"1e999", b"-1e-300", b"1e-300", b"1e300", b"nan", b"inf", b"-.inf", b".nan", b"9" * 400, b"9" * 5000,
    b"2147483648", b"9223372036854775807", b"18446744073709551616", b"1700000000000000000", b"0.5", b"1e400", b"-0",
]  # fmt: skip
TOKENS = [
    *NUMBERS, b"", b"null", b"~", b"true", b"[]", b"{}", b"[1, 2]", b"[[[[1]]]]", b"{a: 1}", b"2024-01-01", b"&x [*x, *x]",
    b"!!python/name:os.system", b"!!binary aGVsbG8=", b"*x", b"'", b'"', b"\x00", b"\x1b[31m", b"\xff\xfe", b"\xef\xbb\xbf",
    b"\r\n", b"\t", b";", b",", b"#", b"-", b": ", b"../../../etc/passwd", b"/dev/zero", "ü°\u202e".encode(), b"x" * 3000,
    b"[deg s^-1]", b"[us]", b"[furlong]", b"<<: [1]", b"1.#QNAN", b"-1.#IND",
]  # fmt: skip
TOKEN = re.compile(rb"[-+]?\d[\w.+-]*|[A-Za-z_]\w*")


def _at_token(data: bytes, where: int, value: bytes) -> bytes:
    found = list(TOKEN.finditer(data[:20_000]))
    if not found:
        return data + value
    chosen = found[where % len(found)]
    return data[: chosen.start()] + value + data[chosen.end() :]


def _at_line(data: bytes, where: int, kind: int) -> bytes:
    lines = data.split(b"\n")
    i, j = where % len(lines), (where * 7919 + 1) % len(lines)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    elif kind == 2:
        lines[i], lines[j] = lines[j], lines[i]
    else:
        cells = lines[i].split(b",")
        lines[i] = b",".join(cells[::-1] if kind == 3 else cells[: max(1, len(cells) - 1)])
    return b"\n".join(lines)


@st.composite
def mutated(draw: st.DrawFn, seeds: list[bytes]) -> bytes:
    """One of the seeds after one to four mutations."""
    data = draw(st.sampled_from(seeds))
    for _ in range(draw(st.integers(1, 4))):
        kind, where = draw(st.integers(0, 6)), draw(st.integers(0, 100_000))
        if kind <= 2:
            data = _at_token(data, where, draw(st.sampled_from(NUMBERS if kind == 0 else TOKENS)))
        elif kind == 3:
            data = _at_line(data, where, draw(st.integers(0, 4)))
        elif kind == 4:
            at = where % (len(data) + 1)
            data = data[:at] if draw(st.booleans()) else data[at:]
        elif kind == 5:
            at = where % (len(data) + 1)
            data = data[:at] + draw(st.sampled_from(TOKENS)) + data[at:]
        elif data:
            at = where % min(len(data), 200 if draw(st.booleans()) else len(data))
            data = data[:at] + bytes([draw(st.integers(0, 255))]) + data[at + 1 :]
    return data
