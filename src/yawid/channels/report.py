"""What a run's channels have to say at its end, or at any time: a frozen struct for the summary.

Reasons are pairs of id and text: what an id means is said in ``results/reasons.py``.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

from yawid.blocks import Held
from yawid.channels.find_surface import why_no_surface
from yawid.channels.grid_rate import RATE_TOLERANCE
from yawid.channels.parameters import STOCK_TRAVEL_US
from yawid.channels.stage import Channels
from yawid.channels.surface import STICKS, Surface
from yawid.channels.surface_reader import LEAST_SHARE, TOLERANCE, Twins
from yawid.channels.vehicle import Vehicle
from yawid.channels.yaw_reader import COARSE, SOURCES

Said = tuple[str, str]
"""The id of a reason, and its text."""


@dataclass(frozen=True, slots=True)
class ChannelSource:
    """Where a channel comes from, how it was found, its travel, and how often it comes.

    ``rate_hz`` is of the first seconds, which chose the grid, unless ``first_rate_hz`` stands
    beside it: then it is the whole run's, which is another by more than its jitter.
    """

    source: str = ""
    how: str | None = None
    min_us: float | None = None
    trim_us: float | None = None
    max_us: float | None = None
    reversed: bool | None = None
    rate_hz: float | None = None
    first_rate_hz: float | None = None


@dataclass(frozen=True, slots=True)
class ChannelReport:
    """What the channels have to say.

    ``vehicles`` are all on the link, by the fields of their addresses; ``boots_us`` is what each
    boot covers, in microseconds since it. ``missing`` says which of rudder and yaw there is not,
    where a vehicle was found; ``why_no_vehicle`` why none was. ``reasons`` are what is assumed of
    the channels; ``commands`` gives those of a rudder that commanded nothing, where it is told why
    it is believed all the same. ``rates_hz`` are those of yaw and rudder in the first seconds, None
    without samples, ``later_hz`` those of the whole run. ``used`` samples update the estimators,
    ``held`` is why others do not. ``rudder_message`` is the one that a rudder was found in, and
    ``has_functions`` says whether any servo has one.
    """

    is_record: bool
    vehicle: Vehicle | None
    vehicles: list[dict[str, int]]
    why_no_vehicle: str
    boots_us: Mapping[int, tuple[float, float]]
    reboots: int
    clock_steps: int
    gaps: int
    leap_us: int
    channels: Mapping[str, ChannelSource]
    rudder_message: str | None
    has_functions: bool
    missing: tuple[Said, ...]
    reasons: tuple[Said, ...]
    commands: Callable[[Callable[[], str]], Iterable[Said]]
    rates_hz: tuple[float, float] | None
    later_hz: tuple[float, float]
    used: int
    held: Held


def report_of(channels: Channels) -> ChannelReport:
    """Return what these channels have to say as they stand; it is cheap."""
    lock, segmenter, aligner = channels.lock, channels.segmenter, channels.aligner
    intervals_us, (yaw_flow, rudder_flow) = channels.intervals_us, channels.flows
    return ChannelReport(
        is_record=channels.is_record,
        vehicle=lock.vehicle,
        vehicles=lock.vehicles,
        why_no_vehicle="" if lock.vehicle else lock.why_none(),
        boots_us=dict(channels.boots.spans_us),
        reboots=segmenter.reboots,
        clock_steps=segmenter.clock_steps,
        gaps=segmenter.silences + (0 if aligner is None else aligner.gaps),
        leap_us=segmenter.leap_us,
        channels=_sources(channels),
        rudder_message=channels.surfaces[0].message if channels.surfaces else None,
        has_functions=any(channels.parameters.functions().values()),
        missing=tuple(_missing(channels)),
        reasons=tuple(_assumed(channels)),
        commands=partial(channels.command.texts, lock.vehicle),
        rates_hz=intervals_us and (1e6 / intervals_us[0], 1e6 / intervals_us[1]),
        later_hz=(yaw_flow.rate_hz, rudder_flow.rate_hz),
        used=channels.used,
        held=channels.held,
    )


def _sources(channels: Channels) -> dict[str, ChannelSource]:
    yaw_rate, surface_rate = ChannelSource(), ChannelSource()
    if channels.intervals_us is not None:
        yaw_rate, surface_rate = (
            _rate(1e6 / interval_us, flow.rate_hz)
            for interval_us, flow in zip(channels.intervals_us, channels.flows, strict=True)
        )
    found = {
        name: _source_of(surface, channels.twins, surface_rate)
        for name, surface in zip(channels.config.inputs, channels.surfaces, strict=False)
    }
    if channels.yaw.rows:
        found["yaw"] = replace(yaw_rate, source=channels.yaw.label)
    return found


def _rate(first_hz: float, whole_hz: float) -> ChannelSource:
    changed = abs(whole_hz - first_hz) > (RATE_TOLERANCE - 1.0) * first_hz
    rates = (whole_hz, first_hz) if changed else (first_hz, None)
    return ChannelSource(rate_hz=rates[0], first_rate_hz=rates[1])


def _source_of(surface: Surface, twins: Twins, rate: ChannelSource) -> ChannelSource:
    found = replace(rate, source=surface.source, how=twins.how(surface))
    first = surface.parts[0]
    if first.travel_us is None:
        return found
    low, trim, high = first.travel_us
    return replace(found, min_us=low, trim_us=trim, max_us=high, reversed=first.reversed)


def _missing(channels: Channels) -> Iterator[Said]:
    vehicle, surfaces = channels.lock.vehicle, channels.surfaces
    if vehicle is None:  # or a record: it was refused, or has both
        return
    # Without a yaw source no servo message has a time: that is no_yaw, not no_rudder.
    if not surfaces:
        named = " or ".join(channels.config.inputs)
        yield "no_rudder", why_no_surface(named, vehicle, channels.parameters)
    elif channels.surface_rows == 0 and channels.yaw.rows > 0:
        yield "no_rudder", f"no message carries {surfaces[0].source}"
    if channels.yaw.rows == 0:
        yield "no_yaw", f"none of {', '.join(SOURCES)} comes from the vehicle"


def _assumed(channels: Channels) -> Iterator[Said]:
    """Yield what is assumed of the channels, all texts of one id together."""
    texts: dict[str, list[str]] = {}
    if channels.yaw.source in COARSE:
        texts["channel_stand_in"] = [
            f"the yaw rate is made from {channels.yaw.label}: coarse, slow"
        ]
    if channels.units_assumed:
        text = f"nothing says the unit of {', '.join(channels.units_assumed)}: rad and rad/s are"
        texts["unit_assumed"] = [f"{text} assumed"]
    for name, surface in zip(channels.config.inputs, channels.surfaces, strict=False):
        for id_, text in _surface_texts(name, surface, channels.twins):
            texts.setdefault(id_, []).append(text)
    for id_, found in texts.items():
        yield id_, "; ".join(found)


def _surface_texts(name: str, surface: Surface, twins: Twins) -> Iterator[Said]:
    if "assumed" in surface.how:
        low, trim, high = surface.parts[0].travel_us or STOCK_TRAVEL_US
        yield (
            "rudder_assumed",
            f"the log does not say which channel moves the {name}, or how far: "
            f"{surface.source} with {low:g}/{trim:g}/{high:g} us is assumed",
        )
    for twin in surface.twins:
        share = twins.share_apart(surface, twin)
        if share > LEAST_SHARE:
            yield (
                "rudder_assumed",
                f"{surface.name_of(twin)} is a {name} too and differs from {surface.source} by "
                f"more than {100 * TOLERANCE:.0f} % of half the travel in {100 * share:.0f} % of "
                f"the messages: {surface.source} is assumed",
            )
    if surface.message in STICKS:
        yield "channel_stand_in", f"{surface.source} is the pilot's stick, not the {name} itself"
