"""What a link carried, counted per sender."""

from __future__ import annotations

from typing import Any

import pytest
from sources.tlog_records import BY_NAME, START_US, message, pack, record, run, sender

from yawid.quantities.link import LinkStats


def heartbeat(kind: int) -> Any:
    return BY_NAME["HEARTBEAT"](kind, 3, 0, 0, 4, 3)


def stats(frames: list[bytes]) -> LinkStats:
    _, decoder = run(b"".join(record(START_US + i, frame) for i, frame in enumerate(frames)))
    return decoder.link


def beats(seqs: list[int], sysid: int = 1, compid: int = 1, kind: int = 1) -> list[bytes]:
    link = sender(sysid, compid)
    return [pack(heartbeat(kind), link, seq=seq) for seq in seqs]


RADIO = beats([90, 91, 95], sysid=51, compid=68, kind=0)
VIBRATION = pack(message(BY_NAME["VIBRATION"], b"\x01"), sender(), seq=1)


@pytest.mark.parametrize(
    ("frames", "lost"),
    [
        (beats([0, 1, 2, 3]), 0),
        (beats([254, 255, 0, 1]), 0),
        (beats([5, 7, 8, 11]), 3),
        (beats([250, 4]), 9),
        (beats([10, 138]), 127),
        (beats([10, 139]), 0),  # more than 127 missing is a restart
        (beats([200, 0, 1]), 55),
        (beats([3, 3, 4]), 0),  # a duplicate
        (beats([3, 5, 4, 6]), 0),  # one that came late
        (beats([3, 8, 4, 6, 9]), 2),  # two of four came late
        # A restart by a few, not twenty that came late.
        (beats([*range(60), *range(40, 60)]), 0),
        # Each sender has its own sequence, those of ground stations do not count.
        ([RADIO[0], *beats([0, 1]), RADIO[1], *beats([3]), RADIO[2]], 1 + 3),
        ([*beats([0, 10, 50], 255, 190, 0), *beats([0, 2])], 1),
        ([*beats([0, 10, 50], 254, 190, 6), *beats([0, 2])], 1),
        ([*beats([0]), VIBRATION, *beats([2])], 0),  # though it is not wanted
    ],
)
def test_losses_are_gaps_of_the_sequence_of_each_sender(frames: list[bytes], lost: int) -> None:
    link = stats(frames)
    assert link.lost == lost
    assert sum(link.senders.values()) == link.frames
    assert (link.first_us, link.last_us) == (START_US, START_US + len(frames) - 1)


@pytest.mark.parametrize("cuts", [[], [400], list(range(100, 9000, 100))])
@pytest.mark.parametrize(
    ("skipped", "slowly", "lost"),
    [
        ((155, 196, 153), 1.0, 155 + 196 + 153),  # each takes as long as its frames would have
        ((155, 196, 153), 1.8, 155 + 196 + 153),
        ((155, 196, 153), 0.2, 0),  # too short for so many: the sender started again
        ((155, 196, 153), 3.0, 0),  # too long
        ((100, 155), 1.0, 255),
        ((235, 100), 1.0, 100),  # a step of 236 is one back by 20
    ],
)
def test_a_jump_is_a_loss_if_it_took_as_long_as_the_frames(
    skipped: tuple[int, ...], slowly: float, lost: int, cuts: list[int]
) -> None:
    """Frames every 2 ms, 70 between two losses."""
    seq, at_us, data = 0, START_US, b""
    link = sender(1, 1)
    for missing in (*skipped, 0):
        for _ in range(70):
            beat = BY_NAME["HEARTBEAT"](1, 3, 0, seq, 4, 3)  # no two are the same to the byte
            data += record(at_us, pack(beat, link, seq=seq % 256))
            seq, at_us = seq + 1, at_us + 2000
        seq, at_us = seq + missing, at_us + round(2000 * missing * slowly)

    _, decoder = run(data, cuts=cuts)
    assert decoder.link.lost == lost


def test_damaged_and_unknown_frames_count_for_the_sender_they_name_if_it_was_ever_heard() -> None:
    def damaged(frame: bytes) -> bytes:
        return frame[:-1] + bytes([frame[-1] ^ 1])

    def unknown(frame: bytes) -> bytes:
        return frame[:7] + b"\xff\xff\xff" + frame[10:]

    vehicle, radio = beats([0, 1, 2, 3]), beats([0, 1], sysid=51, compid=68, kind=0)
    old = [pack(heartbeat(1), sender(7, 2), seq=i, v1=True) for i in range(3)]
    noise = unknown(beats([0], sysid=99, compid=9)[0])
    passed = [damaged(vehicle[1]), damaged(vehicle[2]), unknown(radio[1]), damaged(old[1]), noise]
    intact = [vehicle[0], radio[0], old[0], vehicle[3], old[2], vehicle[3]]
    frames = [f for pair in zip(intact[:5], passed, strict=True) for f in pair] + intact[5:]

    link = stats([*frames, *[pack(heartbeat(1), sender(7, 2, signed=True), seq=3)] * 2])

    counted = {key: (s.frames, s.bad_crc, s.unknown) for key, s in link.by_sender.items()}
    assert counted == {(1, 1): (3, 2, 0), (51, 68): (1, 0, 1), (7, 2): (4, 1, 0)}
    assert (link.bad_crc, link.unknown, link.skipped_bytes, link.signed) == (3, 2, 0, 2)
