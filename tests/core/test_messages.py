"""Messages over a pipe: whole, in their order, and an end of waiting that says why."""

from __future__ import annotations

import os
from typing import Any

import pytest
from drawn import quickly
from hypothesis import given
from hypothesis import strategies as st

from massprops.core.messages import Listener, Silence, sayer

MESSAGES = st.lists(
    st.dictionaries(st.text(max_size=5), st.text(max_size=20) | st.integers() | st.lists(st.booleans(), max_size=3)),
    max_size=6,
)


@quickly
@given(MESSAGES)
def test_messages_come_whole_and_in_their_order(messages: list[dict[str, Any]]) -> None:
    read, write = os.pipe()
    say, listener = sayer(os.dup(write)), Listener(read)
    for message in messages:
        say(message)
    assert [listener.next(1.0) for _ in messages] == messages
    os.close(write)
    del say
    with pytest.raises(Silence, match="ended"):
        listener.next(1.0)
    os.close(read)


def test_a_message_in_pieces_is_waited_for_and_an_end_of_waiting_says_why() -> None:
    read, write = os.pipe()
    listener = Listener(read)
    os.write(write, b'{"a"')
    with pytest.raises(Silence, match="time"):
        listener.next(0.01)
    with pytest.raises(Silence, match="memory"):
        listener.next(None, lambda: "memory", 0.001)
    os.write(write, b': 1}\n{"b": 2}\n')
    assert listener.next(1.0) == {"a": 1} and listener.next() == {"b": 2}
    os.close(write)
    os.close(read)
