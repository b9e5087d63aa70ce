"""Who sends from where, and what is odd about it."""

from __future__ import annotations

import pickle

from yawid.sources.link.inbox import Addresses


def test_a_sender_that_moves_to_another_port_is_not_called_a_second_one() -> None:
    addresses = Addresses()
    old, new = ("127.0.0.1", 1), ("127.0.0.1", 2)
    assert addresses.observe({(1, old)}, 0) == []
    assert addresses.observe({(1, new)}, 6_000_000) == []
    assert addresses.latest == {1: new}
    [line] = addresses.observe({(1, old)}, 7_000_000)
    assert "127.0.0.1:1 and 127.0.0.1:2" in line or "127.0.0.1:2 and 127.0.0.1:1" in line


def test_a_flood_from_ever_new_ports_is_told_once_and_not_remembered() -> None:
    addresses = Addresses()
    lines = [addresses.observe({(1, ("127.0.0.1", port))}, 10 * port) for port in range(60_000)]
    assert sum(map(len, lines)) == 1
    assert addresses.latest == {1: ("127.0.0.1", 59_999)}
    assert len(pickle.dumps(addresses)) < 1000
