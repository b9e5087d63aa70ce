"""The flight test card on one page of paper: what to fly next, in the order of the flight."""

import math
import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TextIO

from yawid.answers.flight_test_card import FlightTestCard, ParameterToSet, SurfaceMove
from yawid.answers.inspection import Inspection
from yawid.quantities.airspeed import GROUND_SPEED
from yawid.quantities.vehicles import AIRFRAME, ARDUPILOT, PX4
from yawid.results.make_card import why_no_card
from yawid.sinks.door import WIDTH
from yawid.sinks.words import count, dutch_roll

BLANK = "________"
HAND_S = 0.25
"""A deflection that is shorter than this cannot be flown by hand."""
SCRIPT_STEPS = 45.0
"""Full deflection in the unit of plane-doublets.lua's DOUBLET_MAGNITUDE."""
NAMES = 11
"""The width of the column of names."""
COLUMNS = {"time": 8, "m/s": 5, "height": 6, "mode": 10, "%": 4, "remark": 24}
PAGE = 60
"""The largest number of lines on a sheet of paper."""
Row = tuple[str, str]


def print_card(report: Inspection, stream: TextIO) -> None:
    """Print the card, or a line with the reason why there is none."""
    card = report.card
    if card is None:
        stream.write(f"{why_no_card(report.vehicle, report.deciding)}: {report.log}\n")
        return
    head, date = "TEST CARD: rudder to yaw", f"date {BLANK}  pilot {BLANK}"
    lines = [f"{head}{date:>{WIDTH - len(head)}}", *_lines(_known(report, card))]
    parts = (
        ("BEFORE TAKE-OFF", _before(card)),
        ("IN FLIGHT: straight, wings level, steady airspeed, calm air", _flight(card)),
        ("MANOEUVRE: the rudder alone, stick at rest", _manoeuvre(card)),
        ("ON THE SPOT", _check(card)),
    )
    for number, (title, rows) in enumerate(parts, start=1):
        lines += ["", f"{number} {title}", *_lines(rows)]
    wanted = card.manoeuvre.manoeuvres * max(len(card.conditions.airspeeds_m_s), 2)
    flown = max(min(wanted, PAGE - len(lines) - 2), 0)
    lines += ["", _table(COLUMNS), *[_table("_" * n for n in COLUMNS.values())] * flown]
    stream.write("\n".join(line.rstrip() for line in lines) + "\n")


def _table(cells: Iterable[str]) -> str:
    row = "  ".join(f"{cell:<{n}}" for cell, n in zip(cells, COLUMNS.values(), strict=True))
    return f"{'flown' if 'time' in row else '':<{NAMES}}{row}"


def _lines(rows: Iterator[Row]) -> Iterator[str]:
    """Yield the lines of rows, each text next to its name; words are not broken."""
    for name, text in rows:
        body = textwrap.wrap(text, WIDTH - NAMES, break_long_words=False, break_on_hyphens=False)
        for i, line in enumerate(body):
            yield f"{name if i == 0 else '':<{NAMES}}{line}"


def _known(report: Inspection, card: FlightTestCard) -> Iterator[Row]:
    seen = report.vehicle
    address = "" if seen is None else f", {seen.sysid}/{seen.compid}"
    yield "aircraft", f"{card.vehicle}{address}  {BLANK}"
    yield "log", Path(report.log).name
    if card.answer is not None:
        by = count(len(card.answered)) if card.answered else "the whole record"
        yield "it says", f"{dutch_roll(card.answer)} (one sigma), by {by}"
    if card.expected:
        more = (f"± {each.wn_std:.2g} after {each.more}" for each in card.expected)
        yield "to expect", f"wn {', '.join(more)} more manoeuvres like these"
    for i, text in enumerate(card.lacks):
        yield "" if i else "it lacks", text


def _before(card: FlightTestCard) -> Iterator[Row]:
    named = (("yaw", card.yaw_hz), ("rudder", card.rudder_hz))
    has = {name: hz for name, hz in named if hz is not None}
    rates = ", ".join(f"{name} {hz:.2g} Hz" for name, hz in has.items()) or "none"
    enough = card.rates_suffice
    yield "[ ] rates", f"{'as they were' if enough else f'{card.ask_hz:g} Hz'} (this log: {rates})"
    if not enough:
        yield from _rates(card)
    for each in card.parameters:
        back = ", ".join(f"{value:g}" for value in each.now.values()) or BLANK
        yield "[ ] set", f"{each.name} = {each.to:g} ({each.why}); afterwards back to {back}"
    if card.autopilot is not None:
        yield "[ ] log", "recorded from before take-off, parameters downloaded meanwhile"
    else:
        yield "[ ] log", "recorded from before take-off: rudder, yaw rate, airspeed, aileron, bank"


def _rates(card: FlightTestCard) -> Iterator[Row]:
    if card.autopilot == PX4:
        for name in ("ATTITUDE", "SERVO_OUTPUT_RAW_0"):
            yield "", f"mavlink stream -d {BLANK} -s {name} -r {card.ask_hz:g}"
    elif card.autopilot not in (None, ARDUPILOT):
        interval = f"{1e6 / card.ask_hz:.0f} us"
        yield "", f"MAV_CMD_SET_MESSAGE_INTERVAL of ATTITUDE, SERVO_OUTPUT_RAW: {interval}"
    for each in card.rates:
        yield "", f"{each.name} = {each.to:g} for {each.why}{_now(each)}"
    if card.rates:
        yield "", "n: the port (SR0, MAV1: the first). MAVProxy: set streamrate -1; reboot"


def _now(each: ParameterToSet) -> str:
    low, high = min(each.now.values(), default=0.0), max(each.now.values(), default=0.0)
    span = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    return f"; now {span}" if each.now else ""


def _flight(card: FlightTestCard) -> Iterator[Row]:
    flown = card.conditions
    speeds = [f"[ ] {speed:.1f}" for speed in flown.airspeeds_m_s]
    speeds += [f"[ ] {BLANK}"] * (1 if len(speeds) == 2 else 3 - len(speeds))
    yield "airspeed", "  ".join(speeds) + " m/s, each within 5 %"
    if flown.airspeed_low_m_s is not None and flown.airspeed_high_m_s is not None:
        what = "" if flown.airspeed_source != GROUND_SPEED else " over ground"
        text = f"flown: {flown.airspeed_low_m_s:.1f} to {flown.airspeed_high_m_s:.1f} m/s{what}"
        if flown.airspeed_least_m_s is not None and flown.airspeed_most_m_s is not None:
            text += f"; limits {flown.airspeed_least_m_s:g} to {flown.airspeed_most_m_s:g}"
        yield "", text + "; two or three show wn over V"
    height = f"not below {BLANK} m above ground"
    low, high = flown.altitude_low_m, flown.altitude_high_m
    if low is not None and high is not None and (low, high) != (0.0, 0.0):
        height += f"; flown: {low:.0f} to {high:.0f} m above the sea"
    yield "height", height
    for each in flown.modes:
        whose = "bare airframe" if each.loop == AIRFRAME else "aircraft with its roll loop"
        done = f" (this log: {count(len(each.answered))})" if each.answered else ""
        yield "mode", f"[ ] {each.mode}: the {whose}{done}"
    if not flown.modes:
        yield "mode", f"[ ] {BLANK}: one in which the pedals move the rudder directly"
    turns = "twelve minutes at one airspeed with turns of 20 deg bank show wn and zeta alone"
    yield "or", f"{turns}, of the bare airframe, without any rudder: --ordinary auto"


def _manoeuvre(card: FlightTestCard) -> Iterator[Row]:
    asked = card.manoeuvre
    first, most = asked.amplitude
    yield "rudder", f"begin with {_far(first)}; at most {_far(most)}"
    side, unit, pause = (f"{s:.2g} s" for s in (asked.side_s, asked.unit_s, asked.pause_s))
    yield "doublet", f"left {side}, right {side}, neutral {pause}; the next one right first"
    if asked.side_s < HAND_S:
        yield "", "too fast for a hand: by script, or as fast as you can"
    total_s = asked.manoeuvre_s + asked.rest_s
    text = (
        f"{asked.doublets} doublets, then {asked.rest_s:g} s neutral (5 s end it): {total_s:.0f} s"
    )
    yield "manoeuvre", text
    if asked.unit_s >= HAND_S:
        pieces = ", ".join(f"{n * asked.unit_s:.2g}" for n in (3, 2, 1, 1))
        yield "or 3-2-1-1", f"left, right, left, right for {pieces} s, three times with pauses"
    else:
        yield "", f"(a 3-2-1-1, its 1 lasting {unit}, is only for a script)"
    yield from _aileron(card)
    minutes = f"{math.ceil(asked.total_s / 60.0)} min"
    length = minutes if len(card.conditions.airspeeds_m_s) > 1 else f"{minutes} an airspeed"
    yield ("repeat", f"{asked.manoeuvres} manoeuvres at each airspeed, in one mode: about {length}")
    swing = f"a swing of the nose lasts T = {asked.period_s:#.2g} s"
    if asked.wn_guessed:
        text = (
            f"GUESSED: {swing}. Count the swings after the first doublet: {BLANK} s / {BLANK} "
            "swings = T; a side lasts T/2, neutral 2 T (1 to 3.5 s)"
        )
        yield "times", text
    else:
        yield "times", f"{swing}, by wn and zeta above; a side lasts T/2"
    yield from _automatic(card)
    text = (
        "rudder neutral, then the mode that levels. Bank beyond 30 deg, airspeed 10 % off, too "
        "low, anything unexpected: end the test"
    )
    yield "abort", text


def _aileron(card: FlightTestCard) -> Iterator[Row]:
    """Yield the aileron's doublet that makes the bare airframe known."""
    asked = card.aileron
    if asked is None:
        return
    side, zeta_std = f"{asked.side_s:.2g} s", asked.expected.zeta_std or 0.0
    text = (
        f"once, {asked.after_s:.2g} s after the last doublet: right {side}, left {side}, neutral; "
        f"{_far(asked.amplitude)}, bank 10 deg at most. ATTITUDE and outputs at {asked.ask_hz:g} "
        f"Hz. With --lateral auto expect of the bare airframe wn ± {asked.expected.wn_std:.2g}, "
        f"zeta ± {zeta_std:.2g}"
    )
    yield "aileron", text


def _automatic(card: FlightTestCard) -> Iterator[Row]:
    """Yield how the autopilot itself can fly the manoeuvre, by a script or its autotune."""
    asked = card.manoeuvre
    if card.autopilot == ARDUPILOT:
        magnitude = SCRIPT_STEPS * asked.amplitude[0].percent / 100.0
        high_s = max(2.2 * asked.period_s, asked.period_s + asked.pause_s)
        text = (
            f"plane-doublets.lua, DOUBLET_TIME = {1e3 * asked.period_s:.0f} (ms), the rudder's "
            f"DOUBLET_MAGNITUDE = {magnitude:.0f} (of 45). Be in MANUAL, RC7 high. For each "
            f"doublet RC6 high {high_s:.2g} s (DOUBLET FINISHED), low, at once high again"
        )
        yield "by script", text
        if card.aileron is not None:
            share = SCRIPT_STEPS * card.aileron.amplitude.percent / 100.0
            text = (
                "its aileron, RC7 low: in its elevator's branch K_AILERON for K_ELEVATOR, "
                f"trim_funcs = {{K_RUDDER}}, DOUBLET_MAGNITUDE = {share:.0f}, DOUBLET_TIME = "
                f"{2e3 * card.aileron.side_s:.0f} (in the rudder's {1e3 * asked.period_s:.0f}), "
                "doublet_srv_trim = SRV_Channels:get_output_pwm(K_AILERON) (there of K_RUDDER)"
            )
            yield "", text
    elif card.autopilot == PX4:
        hz = 1.0 / asked.period_s
        text = (
            "FW_AT_AXES = 4 (yaw), FW_AT_APPLY = 0, FW_AT_SYSID_TYPE = 2, _TIME = 20, _F0 = "
            f"{max(0.3 * hz, 0.1):.1f}, _F1 = {max(3.0 * hz, 0.2):.1f}; it is flown with the "
            "roll loop"
        )
        yield "autotune", text


def _far(move: SurfaceMove) -> str:
    text = f"{move.percent:g} %"
    if move.low_us is not None and move.high_us is not None:
        text += f" = {move.low_us:g} / {move.high_us:g} us"
    return text + (f" = {move.deg:.1f} deg" if move.deg is not None else "")


def _check(card: FlightTestCard) -> Iterator[Row]:
    if card.live is not None:
        yield "in the air", card.live
        yield "", "by MAVProxy: output add 127.0.0.1:14560; QGroundControl forwards, too"
    yield "landed", f"yawid inspect {BLANK} --card"
    if card.autopilot in (ARDUPILOT, PX4):
        yield "what now", "yawid damper RUN: the yaw damper's next gain, and the rudder mix"
        yield "", "yawid diff BEFORE AFTER: did the new gain do what was predicted"
