"""A good log and the faults that are put into it: JSBSim's C172P of replay_logs/c172p_3211.

``same`` means that the numbers equal those of the clean run, ``near`` that wn and zeta of ELS and
RML are within three sigma of them.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from flightlog import finished
from flights.surgery import CLASSES, Encoder, Record, edited, join, split
from places import REPLAY_LOGS

from yawid.config.run import RunConfig

CASE = REPLAY_LOGS / "c172p_3211"
Summary = dict[str, Any]
MIDDLE_S = 90.0  # vehicle time; the flight lasts from 30 s to 150 s


def run(log: bytes, **settings: Any) -> Summary:
    settings = {"rate": 10.0, "memory": math.inf, "manoeuvres": "off"} | settings
    config = RunConfig(**settings)
    return finished(log, config, size=1 << 16).to_json()


@functools.cache
def good() -> tuple[Record, ...]:
    return tuple(split((CASE / "log.tlog").read_bytes()))


@functools.cache
def clean() -> Summary:
    return run(join(good()))


def dutch_roll(summary: Summary, method: str) -> np.ndarray:
    """Return wn, zeta and their sigmas of noise, which are smaller than the total sigmas."""
    found = summary["estimates"][method]["dutch_roll"]
    names = ("wn_rad_s", "zeta", "wn_std_noise", "zeta_std_noise")
    return np.array([found[name] for name in names])


def assert_same(found: Summary) -> None:
    for method in ("els", "rml"):
        assert found["estimates"][method]["theta"] == clean()["estimates"][method]["theta"]
    for key in ("verdict", "warnings"):
        assert found.get(key) == clean().get(key)


def assert_near(found: Summary) -> None:
    for method in ("els", "rml"):
        expected, actual = dutch_roll(clean(), method), dutch_roll(found, method)
        sigmas = np.abs(actual - expected)[:2] / expected[2:]
        assert (sigmas <= 3.0).all(), (method, sigmas, actual, expected)
    assert "verdict" not in found  # nothing fatal: not judged


SAME, NEAR = assert_same, assert_near


class Fault:
    """A faulty log, what its numbers must be, and checks: pairs of found and expected."""

    def __init__(
        self,
        log: Callable[[], bytes],
        result: Callable[[Summary], None],
        *checks: Callable[[Summary], tuple[Any, Any]],
    ) -> None:
        self.log, self.result, self.checks = log, result, checks

    def check(self) -> None:
        found = run(self.log())
        self.result(found)
        for each in self.checks:
            actual, expected = each(found)
            assert actual == expected


def of_els(name: str, compare: Callable[[float, float], bool]) -> Callable[[Summary], Any]:
    """Return the check that a count of ELS compares like this with that of the clean run."""

    def check(found: Summary) -> Any:
        counts = [each["estimates"]["els"][name] for each in (found, clean())]
        return compare(*counts), True

    return check


@functools.cache
def clean_flight() -> Summary:
    return run(join(good()), manoeuvres="auto")


def assert_right_or_refused(log: bytes) -> None:
    """The flight's answer, if it is usable, is that of the clean run within 3 sigma of both."""
    found, expected = run(log, manoeuvres="auto"), clean_flight()
    assert expected["verdict"]["usable"]
    if found["verdict"]["usable"]:
        ours, theirs = (each["flight"]["dutch_roll"] for each in (found, expected))
        for name, std in (("wn_rad_s", "wn_std"), ("zeta", "zeta_std")):
            assert abs(ours[name] - theirs[name]) <= 3.0 * np.hypot(ours[std], theirs[std])


def assert_refused(log: bytes, reason: str, **settings: Any) -> Summary:
    found = run(log, **settings)
    assert not found["verdict"]["usable"]
    fatal = [r["id"] for r in found["verdict"]["reasons"] if r["weight"] == "fatal"]
    assert fatal[0] == reason
    return found


def changed(change: Callable[[Any], Any], *, start_s: float = 0.0) -> bytes:
    """Return the good log, with ``change`` applied to the vehicle's messages from a time on."""
    boot_s = [0.0]

    def one(message: Any) -> None:
        if message.get_type() == "ATTITUDE":
            boot_s[0] = message.time_boot_ms / 1000
        if boot_s[0] >= start_s:
            change(message)

    return join(edited(good(), **dict.fromkeys(CLASSES, one)))


def shifted(seconds: float, start_s: float = 0.0) -> bytes:
    """Return the good log with the vehicle's clock shifted from a time on; servo time wraps."""

    def shift(message: Any) -> None:
        if hasattr(message, "time_boot_ms"):
            message.time_boot_ms += round(1000 * seconds)
        elif hasattr(message, "time_usec"):
            message.time_usec = (message.time_usec + round(1e6 * seconds)) % 2**32

    return changed(shift, start_s=start_s)


def with_others(messages: Iterable[tuple[int, Any, tuple[int, int]]]) -> bytes:
    """Return the good log with further messages between its records.

    ``messages`` are (one in how many records, message, sender ids).
    """
    encoder, records = Encoder(), []
    for i, record in enumerate(good()):
        for every, message, ids in messages:
            if i % every == 0:
                records.append((record[0], encoder.frame(message, ids)))
        records.append(record)
    return join(records)
