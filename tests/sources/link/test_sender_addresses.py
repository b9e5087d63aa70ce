"""To which address frames for a vehicle are sent."""

from __future__ import annotations

import pytest

from yawid.sources.link.inbox import Addresses

VEHICLE, FORGER, MOVED = (("127.0.0.1", port) for port in (1, 2, 3))
S = 1_000_000


def first_of(*heard: tuple[int, dict[tuple[str, int], bool]]) -> tuple[str, int] | None:
    """Return the first address of system 1 after what was heard: (time in us, trust by address)."""
    addresses = Addresses()
    for at_us, trust in heard:
        addresses.observe(
            {(1, address): is_trusted for address, is_trusted in trust.items()}, at_us
        )
    return addresses.first.get(1)


BOTH = {VEHICLE: True, FORGER: True}
FIVE_SECONDS = [(second * S, BOTH) for second in range(6)]


@pytest.mark.parametrize(
    ("later", "expected"),
    [((), VEHICLE), ((15 * S - 1,), VEHICLE), ((15 * S,), FORGER)],
)
def test_the_address_first_heard_from_stays_until_it_has_been_silent_for_ten_seconds(
    later: tuple[int, ...], expected: tuple[str, int]
) -> None:
    forged = [(at_us, {FORGER: True}) for at_us in (*range(6 * S, 15 * S - 1, S), *later)]
    assert first_of(*FIVE_SECONDS, *forged) == expected


FORGED = (0, {FORGER: False})
KNOWN = (1, {FORGER: False, VEHICLE: True})


@pytest.mark.parametrize(
    ("heard", "expected"),
    [
        ([FORGED], None),
        ([FORGED, KNOWN], VEHICLE),
        # At 9 s somebody forged the vehicle's address.
        ([FORGED, KNOWN, (9 * S, {VEHICLE: False}), (10 * S + 1, {MOVED: True})], MOVED),
    ],
)
def test_an_address_that_is_not_trusted_is_never_sent_to_and_keeps_no_place(
    heard: list[tuple[int, dict[tuple[str, int], bool]]], expected: tuple[str, int] | None
) -> None:
    assert first_of(*heard) == expected
