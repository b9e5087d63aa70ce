"""The terminal: the live screen at 80x24, the bar of what takes long, and what a ctrl-C leaves."""

from __future__ import annotations

import contextlib
import io
import os
import pty
import signal
import sys
import time
from dataclasses import replace
from typing import Any

import pytest
from hand_flights import four_of_a_flight
from rich.console import Console
from rich.screen import Screen

from yawid.sinks.terminal.console import LiveFacts, VehicleFacts
from yawid.sinks.terminal.live_page import Page, what_to_do
from yawid.sinks.terminal.progress import progress
from yawid.sources.link.endpoints import parse_endpoint

FLIGHT = four_of_a_flight()
FLYING = VehicleFacts(
    sysid=1,
    name="1/1 fixed wing, ArduPilot",
    rudder="SERVO_OUTPUT_RAW.servo4_raw",
    yaw="ATTITUDE.yawspeed",
    message_hz=1183.2,
    yaw_hz=50.0,
    rudder_hz=8.25,
    lost=12345,
    stroke=0.07,
    rests_s=0.2,
    from_s=1512.0,
    lasted_s=112.0,
    unanswered=1,
    manoeuvres=tuple(FLIGHT.manoeuvres or ()),
    flights=tuple(FLIGHT.by_loop),
    stream="wn 9.267 ± 0.062 rad/s, zeta 0.579 ± 0.0041 by ELS (± of noise)",
    state="tracking",
    verdict=False,
    why=("not_excited: the rudder never moved on its own by 10 % of half its travel",),
)
LINK = LiveFacts("udpin:0.0.0.0:14550", 133.0, 0.12, "at least 7", (FLYING,))
SAID = [
    (f"12:03:0{i}", f"manoeuvre {i} (34 to 60 s, FBWA, 51 m/s): " + 5 * "word ") for i in (1, 2)
]


def drawn(facts: LiveFacts, width: int = 80, height: int = 24) -> list[str]:
    """Return the lines of a window without colours."""
    out = io.StringIO()
    console = Console(file=out, width=width, height=height, force_terminal=True, color_system=None)
    console.print(Screen(Page(facts, SAID)))
    lines = out.getvalue().removesuffix("\n").split("\n")
    assert (len(lines), max(map(len, lines))) == (height, width)
    return lines


def with_vehicles(*vehicles: VehicleFacts) -> LiveFacts:
    return replace(LINK, vehicles=vehicles)


PORT = "udpin:0.0.0.0:14560"
SILENT = {"vehicles": (), "to_send": parse_endpoint(PORT).to_send}


@pytest.mark.parametrize(
    ("of_link", "of_vehicle", "words", "never"),
    [
        (
            {}, {},
            (
                LINK.endpoint, FLYING.name, FLYING.stream, *FLYING.why,
                "2 min ", "1183 msg/s", "lost 12345", "dropped at least 7", "0.1 s ago",
                "rudder SERVO_OUTPUT_RAW.servo4_raw 8.2 Hz", "yaw ATTITUDE.yawspeed 50 Hz",
                "███·|················ 7 % of half travel in 5 s; 10 % needed",
                "move the rudder more", "manoeuvre 6 from 1512 s on, 112 s long",
                "10.27±0.11 0.624±0.012 used", "disagrees", "not_converged",
                "wn 10.21 ± 0.16 rad/s, zeta 0.624 ± 0.021 (± is one sigma)",
                "from 2 of 4 manoeuvres", "NOT USABLE", "12:03:02 manoeuvre 2",
            ),
            "…",
        ),
        (
            {}, {"flights": (), "manoeuvres": (), "verdict": None},
            ("VERDICT none yet: no manoeuvre has been answered",), "NOT USABLE",
        ),
        (
            SILENT | {"age_s": None}, {},
            ("SENDER in MAVProxy: output add ADDRESS-OF-THIS-MACHINE:14560; mavlink-router",), "…",
        ),
        (SILENT, {}, (), "SENDER"),
        # A text from the link is shown, and is no command.
        ({}, {"name": "\x1b[2J"}, (r"\x1b[2J",), "\x1b"),
        ({}, {"stream": "wn \x9b1m\u202e"}, (r"wn \x9b1m\u202e",), "\u202e"),
    ],
)  # fmt: skip
def test_a_window_of_80_by_24_holds_every_fact_and_cuts_none(
    of_link: dict[str, Any], of_vehicle: dict[str, Any], words: tuple[str, ...], never: str
) -> None:
    facts = replace(with_vehicles(replace(FLYING, **of_vehicle)), **of_link)
    text = " ".join(" ".join(drawn(facts)).split())
    assert [each for each in words if each not in text] == []
    assert never not in text


def test_a_dead_link_stands_in_red_with_how_long() -> None:
    out = io.StringIO()
    console = Console(file=out, width=80, height=24, force_terminal=True, color_system="standard")
    dead = replace(FLYING, quiet="nothing received for 7 s")
    console.print(Page(replace(with_vehicles(dead), age_s=7.3), ()))
    assert "\x1b[1;37;41m NOTHING RECEIVED FOR 7 S " in out.getvalue()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rudder": ""}, "wait: no rudder yet; ask for it at 25 Hz"),
        ({"lacks": "arm: the autopilot's outputs do not"}, "arm: the autopilot's outputs do not"),
        ({"state": ""}, "wait: the message rates are measured for five seconds"),
        ({"held": "on ground"}, "wait: no sample is used now: on ground"),
        ({"from_s": None}, "wait: a manoeuvre is being estimated; or fly the next one"),
        ({"from_s": None, "unanswered": 0}, "doublet, 10 % of half travel or more; then hands"),
        (
            {"from_s": None, "unanswered": 0, "stroke": None},
            "move the rudder; it takes some seconds",
        ),
        ({}, "move the rudder more"),
        ({"is_excited": True}, "enough: rudder to neutral, then let go for 5 s or more"),
        ({"is_excited": True, "rests_s": 1.8}, "let go: the manoeuvre needs 3 s more of rest"),
        (
            {"is_excited": True, "rests_s": 5.0},
            "let go: the manoeuvre ends when the yaw rate has decayed",
        ),
    ],
)
def test_the_pilot_is_told_what_to_do(change: dict[str, object], words: str) -> None:
    assert what_to_do(replace(FLYING, **change)).text.startswith(words)


def test_of_many_vehicles_those_in_trouble_have_a_row_and_the_rest_are_counted() -> None:
    many = [replace(FLYING, sysid=i, from_s=None, unanswered=0) for i in range(1, 255)]
    many[199] = replace(many[199], quiet="nothing received for 42 s")
    lines = drawn(with_vehicles(*many))
    rows = [line.split() for line in lines if line[:3].strip().isdigit()]
    assert [row[0] for row in rows] == [*map(str, range(1, len(rows))), "200"]
    assert " ".join(rows[-1][-9:]) == ("7 % silent 42 s 2/4 10.21±0.16 0.624±0.021 not_excited")
    assert any(f"and {254 - len(rows)} more: {254 - len(rows)} tracking" in line for line in lines)
    assert any(line.startswith(SAID[1][0]) for line in lines[-3:])


def test_a_window_too_small_for_the_page_has_the_line() -> None:
    said = "yawid: 1183 msg/s, lost 12345, dropped at least 7,"
    assert drawn(LINK, 50, 10)[0].strip() == said


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("stream", "wait_s"), [(Terminal(), 0.0), (io.StringIO(), 0.1)])
def test_nothing_is_shown_of_what_is_quick_or_where_there_is_no_terminal(
    stream: io.StringIO, wait_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("yawid.sinks.terminal.progress.SOON_S", 0.05)
    with progress(stream, "flight.tlog", 100) as advance:
        advance(50)
        time.sleep(wait_s)
    assert stream.getvalue() == ""


def test_what_takes_long_is_shown_with_how_far_it_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("yawid.sinks.terminal.progress.SOON_S", 0.05)
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    with progress(stream, "flight.tlog", 100) as advance:
        advance(25)
        patience = time.monotonic() + 60.0
        while "flight.tlog" not in stream.getvalue() and time.monotonic() < patience:
            time.sleep(0.01)
        advance.begin("6 structures", 6)
        advance(3)
        time.sleep(0.15)
    shown = stream.getvalue()
    assert "25%" in shown
    assert "6 structures" in shown
    assert "50%" in shown


WORK = """
import sys, time
from yawid.runs.stop import StopFlag
from yawid.sinks.terminal.console import LiveFacts
from yawid.sinks.terminal.console import Console
from yawid.sinks.terminal import progress as bars

facts = LiveFacts("udpin:127.0.0.1:1", 1.0, None, "0", ())
bars.SOON_S = 0.0 if sys.argv[1] == "bar" else 600.0
with StopFlag().installed(), bars.progress(sys.stderr, "a log", 10.0) as bar:
    if sys.argv[1] != "bar":
        Console(sys.stderr, draws=True).draw(facts, 0.0)
    for _ in range(600):  # busy: it never looks whether it is to stop
        time.sleep(0.1)
"""
HIDDEN, SHOWN = b"\x1b[?25l", b"\x1b[?25h"
OTHER, OWN = b"\x1b[?1049h", b"\x1b[?1049l"


def is_whole(seen: bytes) -> bool:
    """Return whether the cursor is shown, and on the terminal's own screen."""
    last = seen.rfind
    return last(SHOWN) >= last(HIDDEN) and last(OWN) >= last(OTHER)


@pytest.mark.parametrize("what", ["bar", "screen"])
def test_a_second_ctrl_c_leaves_the_terminal_whole(what: str) -> None:
    work, terminal = pty.fork()
    if work == 0:
        environment = os.environ | {"TERM": "xterm-256color", "LANG": "C.UTF-8"}
        os.execve(sys.executable, [sys.executable, "-c", WORK, what], environment)
    seen = b""
    while is_whole(seen):
        seen += os.read(terminal, 1 << 16)
    os.write(terminal, b"\x03")  # the first one asks it to end, which it never does
    time.sleep(0.3)
    seen += os.read(terminal, 1 << 16)
    assert not is_whole(seen)
    os.write(terminal, b"\x03")
    with contextlib.suppress(OSError):  # the terminal's end on Linux
        while part := os.read(terminal, 1 << 16):
            seen += part
    _, status = os.waitpid(work, 0)
    assert is_whole(seen)
    assert os.waitstatus_to_exitcode(status) == -signal.SIGINT
