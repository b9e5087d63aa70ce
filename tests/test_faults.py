"""Faults of stamps, clocks and bytes in a good log, and what must come of each."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fault_injection import (
    MIDDLE_S,
    NEAR,
    SAME,
    Fault,
    Summary,
    assert_refused,
    clean,
    dutch_roll,
    good,
    of_els,
    shifted,
    with_others,
)
from flights.surgery import Encoder, Record, edited, join, nonsense, sender, without, wrong_crc
from pymavlink.dialects.v20 import ardupilotmega as mavlink


def test_the_clean_run_lacks_nothing_and_is_known_to_a_few_percent():
    assert "verdict" not in clean()
    for method in ("els", "rml"):
        wn, _, wn_std, zeta_std = dutch_roll(clean(), method)
        assert wn_std < 0.03 * wn
        assert zeta_std < 0.03


def restamped(change: Callable[[int, int, int], int]) -> Callable[[], bytes]:
    """Return the log whose stamps are ``change(number, stamp, first stamp)``."""
    return lambda: join(
        (change(i, stamp, good()[0][0]), frame) for i, (stamp, frame) in enumerate(good())
    )


def faster(factor: float) -> Fault:
    def lasts(found: Summary) -> Any:
        return found["duration_s"], pytest.approx(clean()["duration_s"] / factor)

    log = restamped(lambda i, stamp, first: first + int((stamp - first) / factor))
    return Fault(log, SAME, lasts)


def link(*names: str, like: dict[str, int] | None = None) -> Callable[[Summary], Any]:
    """Return the check that these counts of the link are those of the clean run, or of ``like``."""

    def check(found: Summary) -> Any:
        expected = dict.fromkeys(names, 0) if like is None else like
        return {name: found["link"][name] for name in expected}, expected

    return check


NO_STEPS = link("reboots", "clock_steps")


def frames(more: int = 0) -> Callable[[Summary], Any]:
    return lambda found: (found["link"]["frames"], clean()["link"]["frames"] + more)


def overtaking() -> bytes:
    rng = np.random.default_rng(1)
    order = np.argsort(np.arange(len(good())) + rng.integers(0, 8, len(good())), kind="stable")
    return join((t, good()[i][1]) for (t, _), i in zip(good(), order, strict=True))


@functools.cache
def lossy() -> tuple[bytes, int]:
    """Return the log without 5 % and one second, and how many frames of the vehicle that costs.

    In one silence no more than the sequence can show: 128 frames.
    """
    rng = np.random.default_rng(2)
    kept = [r for r in good() if rng.random() > 0.05]
    kept = [*good()[:300], *without(kept[300:], 40.0, 41.0), good()[-1]]
    arrived = set(kept)
    missing = [frame for stamp, frame in good() if (stamp, frame) not in arrived]
    return join(kept), sum(sender(frame) == (1, 1) for frame in missing)


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


def signed_in_v1() -> bytes:
    both = zip(as_v1(lambda i: True), edited(good(), key=bytes(32)), strict=True)
    return join(signed if i % 97 == 0 else plain for i, (plain, signed) in enumerate(both))


def among(frame: Callable[[], bytes]) -> bytes:
    """Return the log with a frame behind one record in nine."""
    return join(x for r in good() for x in ([r, (r[0], frame())] if r[0] % 9 == 0 else [r]))


def drifted() -> bytes:
    """A known message whose CRC never fits: the dialects drifted apart."""
    wrong = wrong_crc(Encoder().frame(mavlink.MAVLink_wind_message(3.0, 2.0, 0.1), (1, 1)))
    return among(lambda: wrong)


def tunnelled() -> bytes:
    """An ATTITUDE inside a TUNNEL's payload is not the vehicle's word."""
    wrong = Encoder().frame(mavlink.MAVLink_attitude_message(95_000, 0, 0, 0, 0, 0, 9.0))
    payload = list(bytes(8) + wrong) + [0] * 128
    message = mavlink.MAVLink_tunnel_message(0, 0, 0x8001, 60, payload[:128])
    return with_others([(40, message, (1, 1))])


def crlf(days: int) -> bytes:
    us = days * 86_400_000_000
    return join((t - us, f) for t, f in good()).replace(b"\n", b"\r\n")


def noisy(size: int) -> Fault:
    log = lambda: np.random.default_rng(4).bytes(size) + join(good())  # noqa: E731
    return Fault(log, SAME, frames(), link(like={"skipped_bytes": size}))


def between() -> bytes:
    rng = np.random.default_rng(5)
    return b"".join(
        join([r]) + (rng.bytes(17) if i % 50 == 0 else b"") for i, r in enumerate(good())
    )


HOUR_US = 3_600_000_000
FAULTS = {
    "26 frames with one stamp": Fault(
        lambda: join((good()[26 * (i // 26)][0], r[1]) for i, r in enumerate(good())),
        SAME,
        link("lost"),
    ),
    **{f"recorded at {factor} times the speed": faster(factor) for factor in (5, 25, 0.2)},
    **{
        f"stamps from {base} us on": Fault(
            restamped(lambda i, stamp, first, base=base: base + stamp - first), SAME
        )
        for base in (0, 1_000_000, 2**50)
    },
    "stamps that step back by an hour and forward again": Fault(
        restamped(lambda i, stamp, first: stamp - HOUR_US * (i * 3 // len(good()) == 1)), SAME
    ),
    "MAVProxy's link number in the two low bits": Fault(
        restamped(lambda i, stamp, first: stamp & ~3 | i % 4), SAME
    ),
    "the servo clock wraps while boot time goes on": Fault(
        lambda: shifted(2**32 // 1_000_000 - MIDDLE_S),
        NEAR,
        link("reboots", "clock_steps", "gaps"),
        of_els("updates", operator.eq),
    ),
    "a reboot that is not announced": Fault(
        lambda: shifted(-85.0, start_s=MIDDLE_S),
        NEAR,
        link(like={"reboots": 1}),
        of_els("held", operator.gt),
    ),
    "a clock that steps back by more than a second": Fault(
        lambda: shifted(-1.4, start_s=MIDDLE_S), NEAR, link(like={"reboots": 0, "clock_steps": 1})
    ),
    **{
        f"a step back by {-step_s} s": Fault(
            lambda step_s=step_s: shifted(step_s, start_s=MIDDLE_S), NEAR, NO_STEPS
        )
        for step_s in (-0.003, -0.04, -0.3)
    },
    "frames that overtake each other": Fault(overtaking, NEAR, NO_STEPS),
    "a boot clock that jumps ahead by 447 s": Fault(
        lambda: shifted(447.0, start_s=MIDDLE_S),
        NEAR,
        link(like={"reboots": 0, "gaps": 0, "clock_steps": 1}),
        of_els("updates", operator.le),
    ),
    "lost packets": Fault(
        lambda: lossy()[0], NEAR, lambda found: (found["link"]["lost"], lossy()[1])
    ),
    "every frame twice": Fault(
        lambda: join(r for r in good() for _ in range(2)), SAME, link("lost")
    ),
    **{
        f"one frame in {every} of MAVLink 1": Fault(
            lambda every=every: join(as_v1(lambda i: i % every == 0)), SAME, frames()
        )
        for every in (2, 3)
    },
    "single signed frames in a log of version 1": Fault(
        signed_in_v1, SAME, frames(), link("unsigned_rejected")
    ),
    "a known message whose CRC never fits": Fault(
        drifted,
        SAME,
        lambda found: (found["link"]["bad_crc"], sum(r[0] % 9 == 0 for r in good())),
    ),
    "frames of unknown ids": Fault(
        lambda: among(functools.partial(nonsense, np.random.default_rng(3))),
        SAME,
        lambda found: (found["link"]["frames"] >= clean()["link"]["frames"], True),
    ),
    "an attitude inside of another message": Fault(tunnelled, SAME),
    "line ends that were translated": Fault(
        lambda: crlf(100),
        NEAR,
        lambda found: (found["link"]["skipped_bytes"] > 0, True),
        lambda found: (found["link"]["frames"] < clean()["link"]["frames"], True),
    ),
    **{
        f"the last frame without {size} bytes": Fault(
            lambda size=size: join(good())[:-size], NEAR, frames(-1)
        )
        for size in (1, 7, 31)
    },
    **{f"{size} bytes of garbage at the start": noisy(size) for size in (1, 8, 300, 100_000)},
    "garbage between the records": Fault(between, SAME, frames()),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_stamps_clocks_or_bytes(name: str):
    FAULTS[name].check()


def test_line_ends_that_were_translated_in_every_stamp():
    """For weeks at a time a high byte of the stamp is 0A."""
    assert b"\n" in good()[0][0].to_bytes(8, "big")[:4]
    assert assert_refused(crlf(0), "no_vehicle")["link"]["frames"] == 0
