"""Who sends from where, and what is odd about it."""

from __future__ import annotations

import pickle

from yawid.sources.link.inbox import Addresses


def test_a_sender_that_moves_to_another_port_is_not_called_a_second_one() -> None:
    addresses = Addresses()
    old, new = ("127.0.0.1", 1), ("127.0.0.1", 2)
    assert addresses.observe({(1, old): True}, 0) == []
    assert addresses.observe({(1, new): True}, 6_000_000) == []
    [line] = addresses.observe({(1, old): True}, 7_000_000)
    assert "127.0.0.1:1 and 127.0.0.1:2" in line or "127.0.0.1:2 and 127.0.0.1:1" in line


def test_a_flood_from_ever_new_ports_is_told_once_and_not_remembered() -> None:
    addresses = Addresses()
    lines = [
        addresses.observe({(1, ("127.0.0.1", port)): True}, 10 * port) for port in range(60_000)
    ]
    assert sum(map(len, lines)) == 1
    assert addresses.first == {1: ("127.0.0.1", 0)}
    assert len(pickle.dumps(addresses)) < 1000


def test_the_address_first_heard_from_stays_until_it_has_been_silent_for_ten_seconds() -> None:
    addresses = Addresses()
    vehicle, forger = ("127.0.0.1", 1), ("127.0.0.1", 2)
    addresses.observe({(1, vehicle): True, (1, forger): True}, 0)
    for second in range(1, 6):
        addresses.observe({(1, forger): True, (1, vehicle): True}, 1_000_000 * second)
        assert addresses.first == {1: vehicle}
    addresses.observe({(1, forger): True}, 14_999_999)
    assert addresses.first == {1: vehicle}
    addresses.observe({(1, forger): True}, 15_000_000)
    assert addresses.first == {1: forger}


def test_who_is_not_trusted_is_never_sent_to_and_keeps_nobody_s_place() -> None:
    addresses = Addresses()
    vehicle, forger, moved = (("127.0.0.1", port) for port in (1, 2, 3))
    addresses.observe({(1, forger): False}, 0)
    assert addresses.first == {}
    addresses.observe({(1, forger): False, (1, vehicle): True}, 1)
    assert addresses.first == {1: vehicle}
    addresses.observe({(1, vehicle): False}, 9_000_000)  # forged with the vehicle's address
    addresses.observe({(1, forger): False, (1, moved): True}, 10_000_001)
    assert addresses.first == {1: moved}
