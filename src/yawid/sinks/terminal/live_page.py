"""The live screen as a page of text: all facts of one vehicle, or a row for each of several."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from textwrap import wrap

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from yawid.blocks import WINDOW_S
from yawid.results.excitation import LEAST_STROKE
from yawid.sinks.flight_table import in_columns, manoeuvre_grid
from yawid.sinks.pages import rich_table
from yawid.sinks.terminal.live_facts import LiveFacts, VehicleFacts
from yawid.sinks.words import NEXT, conditions, counted, dutch_roll, whose

LEAST_WIDTH, LEAST_HEIGHT = 72, 20
"""A smaller window has no room for the page and shows one line."""
DEAD_S = 1.2
"""A link with no data for this long is shown as dead, so that a person sees it within 2 s."""
NAME_WIDTH = 10
SCALE = 0.5
"""The end of the meter's scale, as a part of half the travel."""
BAR, SHORT_BAR = 20, 5
MOVING_S = 1.0
"""A rudder that has rested for less than this is still moving."""
LEAST_EVENTS, MOST_WHY, MOST_LINES = 3, 3, 60
"""The least number of lines for messages, and the largest for a verdict's reasons and for the
page that stays at the end."""
_NEEDED = f"{100 * LEAST_STROKE:.0f} %"
_LEGEND = (
    f"rudder: how far it moved by itself in {WINDOW_S:.0f} s, {_NEEDED} needed; ± is one sigma"
)
_RED = "bold white on red"
Said = Sequence[tuple[str, str]]
"""The messages so far, each as (time of day, text), the newest last."""


@dataclass(frozen=True, slots=True)
class Page:
    """A page with the facts and the messages, in the size of the window.

    The page that stays when the screen is left (``is_last``) has all its lines and no messages.
    """

    facts: LiveFacts
    said: Said
    is_last: bool = False

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the page's lines, as rich's protocol asks for."""
        width, height = options.max_width, console.height
        if not self.is_last and (width < LEAST_WIDTH or height < LEAST_HEIGHT):
            yield Text(f"yawid: {self.facts.line}")
            return
        room = MOST_LINES if self.is_last else height - LEAST_EVENTS - 1
        page = _one if len(self.facts.vehicles) == 1 else _several
        options = options.update(height=None)
        lines = console.render_lines(page(self.facts, width, room), options, pad=False)
        for line in lines:
            yield from line
            yield Segment.line()
        if not self.is_last:
            yield Group(*_events(self.said, width, height - len(lines) - 1))


def what_to_do(vehicle: VehicleFacts) -> tuple[str, str]:
    """Return what the pilot should do next, in words, and the style of these words in rich."""
    if vehicle.quiet:
        return "wait: nothing is received, so nothing is recorded", "red"
    if not vehicle.rudder or not vehicle.yaw:
        missing = [name for name in ("rudder", "yaw") if not getattr(vehicle, name)]
        return f"wait: no {' and no '.join(missing)} yet", "yellow"
    if not vehicle.state:
        return "wait: the message rates are measured for five seconds", "yellow"
    if vehicle.held:
        return f"wait: no sample is used now: {vehicle.held}", "yellow"
    if not vehicle.finds:
        return "move the rudder: only the stream answers, as --manoeuvres is off", ""
    if vehicle.from_s is None:
        if vehicle.unanswered:
            return "wait: a manoeuvre is being estimated; or fly the next one", "cyan"
        if vehicle.stroke is None:
            return "move the rudder; it takes some seconds to find how it follows the aileron", ""
        return f"move the rudder: a doublet of more than {_NEEDED} of half travel", ""
    if not vehicle.is_excited:
        return "move the rudder more", "yellow"
    if vehicle.rests_s < MOVING_S:
        return f"enough: rudder to neutral, then let go for {WINDOW_S:.0f} s or more", "green"
    left_s = WINDOW_S - vehicle.rests_s
    if left_s < 0.5:
        return "let go: the manoeuvre ends when the yaw rate has decayed", "green"
    return f"let go: the manoeuvre needs {left_s:.0f} s more of rest", "green"


def _one(facts: LiveFacts, width: int, room: int) -> Group:
    """Return the page of a single vehicle."""
    [vehicle] = facts.vehicles
    head = [
        _title(facts, vehicle.name, width),
        *_link(facts, vehicle, width),
        Text(),
        _row("RUDDER", _meter(vehicle)),
        _row("NEXT", Text(*what_to_do(vehicle))),
        _row("RECORDING", _recording(vehicle)),
    ]
    stream = _wrapped("STREAM", vehicle.stream or "nothing is estimated yet", width)
    foot = [*_answer(vehicle, width), *stream]
    rows = room - len(head) - len(foot) - 3
    newest = vehicle.manoeuvres[-max(rows, 1) :]
    table = (
        (Text(), rich_table(manoeuvre_grid(newest, vehicle.flights)), Text())
        if newest
        else (Text(),)
    )
    return Group(*head, *table, *foot)


def _several(facts: LiveFacts, width: int, room: int) -> Group:
    """Return the page of no or several vehicles; where not all fit, the most urgent are shown."""
    vehicles = facts.vehicles
    lost, rate = sum(v.lost for v in vehicles), sum(v.message_hz for v in vehicles)
    title = _title(facts, f"{len(vehicles) or 'no'} vehicles{'' if vehicles else ' yet'}", width)
    dead = [_row("LINK", Text(f" {quiet.upper()} ", _RED))] if (quiet := _dead(facts)) else []
    counts = _row("" if dead else "LINK", _counts(facts, rate, lost))
    if facts.age_s is None and facts.to_send:
        dead += _wrapped("SENDER", facts.to_send, width)
    link = [*dead, counts, Text()]
    rows = room - len(link) - 3
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for name in ("sys", "msg/s"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("rudder", "now"):
        table.add_column(name, no_wrap=True)
    for name in ("n", "wn rad/s", "zeta"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True, overflow="ellipsis")
    in_turn = (
        sorted(vehicles, key=lambda each: each.urgency) if len(vehicles) > rows else list(vehicles)
    )
    shown, others = in_turn[: max(rows, 1)], in_turn[max(rows, 1) :]
    for vehicle in sorted(shown, key=lambda each: each.sysid):
        table.add_row(*_cells(vehicle), style="red" if vehicle.quiet else "")
    states = Counter(vehicle.state or "waiting" for vehicle in others).most_common()
    rest = ", ".join(f"{count} {state}" for state, count in states)
    more = [Text(f"and {len(others)} more: {rest}")] if others else []
    if not others and shown:
        more = [Text(_LEGEND, "dim")]
    return Group(title, *link, *([table] if shown else []), *more)


def _cells(vehicle: VehicleFacts) -> Iterator[RenderableType]:
    yield str(vehicle.sysid)
    yield f"{vehicle.message_hz:.0f}"
    yield _bar(vehicle.stroke, SHORT_BAR)
    yield _now(vehicle)
    flight = next(iter(vehicle.flights), None)
    usable = sum(len(each.used) for each in vehicle.flights)
    yield f"{usable}/{len(vehicle.manoeuvres)}" if vehicle.manoeuvres else "-"
    yield from in_columns(None if flight is None else flight.dutch_roll)
    if vehicle.verdict is None:
        yield Text(vehicle.state, "dim")
    elif vehicle.verdict:
        yield Text("usable", "green")
    else:
        yield Text(vehicle.why[0].partition(":")[0] if vehicle.why else "not usable", "red")


def _now(vehicle: VehicleFacts) -> str:
    """Return in a few words what the vehicle is doing."""
    if vehicle.quiet:
        return f"silent {vehicle.quiet.partition(' for ')[2]}"
    if vehicle.held or not vehicle.state:
        return vehicle.held or "waiting"
    if vehicle.from_s is not None:
        if not vehicle.is_excited:
            return "move it more"
        return f"moves, {vehicle.lasted_s:.0f} s" if vehicle.rests_s < MOVING_S else "let go"
    return "estimated" if vehicle.unanswered else "move it"


def _title(facts: LiveFacts, about: str, width: int) -> Text:
    begin, end = f" yawid live  {facts.endpoint}  {about}", f"{_span(facts.lasted_s)} "
    return Text(f"{begin:<{width - len(end)}}"[: width - len(end)] + end, "reverse")


def _link(facts: LiveFacts, vehicle: VehicleFacts, width: int) -> Iterator[Text]:
    """Yield the rows of a link and its channels; a dead link is shown in red, with its silence."""
    if quiet := _dead(facts) or vehicle.quiet:
        yield _row("LINK", Text(f" {quiet.upper()} ", _RED))
    else:
        yield _row("LINK", _counts(facts, vehicle.message_hz, vehicle.lost))
    rudder = f"{vehicle.rudder} {_hz(vehicle.rudder_hz)}" if vehicle.rudder else "not known yet"
    yaw = f"{vehicle.yaw} {_hz(vehicle.yaw_hz)}" if vehicle.yaw else "not known yet"
    if quiet:
        yield _row("", _counts(facts, vehicle.message_hz, vehicle.lost))
    yield from _wrapped("", f"rudder {rudder}, yaw {yaw}", width)


def _counts(facts: LiveFacts, rate: float, lost: int) -> Text:
    text = Text(f"{rate:.0f} msg/s, ")
    text.append(f"lost {lost}", "yellow" if lost else "").append(", ")
    text.append(f"dropped {facts.dropped}", "" if facts.dropped == "0" else "red")
    if facts.age_s is not None:
        age = f"{facts.age_s:.1f} s" if facts.age_s < 10.0 else _span(facts.age_s)
        text.append(f", last message {age} ago")
    return text


def _dead(facts: LiveFacts) -> str:
    """Return a text on how long no data have come, "" while they come."""
    age_s = facts.lasted_s if facts.age_s is None else facts.age_s
    yet = "yet " if facts.age_s is None else ""
    return f"nothing received {yet}for {_span(age_s)}" if age_s > DEAD_S else ""


def _meter(vehicle: VehicleFacts) -> Text:
    """Return a bar with how far the rudder moved on its own, and how far it needs to."""
    text = _bar(vehicle.stroke, BAR)
    text.append(f" of half travel in {WINDOW_S:.0f} s; {_NEEDED} needed")
    return text


def _bar(stroke: float | None, size: int) -> Text:
    """Return a bar of ``size`` columns with a mark at the threshold, and the stroke in percent."""
    mark, full = round(size * LEAST_STROKE / SCALE), 0.0 if stroke is None else stroke / SCALE
    filled = min(round(size * full), size)
    style = "green" if stroke is not None and stroke >= LEAST_STROKE else "yellow"
    text = Text()
    for first, stop in ((0, mark), (mark, size)):
        solid = min(max(filled - first, 0), stop - first)
        text.append("|", "bold") if first else None
        text.append("█" * solid, style).append("·" * (stop - first - solid), "dim")
    text.append(">" if full > 1.0 else " ")
    return text.append("  ? %" if stroke is None else f"{100 * min(stroke, 9.99):3.0f} %", "bold")


def _recording(vehicle: VehicleFacts) -> Text:
    """Return the manoeuvre being recorded and the number of those answered."""
    count = len(vehicle.manoeuvres)
    number = count + vehicle.unanswered + 1
    waits = f", {vehicle.unanswered} being estimated" if vehicle.unanswered else ""
    so_far = f"{count or 'none'} answered{waits}"
    if vehicle.from_s is None:
        return Text(f"nothing; {so_far}")
    begun = f"manoeuvre {number} from {vehicle.from_s:.0f} s on, {vehicle.lasted_s:.0f} s long"
    return Text().append(begun, "bold").append(f"; {so_far}")


def _answer(vehicle: VehicleFacts, width: int) -> Iterator[Text]:
    """Yield the rows of the flight's answers, and of the present verdict."""
    for flight in vehicle.flights:
        count, roll = counted(flight, vehicle.manoeuvres), flight.dutch_roll
        answer, where = "no answer", ""
        if roll is not None:
            answer, where = dutch_roll(roll), conditions(flight)
        is_first = flight is vehicle.flights[0]
        line = Text().append(answer, "bold" if is_first else "")
        line.append("  (± is one sigma)" if is_first else "")
        yield _row("FLIGHT" if is_first else "ALSO", line)
        of = f"of {whose(flight)}" if len(vehicle.flights) > 1 else ""
        yield from _wrapped("", ", ".join(filter(None, (of, where, count))), width)
    if vehicle.verdict is None:
        yield _row("VERDICT", Text("none yet: no manoeuvre has been answered"))
        return
    word = Text("usable", "bold green") if vehicle.verdict else Text("NOT USABLE", "bold red")
    said = "; ".join((word.plain, *vehicle.why))
    why = wrap(said, width - NAME_WIDTH, max_lines=MOST_WHY)
    yield _row("VERDICT", Text().append_text(word).append(why[0][len(word.plain) :]))
    yield from (_row("", Text(line)) for line in why[1:])
    if vehicle.next:
        yield from _wrapped("", f"{NEXT} {vehicle.next}", width)


def _events(said: Said, width: int, room: int) -> list[RenderableType]:
    """Return the latest messages, as many lines as there is room for."""
    lines: list[RenderableType] = []
    for clock, text in reversed(said):
        parts = wrap(text, width - NAME_WIDTH, break_on_hyphens=False) or [""]
        rows: list[RenderableType] = [_row(clock, Text(parts[0]))]
        rows += [Text(" " * NAME_WIDTH + part) for part in parts[1:]]
        if len(lines) + len(rows) > room:
            break
        lines = rows + lines
    return [Text("─" * width, "dim"), *lines]


def _row(name: str, text: Text) -> Text:
    return Text().append(f"{name:<{NAME_WIDTH}}", "dim").append_text(text)


def _wrapped(name: str, text: str, width: int) -> Iterator[Text]:
    for i, line in enumerate(wrap(text, width - NAME_WIDTH, break_on_hyphens=False)):
        yield _row(name if i == 0 else "", Text(line))


def _hz(rate: float) -> str:
    return f"{rate:.1f} Hz" if 0.0 < rate < 10.0 else f"{rate:.0f} Hz"


def _span(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
