"""The live screen as a page of text: all facts of one vehicle, or a row for each of several."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import NamedTuple

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.segment import Segment
from rich.text import Text

from yawid.answers.reasons import ASK_HZ
from yawid.blocks import WINDOW_S
from yawid.results.excitation import LEAST_STROKE
from yawid.sinks.door import plain
from yawid.sinks.pages import Grid, rich_table
from yawid.sinks.run_page import in_columns, manoeuvre_grid
from yawid.sinks.terminal.console import LiveFacts, VehicleFacts, states_of
from yawid.sinks.words import conditions, counted, duration, dutch_roll, whose

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
HANDS_OFF_S = 8.0
"""For so long a pilot leaves the rudder alone: the rest that ends a manoeuvre, and a margin."""
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
            yield Text(plain(f"yawid: {self.facts.line}"))
            return
        room = MOST_LINES if self.is_last else height - LEAST_EVENTS - 1
        page = _one if len(self.facts.vehicles) == 1 else _several
        options = options.update(height=None)
        lines = console.render_lines(page(self.facts, width, room), options, pad=False)
        for line in lines:
            yield from (Segment(plain(each.text), each.style) for each in line)
            yield Segment.line()
        if not self.is_last:
            yield Group(*_events(self.said, width, height - len(lines) - 1))


class Step(NamedTuple):
    """What the pilot should do next: in a word or two, in full, and the style of that in rich."""

    short: str
    text: str
    style: str = ""


def what_to_do(vehicle: VehicleFacts) -> Step:
    """Return what the pilot should do next."""
    missing = [name for name in ("rudder", "yaw") if not getattr(vehicle, name)]
    left_s = WINDOW_S - vehicle.rests_s
    if vehicle.quiet:
        short = f"silent {vehicle.quiet.partition(' for ')[2]}"
        return Step(short, "wait: nothing is received, so nothing is recorded", "red")
    if missing:
        said = f"wait: no {' and no '.join(missing)} yet; ask for it at {ASK_HZ} Hz"
        return Step("waiting", said, "yellow")
    if not vehicle.state:
        return Step("waiting", "wait: the message rates are measured for five seconds", "yellow")
    if vehicle.held:
        return Step(vehicle.held, f"wait: no sample is used now: {vehicle.held}", "yellow")
    if vehicle.lacks:
        return Step("lacks", vehicle.lacks, "yellow")
    if not vehicle.finds:
        return Step("move it", "move the rudder: only the stream answers, as --manoeuvres is off")
    if vehicle.from_s is None and vehicle.unanswered:
        said = "wait: a manoeuvre is being estimated; or fly the next one"
        return Step("estimated", said, "cyan")
    if vehicle.from_s is None and vehicle.stroke is None:
        said = "move the rudder; it takes some seconds to find how it follows the aileron"
        return Step("move it", said)
    if vehicle.from_s is None:
        said = f"doublet, {_NEEDED} of half travel or more; then hands off for {HANDS_OFF_S:g} s"
        return Step("move it", said)
    if not vehicle.is_excited:
        return Step("move it more", "move the rudder more", "yellow")
    if vehicle.rests_s < MOVING_S:
        said = f"enough: rudder to neutral, then let go for {WINDOW_S:.0f} s or more"
        return Step(f"moves, {vehicle.lasted_s:.0f} s", said, "green")
    if left_s < 0.5:
        said = "let go: the manoeuvre ends when the yaw rate has decayed"
        return Step("let go", said, "green")
    return Step("let go", f"let go: the manoeuvre needs {left_s:.0f} s more of rest", "green")


def _one(facts: LiveFacts, width: int, room: int) -> Group:
    """Return the page of a single vehicle."""
    [vehicle] = facts.vehicles
    _, to_do, style = what_to_do(vehicle)
    meter = _bar(vehicle.stroke, BAR)
    meter.append(f" of half travel in {WINDOW_S:.0f} s; {_NEEDED} needed")
    flows = (("rudder", vehicle.rudder, vehicle.rudder_hz), ("yaw", vehicle.yaw, vehicle.yaw_hz))
    channels = [
        f"{name} {of}{_hz(hz)}" if of else f"{name} not known yet" for name, of, hz in flows
    ]
    head = [
        *_link(facts, vehicle.name, width, vehicle.quiet),
        *_wrapped("", ", ".join(channels), width),
        Text(),
        _row("RUDDER", meter),
        _row("NEXT", Text(to_do, style)),
        _row("RECORDING", Text(_recording(vehicle))),
    ]
    stream = _wrapped("STREAM", vehicle.stream or "nothing is estimated yet", width)
    foot = [*_answer(vehicle, width), *stream]
    newest = vehicle.manoeuvres[-max(room - len(head) - len(foot) - 3, 1) :]
    table: list[RenderableType] = (
        [rich_table(manoeuvre_grid(newest, vehicle.flights)), Text()] if newest else []
    )
    return Group(*head, Text(), *table, *foot)


def _several(facts: LiveFacts, width: int, room: int) -> Group:
    """Return the page of no or several vehicles; where not all fit, the most urgent are shown."""
    vehicles = facts.vehicles
    about = f"{len(vehicles) or 'no'} vehicles{'' if vehicles else ' yet'}"
    link = [*_link(facts, about, width), Text()]
    rows = max(room - len(link) - 2, 1)
    in_turn = sorted(vehicles, key=lambda each: each.urgency)
    shown = sorted(in_turn[:rows], key=lambda each: each.sysid)
    rest = states_of(in_turn[rows:])
    more = Text(f"and {len(in_turn) - rows} more: {rest}") if rest else Text(_LEGEND, "dim")
    heads = ("sys", "msg/s", "rudder", "now", "n", "wn rad/s", "zeta", "verdict")
    styles = ["red" if vehicle.quiet else "" for vehicle in shown]
    table = Grid(heads, [list(_cells(vehicle)) for vehicle in shown], styles, texts=(2, 3, 7))
    below: list[RenderableType] = [rich_table(table), more] if shown else []
    return Group(*link, *below)


def _cells(vehicle: VehicleFacts) -> Iterator[str]:
    yield str(vehicle.sysid)
    yield f"{vehicle.message_hz:.0f}"
    yield _bar(vehicle.stroke, SHORT_BAR).plain
    yield what_to_do(vehicle).short
    usable = sum(len(each.used) for each in vehicle.flights)
    yield f"{usable}/{len(vehicle.manoeuvres)}" if vehicle.manoeuvres else "-"
    yield from in_columns(vehicle.flights[0].dutch_roll if vehicle.flights else None)
    if vehicle.verdict is None:
        yield vehicle.state
    else:
        why = vehicle.why[0].partition(":")[0] if vehicle.why else "not usable"
        yield "usable" if vehicle.verdict else why


def _link(facts: LiveFacts, about: str, width: int, quiet: str = "") -> Iterator[Text]:
    """Yield the title and the rows of the link; a dead one is shown in red, with its silence."""
    begin, end = f" yawid live  {facts.endpoint}  {about}", f"{duration(facts.lasted_s)} "
    yield Text(f"{begin:<{width - len(end)}}"[: width - len(end)] + end, "reverse")
    age_s = facts.lasted_s if facts.age_s is None else facts.age_s
    if age_s > DEAD_S:
        yet = "yet " if facts.age_s is None else ""
        quiet = f"nothing received {yet}for {duration(age_s)}"
    if quiet:
        yield _row("LINK", Text(f" {quiet.upper()} ", _RED))
    if quiet and facts.age_s is None and facts.to_send:
        yield from _wrapped("SENDER", facts.to_send, width)
    lost, rate = (sum(getattr(each, n) for each in facts.vehicles) for n in ("lost", "message_hz"))
    text = Text(f"{rate:.0f} msg/s, ")
    text.append(f"lost {lost}", "yellow" if lost else "").append(", ")
    text.append(f"dropped {facts.dropped}", "" if facts.dropped == "0" else "red")
    if facts.age_s is not None:
        text.append(f", last message {facts.age_s:.1f} s ago")
    yield _row("" if quiet else "LINK", text)


def _bar(stroke: float | None, size: int) -> Text:
    """Return a bar of ``size`` columns with a mark at the threshold, and the stroke in percent."""
    mark, full = round(size * LEAST_STROKE / SCALE), 0.0 if stroke is None else stroke / SCALE
    filled = min(round(size * full), size)
    bar = f"{'█' * filled}{'·' * (size - filled)}"
    enough = stroke is not None and stroke >= LEAST_STROKE
    text = Text(f"{bar[:mark]}|{bar[mark:]}{'>' if full > 1.0 else ' '}")
    text.stylize("green" if enough else "yellow", 0, size + 1)
    return text.append("  ? %" if stroke is None else f"{100 * min(stroke, 9.99):3.0f} %", "bold")


def _recording(vehicle: VehicleFacts) -> str:
    """Return the manoeuvre being recorded and the number of those answered."""
    count, waiting = len(vehicle.manoeuvres), vehicle.unanswered
    so_far = f"{count or 'none'} answered{f', {waiting} being estimated' if waiting else ''}"
    if vehicle.from_s is None:
        return f"nothing; {so_far}"
    begun = f"manoeuvre {count + waiting + 1} from {vehicle.from_s:.0f} s on"
    return f"{begun}, {vehicle.lasted_s:.0f} s long; {so_far}"


def _answer(vehicle: VehicleFacts, width: int) -> Iterator[Text]:
    """Yield the rows of the flight's answers, and of the present verdict."""
    for i, flight in enumerate(vehicle.flights):
        roll = flight.dutch_roll
        answer = "no answer" if roll is None else dutch_roll(roll)
        yield _row("ALSO" if i else "FLIGHT", Text(answer if i else f"{answer}  (± is one sigma)"))
        of = f"of {whose(flight)}" if len(vehicle.flights) > 1 else ""
        facts = of, conditions(flight), counted(flight, vehicle.manoeuvres)
        yield from _wrapped("", ", ".join(filter(None, facts)), width)
    if vehicle.verdict is None:
        yield _row("VERDICT", Text("none yet: no manoeuvre has been answered"))
        return
    word, style = ("usable", "green") if vehicle.verdict else ("NOT USABLE", "red")
    why = [*_wrapped("VERDICT", "; ".join((word, *vehicle.why)), width)][:MOST_WHY]
    why[0].stylize(f"bold {style}", NAME_WIDTH, NAME_WIDTH + len(word))
    yield from why


def _events(said: Said, width: int, room: int) -> list[RenderableType]:
    """Return the latest messages, as many lines as there is room for."""
    lines: list[RenderableType] = []
    for clock, text in reversed(said):
        rows = list(_wrapped(clock, text, width))
        if len(lines) + len(rows) > room:
            break
        lines = [*rows, *lines]
    return [Text("─" * width, "dim"), *lines]


def _row(name: str, text: Text) -> Text:
    return Text().append(f"{name:<{NAME_WIDTH}}", "dim").append_text(text)


def _wrapped(name: str, text: str, width: int) -> Iterator[Text]:
    for i, line in enumerate(wrap(text, width - NAME_WIDTH, break_on_hyphens=False) or [""]):
        yield _row("" if i else name, Text(line))


def _hz(rate: float) -> str:
    return f" {rate:.1f} Hz" if 0.0 < rate < 10.0 else f" {rate:.0f} Hz"
