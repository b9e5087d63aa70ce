"""Faults of stamps, clocks and bytes in a good log, and what must come of each.

Each docstring tells the result expected, field by field; ``same`` and ``near`` see fault_injection.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from fault_injection import (
    MIDDLE_S,
    assert_near,
    assert_refused,
    assert_same,
    clean,
    dutch_roll,
    good,
    shifted,
    with_others,
)
from flights.surgery import Encoder, Record, join, nonsense, rewrite, sender, without, wrong_crc
from pymavlink.dialects.v20 import ardupilotmega as mavlink


def test_the_clean_run_lacks_nothing_and_is_known_to_a_few_percent():
    assert "verdict" not in clean()
    for method in ("els", "rml"):
        wn, _, wn_std, zeta_std = dutch_roll(clean(), method)
        assert wn_std < 0.03 * wn
        assert zeta_std < 0.03


def test_twenty_six_frames_on_one_stamp():
    """theta, reasons: same; link.lost: 0. Stamps are no sample times."""
    records = good()
    bursts = [(records[26 * (i // 26)][0], r[1]) for i, r in enumerate(records)]

    assert assert_same(join(bursts))["link"]["lost"] == 0


@pytest.mark.parametrize("factor", [5, 25, 0.2])
def test_a_log_recorded_faster_or_slower_than_life(factor: float):
    """theta, reasons: same; duration_s: of the stamps. A simulator's speed-up is no rate."""
    first = good()[0][0]
    found = assert_same(join((first + int((t - first) / factor), f) for t, f in good()))

    assert found["duration_s"] == pytest.approx(clean()["duration_s"] / factor)


@pytest.mark.parametrize("base", [0, 1_000_000, 2**50])
def test_stamps_of_no_sensible_year(base: int):
    """theta, reasons: same. A recorder without a clock of its own."""
    first = good()[0][0]

    assert_same(join((base + t - first, f) for t, f in good()))


def test_stamps_that_step_back_by_an_hour_and_forward_again():
    """theta, reasons: same. The recorder's clock was set."""
    third = len(good()) // 3
    steps = [0] * third + [-3_600_000_000] * third + [0] * len(good())

    assert_same(join((t + s, f) for (t, f), s in zip(good(), steps, strict=False)))


def test_mavproxys_link_number_in_the_stamps_low_bits():
    """theta, reasons: same."""
    assert_same(join((t & ~3 | i % 4, f) for i, (t, f) in enumerate(good())))


def test_the_servo_clock_wraps_while_boot_time_goes_on():
    """theta: near; link.reboots, clock_steps, gaps: 0; updates: as clean."""
    found = assert_near(shifted(2**32 // 1_000_000 - MIDDLE_S))

    assert [found["link"][name] for name in ("reboots", "clock_steps", "gaps")] == [0, 0, 0]
    assert found["estimates"]["els"]["updates"] == clean()["estimates"]["els"]["updates"]


def test_a_reboot_that_nobody_announces():
    """theta: near; link.reboots: 1; held: one break more."""
    found = assert_near(shifted(-85.0, start_s=MIDDLE_S))

    assert found["link"]["reboots"] == 1
    assert found["estimates"]["els"]["held"] > clean()["estimates"]["els"]["held"]


def test_a_clock_that_steps_back_by_more_than_a_second_has_not_rebooted():
    """theta: near; link.reboots: 0; link.clock_steps: 1."""
    found = assert_near(shifted(-1.4, start_s=MIDDLE_S))

    assert (found["link"]["reboots"], found["link"]["clock_steps"]) == (0, 1)


@pytest.mark.parametrize("step_s", [-0.003, -0.04, -0.3])
def test_a_small_step_back_is_no_reboot(step_s: float):
    """theta: near; link.reboots, clock_steps: 0."""
    found = assert_near(shifted(step_s, start_s=MIDDLE_S))

    assert (found["link"]["reboots"], found["link"]["clock_steps"]) == (0, 0)


def test_frames_that_overtake_each_other():
    """theta: near; link.reboots, clock_steps: 0."""
    rng = np.random.default_rng(1)
    order = np.argsort(np.arange(len(good())) + rng.integers(0, 8, len(good())), kind="stable")
    stamps = [stamp for stamp, _ in good()]
    found = assert_near(join((t, good()[i][1]) for t, i in zip(stamps, order, strict=True)))

    assert (found["link"]["reboots"], found["link"]["clock_steps"]) == (0, 0)


def test_a_boot_clock_that_jumps_ahead_by_447_seconds():
    """theta: near; link.clock_steps: 1; link.reboots, gaps: 0; updates not above clean."""
    found = assert_near(shifted(447.0, start_s=MIDDLE_S))

    assert [found["link"][name] for name in ("reboots", "gaps", "clock_steps")] == [0, 0, 1]
    assert found["estimates"]["els"]["updates"] <= clean()["estimates"]["els"]["updates"]


def test_lost_packets():
    """theta: near; link.lost: those of the vehicle, none of the ground station's.

    In one silence no more than the sequence can tell: 128 frames.
    """
    rng = np.random.default_rng(2)
    kept = [r for r in good() if rng.random() > 0.05]
    kept = [*good()[:300], *without(kept[300:], 40.0, 41.0), good()[-1]]
    arrived = set(kept)
    missing = [record for record in good() if record not in arrived]
    found = assert_near(join(kept))

    assert found["link"]["lost"] == sum(sender(frame) == (1, 1) for _, frame in missing)


def test_every_frame_twice():
    """theta, reasons: same; link.lost: 0. Two links carry the vehicle."""
    assert assert_same(join(r for r in good() for _ in range(2)))["link"]["lost"] == 0


def as_v1(which: Callable[[int], bool]) -> list[Record]:
    reader, encoder = mavlink.MAVLink(None), mavlink.MAVLink(None, 1, 1)
    records = []
    for i, (stamp, frame) in enumerate(good()):
        if which(i) and sender(frame) == (1, 1):
            message = reader.decode(bytearray(frame))
            encoder.seq = message.get_seq()
            frame = bytes(message.pack(encoder, force_mavlink1=True))
        records.append((stamp, frame))
    return records


@pytest.mark.parametrize("every", [2, 3])
def test_both_versions_of_mavlink_mixed(every: int):
    """theta, reasons: same; link.frames: as clean."""
    found = assert_same(join(as_v1(lambda i: i % every == 0)))

    assert found["link"]["frames"] == clean()["link"]["frames"]


def test_single_signed_frames_in_a_log_of_version_1():
    """theta, reasons: same; link.frames: as clean; unsigned_rejected: 0 (no key was given)."""
    records, signed = as_v1(lambda i: True), rewrite(good(), key=bytes(32))
    mixed = [s if i % 97 == 0 else r for i, (r, s) in enumerate(zip(records, signed, strict=True))]
    found = assert_same(join(mixed))

    assert found["link"]["frames"] == clean()["link"]["frames"]
    assert found["link"]["unsigned_rejected"] == 0


def test_a_known_message_whose_crc_never_fits():
    """theta, reasons: same; link.bad_crc: so many. The dialects drifted apart."""
    drifted = mavlink.MAVLink_wind_message(3.0, 2.0, 0.1)
    frame = wrong_crc(Encoder().frame(drifted, (1, 1)))
    log = join(x for r in good() for x in ([r, (r[0], frame)] if r[0] % 9 == 0 else [r]))
    count = sum(r[0] % 9 == 0 for r in good())

    assert assert_same(log)["link"]["bad_crc"] == count


def test_frames_of_ids_that_nobody_knows():
    """theta, reasons: same; link.frames: as clean, or more by what looks whole."""
    rng = np.random.default_rng(3)
    log = join(x for r in good() for x in ([r, (r[0], nonsense(rng))] if r[0] % 9 == 0 else [r]))

    assert assert_same(log)["link"]["frames"] >= clean()["link"]["frames"]


def test_an_attitude_that_travels_inside_another_message():
    """theta, reasons: same. A frame in a TUNNEL's payload is not the vehicle's word."""
    wrong = Encoder().frame(mavlink.MAVLink_attitude_message(95_000, 0, 0, 0, 0, 0, 9.0))
    payload = list(bytes(8) + wrong) + [0] * 128
    message = mavlink.MAVLink_tunnel_message(0, 0, 0x8001, 60, payload[:128])

    assert_same(with_others([(40, message, (1, 1))]))


def test_line_ends_that_were_translated():
    """theta: near; link.skipped_bytes: > 0; frames: fewer. Every 0A became 0D 0A."""
    days_us = 100 * 86_400_000_000
    log = join((t - days_us, f) for t, f in good())
    found = assert_near(log.replace(b"\n", b"\r\n"))

    assert found["link"]["skipped_bytes"] > 0
    assert found["link"]["frames"] < clean()["link"]["frames"]


def test_line_ends_that_were_translated_in_every_stamp():
    """verdict: no_vehicle; link.frames: 0. For weeks at a time a high byte of the stamp is 0A."""
    assert b"\n" in good()[0][0].to_bytes(8, "big")[:4]

    found = assert_refused(join(good()).replace(b"\n", b"\r\n"), "no_vehicle")

    assert found["link"]["frames"] == 0


@pytest.mark.parametrize("size", [1, 7, 31])
def test_the_last_frame_is_torn(size: int):
    """theta: near; link.frames: one less."""
    found = assert_near(join(good())[:-size])

    assert found["link"]["frames"] == clean()["link"]["frames"] - 1


@pytest.mark.parametrize("size", [1, 8, 300, 100_000])
def test_garbage_at_the_very_start(size: int):
    """theta, reasons: same; link.frames: as clean; link.skipped_bytes: the garbage."""
    found = assert_same(np.random.default_rng(4).bytes(size) + join(good()))

    assert found["link"]["frames"] == clean()["link"]["frames"]
    assert found["link"]["skipped_bytes"] == size


def test_garbage_between_the_records():
    """theta, reasons: same; link.frames: as clean."""
    rng = np.random.default_rng(5)
    parts = [join([r]) + (rng.bytes(17) if i % 50 == 0 else b"") for i, r in enumerate(good())]

    assert assert_same(b"".join(parts))["link"]["frames"] == clean()["link"]["frames"]
