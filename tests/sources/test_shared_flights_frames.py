"""The recorded flights: every frame of every sender, against pymavlink's own parser."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from places import SHARED_FLIGHTS as FLIGHTS
from pymavlink.dialects.v20 import ardupilotmega as dialect
from recorded_flights import recorded
from sources.tlog_records import ALL_NAMES, decode, run

SHARED = pytest.mark.skipif(not FLIGHTS.is_dir(), reason="the recorded flights are not here")


def walked(data: bytes) -> Counter[str]:
    """Count messages by pymavlink's decoder, walking from frame to frame.

    pymavlink's own log reader loses good frames where versions mix: it is no oracle.
    """
    counts: Counter[str] = Counter()
    at = 8
    while at + 8 < len(data):
        size = data[at + 1] + (8 if data[at] == 0xFE else 12 + 13 * (data[at + 2] & 1))
        try:
            msg = decode(data[at : at + size])
        except dialect.MAVError:
            msg = None
        if msg is not None and msg.get_type() in ALL_NAMES:
            counts[msg.get_type()] += 1
        at += size + 8
    return counts


@recorded(
    "alfa_carbonz_engine_failure", "vtol_quadplane", "sitl_fbwa_gcs_4hz", "sitl_auto_mavproxy_4hz"
)
def test_every_message_type_is_found_as_often_as_pymavlink_finds_it(log: Path) -> None:
    data = log.read_bytes()
    blocks, decoder = run(data, cuts=[100_000, 100_001, 654_321])
    link, found = decoder.link, Counter[str]()
    for block in blocks:
        found.update({key: len(messages) for key, messages in block.messages.items()})
    assert found == walked(data)
    assert link.frames == sum(link.senders.values())
    assert (link.bad_crc, link.unknown, link.duplicates, link.signed) == (0, 0, 0, 0)
    assert link.skipped_bytes == 0


@SHARED
def test_the_copter_has_its_torn_frame_its_radio_and_its_losses() -> None:
    _, decoder = run((FLIGHTS / "copter_sik_radio.tlog").read_bytes())
    link = decoder.link
    assert link.skipped_bytes == 31
    assert link.senders[51, 68] > 0
    in_a_jump = 144  # over 128, in the time that so many frames take
    assert link.by_sender[1, 1].lost == 2856 + in_a_jump
    assert link.lost == 3000 + link.by_sender[51, 68].lost < 3200
