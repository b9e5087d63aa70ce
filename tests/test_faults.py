"""Faults in a good log: each oddity of real logs injected, and what must come of it.

The good log is JSBSim's C172P of replay_logs/c172p_3211. Each docstring tells the result expected,
field by field; ``same`` means the very numbers of the clean run, ``near`` that wn and zeta of ELS
and RML lie within three sigma of them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from log_surgery import (
    Encoder,
    Record,
    after,
    join,
    message_id,
    nonsense,
    rewrite,
    sender,
    split,
    without,
    wrong_crc,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.pipeline import Pipeline
from yawid.run_config import RunConfig
from yawid.summary import summarise

CASE = Path(__file__).parents[1] / "replay_logs" / "c172p_3211"
Summary = dict[str, Any]
MIDDLE_S = 90.0  # vehicle time; the flight lasts from 30 s to 150 s
EVERYTHING_READ = ("ATTITUDE", "SERVO_OUTPUT_RAW", "VFR_HUD", "HEARTBEAT", "PARAM_VALUE")


def run(log: bytes, **settings: Any) -> Summary:
    pipeline = Pipeline(RunConfig(**({"rate": 10.0, "forgetting": 1.0} | settings)))
    for at in range(0, len(log), 1 << 16):
        pipeline.feed(log[at : at + (1 << 16)])
    pipeline.finish()
    summary, _ = summarise(pipeline, "log.tlog", "")
    return summary


@functools.cache
def good() -> tuple[Record, ...]:
    return tuple(split((CASE / "log.tlog").read_bytes()))


@functools.cache
def clean() -> Summary:
    return run(join(good()))


def dutch_roll(summary: Summary, method: str) -> np.ndarray:
    found = summary["estimates"][method]["dutch_roll"]
    return np.array([found[name] for name in ("wn_rad_s", "zeta", "wn_std", "zeta_std")])


def assert_same(log: bytes) -> Summary:
    found = run(log)
    for method in ("els", "rml"):
        assert found["estimates"][method]["theta"] == clean()["estimates"][method]["theta"]
    assert found["verdict"] == clean()["verdict"]
    return found


def assert_near(log: bytes, **settings: Any) -> Summary:
    found = run(log, **settings)
    for method in ("els", "rml"):
        expected, actual = dutch_roll(clean(), method), dutch_roll(found, method)
        sigmas = np.abs(actual - expected)[:2] / expected[2:]
        assert (sigmas <= 3.0).all(), (method, sigmas, actual, expected)
    assert found["verdict"]["usable"]
    return found


def assert_refused(log: bytes, reason: str, code_order: int = 0, **settings: Any) -> Summary:
    found = run(log, **settings)
    assert not found["verdict"]["usable"]
    fatal = [r["id"] for r in found["verdict"]["reasons"] if r["weight"] == "fatal"]
    assert fatal[code_order] == reason
    return found


def changed(change: Callable[[Any], Any], *, start_s: float = 0.0) -> bytes:
    """Return the good log with ``change`` done to the vehicle's messages from a time on."""
    boot_s = [0.0]

    def one(message: Any) -> list[Any]:
        if message.get_type() == "ATTITUDE":
            boot_s[0] = message.time_boot_ms / 1000
        if message.get_srcSystem() == 1 and boot_s[0] >= start_s:
            change(message)
        return [message]

    return join(rewrite(good(), one))


def shifted(seconds: float, start_s: float = 0.0) -> bytes:
    """Return the good log with the vehicle's clock moved from a time on, servo time in 32 bits."""

    def shift(message: Any) -> None:
        if hasattr(message, "time_boot_ms"):
            message.time_boot_ms += round(1000 * seconds)
        elif hasattr(message, "time_usec"):
            message.time_usec = (message.time_usec + round(1e6 * seconds)) % 2**32

    return changed(shift, start_s=start_s)


def with_others(messages: Iterable[tuple[int, Any, tuple[int, int]]]) -> bytes:
    """Return the good log with (every so many records, message, sender ids) among its records."""
    encoder, records = Encoder(), []
    for i, record in enumerate(good()):
        for every, message, ids in messages:
            if i % every == 0:
                records.append((record[0], encoder.frame(message, ids)))
        records.append(record)
    return join(records)


def test_the_clean_run_is_usable_and_known_to_a_few_percent():
    assert clean()["verdict"]["usable"]
    for method in ("els", "rml"):
        wn, _, wn_std, zeta_std = dutch_roll(clean(), method)
        assert wn_std < 0.03 * wn
        assert zeta_std < 0.03


def test_twenty_six_frames_on_one_stamp():
    """theta, verdict: same; link.lost: 0. Stamps are no sample times."""
    records = good()
    bursts = [(records[26 * (i // 26)][0], r[1]) for i, r in enumerate(records)]

    assert assert_same(join(bursts))["link"]["lost"] == 0


@pytest.mark.parametrize("factor", [5, 25, 0.2])
def test_a_log_recorded_faster_or_slower_than_life(factor: float):
    """theta, verdict: same; duration_s: of the stamps. A simulator's speed-up is no rate."""
    first = good()[0][0]
    found = assert_same(join((first + int((t - first) / factor), f) for t, f in good()))

    assert found["duration_s"] == pytest.approx(clean()["duration_s"] / factor)


@pytest.mark.parametrize("base", [0, 1_000_000, 2**50])
def test_stamps_of_no_sensible_year(base: int):
    """theta, verdict: same. A recorder without a clock of its own."""
    first = good()[0][0]

    assert_same(join((base + t - first, f) for t, f in good()))


def test_stamps_that_step_back_by_an_hour_and_forward_again():
    """theta, verdict: same. The recorder's clock was set."""
    third = len(good()) // 3
    steps = [0] * third + [-3_600_000_000] * third + [0] * len(good())

    assert_same(join((t + s, f) for (t, f), s in zip(good(), steps, strict=False)))


def test_mavproxys_link_number_in_the_stamps_low_bits():
    """theta, verdict: same."""
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
    """theta: near; link.gaps: 1; link.reboots: 0; nothing is filled in: updates not above clean."""
    found = assert_near(shifted(447.0, start_s=MIDDLE_S))

    assert (found["link"]["reboots"], found["link"]["gaps"]) == (0, 1)
    assert found["estimates"]["els"]["updates"] <= clean()["estimates"]["els"]["updates"]


def test_lost_packets():
    """theta: near; link.lost: those of the vehicle, none of the ground station's.

    In one silence no more than the sequence can tell: 128 frames.
    """
    rng = np.random.default_rng(2)
    kept = [r for r in good() if rng.random() > 0.05]
    kept = [*good()[:300], *without(kept[300:], 40.0, 41.0), good()[-1]]
    missing = [r for r in good() if r not in set(kept)]
    found = assert_near(join(kept))

    assert found["link"]["lost"] == sum(sender(frame) == (1, 1) for _, frame in missing)


def test_every_frame_twice():
    """theta, verdict: same; link.lost: 0. Two links carry the vehicle."""
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
    """theta, verdict: same; link.frames: as clean."""
    found = assert_same(join(as_v1(lambda i: i % every == 0)))

    assert found["link"]["frames"] == clean()["link"]["frames"]


def test_single_signed_frames_in_a_log_of_version_1():
    """theta, verdict: same; link.frames: as clean; unsigned_rejected: 0 (no key was given)."""
    records, signed = as_v1(lambda i: True), rewrite(good(), key=bytes(32))
    mixed = [s if i % 97 == 0 else r for i, (r, s) in enumerate(zip(records, signed, strict=True))]
    found = assert_same(join(mixed))

    assert found["link"]["frames"] == clean()["link"]["frames"]
    assert found["link"]["unsigned_rejected"] == 0


def test_a_known_message_whose_crc_never_fits():
    """theta, verdict: same; link.bad_crc: so many. The dialects drifted apart."""
    drifted = mavlink.MAVLink_wind_message(3.0, 2.0, 0.1)
    frame = wrong_crc(Encoder().frame(drifted, (1, 1)))
    log = join(x for r in good() for x in ([r, (r[0], frame)] if r[0] % 9 == 0 else [r]))
    count = sum(r[0] % 9 == 0 for r in good())

    assert assert_same(log)["link"]["bad_crc"] == count


def test_frames_of_ids_that_nobody_knows():
    """theta, verdict: same; link.frames: as clean, or more by what looks whole."""
    rng = np.random.default_rng(3)
    log = join(x for r in good() for x in ([r, (r[0], nonsense(rng))] if r[0] % 9 == 0 else [r]))

    assert assert_same(log)["link"]["frames"] >= clean()["link"]["frames"]


def test_an_attitude_that_travels_inside_another_message():
    """theta, verdict: same. A frame in a TUNNEL's payload is not the vehicle's word."""
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
    """theta, verdict: same; link.frames: as clean; link.skipped_bytes: the garbage."""
    found = assert_same(np.random.default_rng(4).bytes(size) + join(good()))

    assert found["link"]["frames"] == clean()["link"]["frames"]
    assert found["link"]["skipped_bytes"] == size


def test_garbage_between_the_records():
    """theta, verdict: same; link.frames: as clean."""
    rng = np.random.default_rng(5)
    parts = [join([r]) + (rng.bytes(17) if i % 50 == 0 else b"") for i, r in enumerate(good())]

    assert assert_same(b"".join(parts))["link"]["frames"] == clean()["link"]["frames"]


def test_other_senders_with_heartbeats_of_their_own():
    """theta, verdict: same; vehicle: 1/1; link.lost: 0. GCS, radio, ADS-B, gimbal."""

    def beat(kind: int, autopilot: int = 8) -> Any:
        return mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)

    others = [
        (50, beat(6), (255, 190)),
        (50, beat(6), (1, 190)),
        (50, beat(27), (1, 0)),
        (50, beat(18), (51, 68)),
        (50, beat(26), (1, 154)),
        (30, mavlink.MAVLink_radio_status_message(90, 91, 92, 40, 41, 3, 4), (51, 68)),
        (3, mavlink.MAVLink_attitude_message(90_000, 0, 0, 0, 0, 0, 3.0), (1, 154)),
    ]
    found = assert_same(with_others(others))

    assert (found["vehicle"]["sysid"], found["vehicle"]["compid"]) == (1, 1)
    assert found["link"]["lost"] == 0


def test_a_second_aircraft_on_the_link():
    """theta, verdict: same for the first; with --sysid 7 the second has no rudder to learn from."""
    second = [
        (50, mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3), (7, 1)),
        (5, mavlink.MAVLink_attitude_message(90_000, 0, 0, 0, 0, 0, 3.0), (7, 1)),
    ]
    log = with_others(second)

    assert assert_same(join(good()[:60]) + log[len(join(good()[:60])) :])["vehicle"]["sysid"] == 1
    assert_refused(log, "no_rudder", sysid=7)


def zero_servos(message: Any) -> None:
    if message.get_type() == "SERVO_OUTPUT_RAW":
        for n in range(1, 9):
            setattr(message, f"servo{n}_raw", 0)


def test_a_rudder_channel_that_is_always_zero():
    """verdict: not usable, not_excited; updates: 0."""
    found = assert_refused(changed(zero_servos), "not_excited")

    assert found.get("estimates", {}).get("els", {}).get("updates", 0) == 0


def test_channels_that_are_all_zero_beside_the_rudder():
    """theta, verdict: same."""

    def others(message: Any) -> None:
        rudder = getattr(message, "servo4_raw", 0)
        zero_servos(message)
        if message.get_type() == "SERVO_OUTPUT_RAW":
            message.servo4_raw = rudder

    assert_same(changed(others))


@pytest.mark.parametrize("seconds", [1.7, 20.0])
def test_the_first_seconds_of_a_boot_with_every_servo_at_zero(seconds: float):
    """theta: near; held: those samples, for want of a rudder; none of them is an update."""
    until_ms = round(1000 * (30.0 + seconds))
    boot_ms = [0]

    def silent(message: Any) -> None:
        boot_ms[0] = getattr(message, "time_boot_ms", boot_ms[0])
        if boot_ms[0] < until_ms:
            zero_servos(message)

    found = assert_near(changed(silent))

    held = [found["estimates"]["els"]["held"], clean()["estimates"]["els"]["held"]]
    assert held[0] - held[1] == pytest.approx(10 * seconds, abs=7)


def test_a_rudder_that_is_zero_for_a_while_in_flight():
    """theta: near; held: those samples."""

    def off(message: Any) -> None:
        if 90e6 < getattr(message, "time_usec", 0) < 95e6:
            zero_servos(message)

    found = assert_near(changed(off))

    held = [found["estimates"]["els"]["held"], clean()["estimates"]["els"]["held"]]
    assert held[0] - held[1] >= 50


def test_airspeed_that_only_repeats_the_ground_speed():
    """theta, verdict: same."""

    def repeat(message: Any) -> None:
        if message.get_type() == "VFR_HUD":
            message.airspeed = message.groundspeed

    assert_same(changed(repeat))


def on_the_ground(airspeed: float, *, armed: bool) -> list[Record]:
    """Return 25 s before take-off: the rudder is tried, the aircraft stands still."""
    encoder, records = Encoder(), []
    for i in range(1250):
        ms, stamp = 4000 + 20 * i, good()[0][0] - 26_000_000 + 20_000 * i
        pulse = 1500 + (200 if (i // 40) % 2 else -200)
        messages: list[Any] = [
            mavlink.MAVLink_attitude_message(ms, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
            mavlink.MAVLink_servo_output_raw_message(
                1000 * ms, 0, 1500, 1500, 1000, pulse, *[0] * 4
            ),
        ]
        if i % 50 == 0:
            mode = 128 if armed else 0
            messages.insert(0, mavlink.MAVLink_heartbeat_message(1, 3, mode, 0, 4, 3))
            messages.append(mavlink.MAVLink_vfr_hud_message(airspeed, 0.1, 0, 0, 0.0, 0.0))
        records += [(stamp, encoder.frame(message)) for message in messages]
    return records


@pytest.mark.parametrize(("airspeed", "armed"), [(63.0, False), (0.0, True), (0.0, False)])
def test_a_rudder_tried_on_the_ground_teaches_nothing(airspeed: float, armed: bool):
    """theta: near; held: the time on the ground, whatever airspeed VFR_HUD tells there."""
    found = assert_near(join([*on_the_ground(airspeed, armed=armed), *good()]))

    held = [found["estimates"]["els"]["held"], clean()["estimates"]["els"]["held"]]
    assert held[0] - held[1] > 200


def test_yaw_rates_that_no_aircraft_has():
    """theta: near; those samples are held. Spikes, infinity and NaN in ATTITUDE."""
    count = [0]

    def spike(message: Any) -> None:
        if message.get_type() == "ATTITUDE":
            count[0] += 1
            if count[0] % 101 == 0:
                message.yawspeed = [1e30, -1e6, np.inf, np.nan][count[0] // 101 % 4]

    found = assert_near(changed(spike))

    assert found["estimates"]["els"]["held"] > clean()["estimates"]["els"]["held"]


def test_a_yaw_sensor_that_freezes_halfway():
    """verdict: usable and near, or not usable; never usable and wrong."""
    frozen: list[float] = []

    def freeze(message: Any) -> None:
        if message.get_type() == "ATTITUDE":
            frozen.append(message.yawspeed)
            message.yawspeed = frozen[0]

    log = changed(freeze, start_s=MIDDLE_S)
    if run(log)["verdict"]["usable"]:
        assert_near(log)


def test_yaw_and_rudder_that_fall_silent_in_turns():
    """theta: near; link.gaps: two at least; nothing is filled in."""
    records = [
        r
        for r in good()
        if not (message_id(r[1]) == 30 and 40e6 < r[0] - good()[0][0] < 43e6)
        and not (message_id(r[1]) == 36 and 60e6 < r[0] - good()[0][0] < 72e6)
    ]
    found = assert_near(join(records))

    assert found["link"]["gaps"] >= 2
    assert found["estimates"]["els"]["updates"] < clean()["estimates"]["els"]["updates"] - 100


def test_a_log_cut_short_after_the_first_manoeuvre_is_refused_or_right():
    """verdict: usable and near the clean run by its own sigma, or not usable."""
    for share in (0.1, 0.2, 0.3, 0.5):
        found = run(join(good()[: int(share * len(good()))]))
        if found["verdict"]["usable"]:
            actual, expected = dutch_roll(found, "els"), dutch_roll(clean(), "els")
            assert (np.abs(actual - expected)[:2] <= 3.0 * actual[2:] + 3.0 * expected[2:]).all()


def test_no_servo_messages_and_no_attitude_at_all():
    """verdict: no_rudder, no_yaw; without HEARTBEAT no_vehicle."""
    for ident, reason in ((36, "no_rudder"), (30, "no_yaw")):
        assert_refused(join(r for r in good() if message_id(r[1]) != ident), reason)
    vehicles = (r for r in good() if message_id(r[1]) != 0 or sender(r[1]) != (1, 1))
    assert_refused(join(vehicles), "no_vehicle")


def test_two_flights_of_the_day_in_one_log():
    """theta: near; link.reboots: 1; link.gaps: 0 (the clock began anew); sigma below the clean."""
    found = assert_near(join(after(good(), good(), 600.0)))

    assert found["link"]["reboots"] == 1
    assert dutch_roll(found, "els")[2] < dutch_roll(clean(), "els")[2]
