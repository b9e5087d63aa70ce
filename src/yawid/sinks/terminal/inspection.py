"""The page of ``yawid inspect``, to be read in ten seconds, and its flight test card.

The card is one page of paper: what to fly next, in the order of the flight.
"""

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from yawid.answers.flight_test_card import FlightTestCard, ParameterToSet, SurfaceMove
from yawid.answers.inspection import FlightPhase, Inspection, MessageRate, Span
from yawid.quantities.airspeed import GROUND_SPEED
from yawid.quantities.vehicles import AIRFRAME, ARDUPILOT, PX4
from yawid.results.make_card import why_no_card
from yawid.sinks.door import WIDTH
from yawid.sinks.pages import NAME_WIDTH, Note, Part, verdict_parts
from yawid.sinks.run_page import manoeuvre_grid, origin
from yawid.sinks.words import Row, count, dutch_roll, flight_rows

MOST_PHASES = 6
LEAST_PHASE_S = 3.0
MOST_WINDOWS = 6
MOST_SENDERS = 8


def inspection_page(report: Inspection) -> Iterator[Part]:
    """Yield what a log can answer: verdict, channels, phases and stretches, and what to do."""
    yield Note(report.log, "bold", wraps=False)
    rows = (Row(*each) for each in _rows(report))
    yield from (*verdict_parts(report.deciding), *origin(report), *rows)
    if report.flight is not None:
        flights, found = report.flights or [report.flight], report.manoeuvres or []
        *answers, _ = flight_rows(flights, found, report.vehicle)  # how it was flown stands above
        yield from answers
        if flights[0].dutch_roll is not None:
            yield manoeuvre_grid(found, flights)
    if report.command is not None:
        # The command that was tried is for copying: it must not be wrapped.
        word = "try" if report.exit_code == 0 else "tried"
        yield Note(f"{word:>{NAME_WIDTH - 1}}  {report.command}", wraps=False)


def _rows(report: Inspection) -> Iterator[tuple[str, str]]:
    if report.vehicle is not None:
        seen = report.vehicle
        address = f"{seen.sysid}/{seen.compid}"
        yield "vehicle", f"{seen.kind}, {address}, log of {report.duration_s:.0f} s"
    senders = sorted(report.by_sender.items(), key=lambda each: -each[1]["frames"])
    yield "senders", _first([_sender(*each) for each in senders], MOST_SENDERS)
    if report.unchecked is not None:
        yield "signing", report.unchecked
    if report.rates:
        rates = ", ".join(f"{name} {_interval(each)}" for name, each in report.rates.items())
        yield "interval", rates.replace("(", "(5-95 %: ", 1)
    if report.phases:
        yield "phases", _phases(report.phases)
    windows = [f"{_boot(s)}{s.from_s:g} to {s.to_s:g} s" for s in report.excited]
    yield "excited", _first(windows, MOST_WINDOWS) if windows else "nowhere"
    if report.answerable is not None:
        most, well = report.answerable.wn_max_rad_s, report.answerable.wn_well_rad_s
        yield (
            "answers",
            f"Dutch rolls with wn up to {most:.3g} rad/s, and well up to {well:.3g} rad/s",
        )
    for name, can in (report.can or {}).items():
        lacks = "see the verdict" if name == "flown" else _first(can.lacks, 1)
        yield name, "yes" if can.yes else f"no: {lacks}"
    for line in report.record or ():
        if line not in (report.deciding.next or ""):
            yield "record", line


def _sender(name: str, counts: Mapping[str, int]) -> str:
    """Return a text on one sender: its frames, and its other counts that are not zero."""
    others = [f"{n} {key.replace('_', ' ')}" for key, n in counts.items() if n and key != "frames"]
    return f"{name} ({', '.join([str(counts['frames']), *others])})"


def _interval(rate: MessageRate) -> str:
    low, middle, high = rate.interval_p5_s, rate.interval_median_s, rate.interval_p95_s
    return f"{1e3 * middle:.3g} ms ({1e3 * low:.3g} to {1e3 * high:.3g})"


def _phases(phases: Sequence[FlightPhase]) -> str:
    """Return the longest phases in their order, and the number of shorter ones."""
    lasts = sorted((phase.to_s - phase.from_s for phase in phases), reverse=True)
    least_s = max(lasts[:MOST_PHASES][-1], LEAST_PHASE_S)
    shown = [phase for phase in phases if phase.to_s - phase.from_s >= least_s][:MOST_PHASES]
    rest = len(phases) - len(shown)
    named = ", ".join(map(_phase, shown)) or f"none of {LEAST_PHASE_S:g} s"
    return named + (f", and {rest} shorter" if rest else "")


def _phase(phase: FlightPhase) -> str:
    words = [word for word in (phase.mode, phase.state) if word is not None]
    return " ".join((f"{_boot(phase)}{phase.from_s:.0f} to {phase.to_s:.0f} s", *words))


def _boot(span: Span) -> str:
    return "" if span.boot is None or span.boot <= 1 else f"boot {span.boot}: "


def _first(texts: Sequence[str], most: int) -> str:
    rest = len(texts) - most
    return ", ".join(texts[:most]) + (f", and {rest} more" if rest > 0 else "")


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
Line = tuple[str, str]


def card_page(report: Inspection) -> Iterator[Part]:
    """Yield the lines of the card, or one with the reason why there is none."""
    card = report.card
    if card is None:
        reason = why_no_card(report.vehicle, report.deciding)
        yield Note(f"{reason}: {report.log}", wraps=False)
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
    yield from (Note(line.rstrip(), wraps=False) for line in lines)


def _table(cells: Iterable[str]) -> str:
    row = "  ".join(f"{cell:<{n}}" for cell, n in zip(cells, COLUMNS.values(), strict=True))
    return f"{'flown' if 'time' in row else '':<{NAMES}}{row}"


def _lines(rows: Iterator[Line]) -> Iterator[str]:
    """Yield the lines of rows, each text next to its name; words are not broken."""
    for name, text in rows:
        body = textwrap.wrap(text, WIDTH - NAMES, break_long_words=False, break_on_hyphens=False)
        for i, line in enumerate(body):
            yield f"{name if i == 0 else '':<{NAMES}}{line}"


def _known(report: Inspection, card: FlightTestCard) -> Iterator[Line]:
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


def _before(card: FlightTestCard) -> Iterator[Line]:
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


def _rates(card: FlightTestCard) -> Iterator[Line]:
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


def _flight(card: FlightTestCard) -> Iterator[Line]:
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
    yield "or", f"{turns}, of the bare airframe, without any rudder"


def _manoeuvre(card: FlightTestCard) -> Iterator[Line]:
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


def _aileron(card: FlightTestCard) -> Iterator[Line]:
    """Yield the aileron's doublet that makes the bare airframe known."""
    asked = card.aileron
    if asked is None:
        return
    side, zeta_std = f"{asked.side_s:.2g} s", asked.expected.zeta_std or 0.0
    text = (
        f"once, {asked.after_s:.2g} s after the last doublet: right {side}, left {side}, neutral; "
        f"{_far(asked.amplitude)}, bank 10 deg at most. ATTITUDE and outputs at {asked.ask_hz:g} "
        f"Hz. Expect of the bare airframe wn ± {asked.expected.wn_std:.2g}, "
        f"zeta ± {zeta_std:.2g}"
    )
    yield "aileron", text


def _automatic(card: FlightTestCard) -> Iterator[Line]:
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


def _check(card: FlightTestCard) -> Iterator[Line]:
    if card.live is not None:
        yield "in the air", card.live
        yield "", "by MAVProxy: output add 127.0.0.1:14560; QGroundControl forwards, too"
    yield "landed", f"yawid inspect {BLANK} --card"
    if card.autopilot in (ARDUPILOT, PX4):
        yield "what now", "yawid damper RUN: the yaw damper's next gain, and the rudder mix"
        yield "", "yawid diff BEFORE AFTER: did the new gain do what was predicted"
