"""The report of a run's channels, at its end or at any other time."""

from collections.abc import Iterator
from functools import partial

from msgspec import convert
from msgspec.structs import replace

from yawid.answers.channel_report import ChannelReport
from yawid.answers.heard import BootSpan, LinkCounts, VehicleSeen
from yawid.answers.reasons import Reason
from yawid.answers.run_summary import ChannelFound
from yawid.channels.find_surface import no_surface
from yawid.channels.grid_rate import RATE_TOLERANCE
from yawid.channels.parameters import STOCK_TRAVEL_US, ParameterTable
from yawid.channels.stage import FAST_RAD_S, Channels
from yawid.channels.surface import STICKS, Surface
from yawid.channels.surface_reader import LEAST_SHARE, TOLERANCE, Twins
from yawid.channels.yaw_reader import SOURCES

NAME_THE_STICK = (
    "Record the servo outputs; or, where the sticks moved the servos (MANUAL), name the yaw stick: "
    "--rudder rc:N (RCMAP_YAW, mostly 4)."
)
"""What to do where the pilot's sticks are in the log and no output is. A stick is the rudder in
MANUAL alone, which nothing in such a log shows: taken by itself it would be a wrong answer."""
LEAST_FAST_S = 1.0
"""For so long in all a yaw rate may be too fast to be true: a damaged message, or a crash."""


def report_of(channels: Channels) -> ChannelReport:
    """Return the report of these channels in their present state; this is cheap."""
    lock, segmenter, aligner = channels.lock, channels.segmenter, channels.aligner
    intervals_us, (yaw_flow, rudder_flow) = channels.intervals_us, channels.flows
    return ChannelReport(
        is_record=channels.record is not None,
        vehicle=convert(lock.vehicle, VehicleSeen | None, from_attributes=True),
        vehicles=convert(lock.vehicles, list[VehicleSeen]),
        why_no_vehicle="" if lock.vehicle else lock.why_none(),
        boots=[
            BootSpan(boot=number, from_s=first / 1e6, to_s=last / 1e6)
            for number, (first, last) in channels.boots.spans_us.items()
        ],
        breaks=LinkCounts(
            reboots=segmenter.reboots,
            clock_steps=segmenter.clock_steps,
            gaps=segmenter.silences + (0 if aligner is None else aligner.gaps),
            clock_leap_s=segmenter.leap_us / 1e6 if segmenter.leap_us else None,
        ),
        channels=_sources(channels),
        rudder_message=channels.surfaces[0].message if channels.surfaces else None,
        has_functions=any(channels.parameters.functions().values()),
        missing=tuple(_missing(channels)),
        reasons=tuple(_assumed(channels)),
        commands=partial(channels.command.reasons, lock.vehicle),
        rates_hz=intervals_us and (1e6 / intervals_us[0], 1e6 / intervals_us[1]),
        later_hz=(yaw_flow.rate_hz, rudder_flow.rate_hz),
    )


def _sources(channels: Channels) -> dict[str, ChannelFound]:
    yaw_rate, surface_rate = ChannelFound(""), ChannelFound("")
    if channels.intervals_us is not None:
        yaw_rate, surface_rate = (
            _rate(1e6 / interval_us, flow.rate_hz)
            for interval_us, flow in zip(channels.intervals_us, channels.flows, strict=True)
        )
    found = {
        name: _source_of(surface, channels.twins, surface_rate)
        for name, surface in zip(channels.config.inputs, channels.surfaces, strict=False)
    }
    if "rudder" in found and channels.lock.vehicle is not None:
        table, autopilot = channels.parameters, channels.lock.vehicle.autopilot
        loop, gains = table.yaw_loop(autopilot), table.changed_gains(autopilot)
        found["rudder"] = replace(found["rudder"], yaw_loop=loop, yaw_gains=gains)
    if channels.yaw.rows:
        found["yaw"] = replace(yaw_rate, source=channels.yaw.label)
    return found


def _rate(first_hz: float, whole_hz: float) -> ChannelFound:
    changed = abs(whole_hz - first_hz) > (RATE_TOLERANCE - 1.0) * first_hz
    rates = (whole_hz, first_hz) if changed else (first_hz, None)
    return ChannelFound("", rate_hz=rates[0], first_rate_hz=rates[1])


def _source_of(surface: Surface, twins: Twins, rate: ChannelFound) -> ChannelFound:
    how, measured = twins.how(surface), surface.measured
    found = replace(rate, source=surface.source, how=how, measured=measured)
    first = surface.parts[0]
    if first.travel_us is None:
        return found
    low, trim, high = first.travel_us
    return replace(found, min_us=low, trim_us=trim, max_us=high, reversed=first.reversed)


def _missing(channels: Channels) -> Iterator[Reason]:
    vehicle, surfaces = channels.lock.vehicle, channels.surfaces
    if vehicle is None:  # a record has no vehicle either: it has both channels or was refused
        return
    # Without a yaw source no servo message has a time: the reason is no_yaw, not no_rudder.
    if not surfaces:
        named = " or ".join(channels.config.inputs)
        yield no_surface(named, vehicle, channels.parameters)
    elif channels.surface_rows == 0 and channels.yaw.rows > 0:
        only_sticks = channels.received and channels.received <= {*STICKS}
        remedy = NAME_THE_STICK if only_sticks else None
        yield Reason("no_rudder", f"no message carries {surfaces[0].source}", remedy)
    if channels.yaw.rows == 0:
        yield Reason("no_yaw", f"the vehicle sent none of the messages {', '.join(SOURCES)}")


def _assumed(channels: Channels) -> Iterator[Reason]:
    """Yield what is assumed of the channels, with all texts of one reason in one."""
    texts: dict[str, list[str]] = {}
    if channels.record is not None and channels.record.assumed:
        text = f"the unit of {', '.join(channels.record.assumed)} is not given: rad and rad/s are"
        texts["unit_assumed"] = [f"{text} assumed"]
    fast_s = channels.fast * channels.conditioner.sample_time_s if channels.fast else 0.0
    if fast_s > LEAST_FAST_S:
        texts.setdefault("unit_assumed", []).append(
            f"the yaw rate is beyond {FAST_RAD_S:g} rad/s for {fast_s:.0f} s, which no aircraft "
            "holds: rad/s are assumed, but it may be in deg/s"
        )
    for name, surface in zip(channels.config.inputs, channels.surfaces, strict=False):
        for id_, text in _surface_texts(name, surface, channels.twins, channels.parameters):
            texts.setdefault(id_, []).append(text)
    for id_, found in texts.items():
        yield Reason(id_, "; ".join(found))


def _surface_texts(
    name: str, surface: Surface, twins: Twins, table: ParameterTable
) -> Iterator[tuple[str, str]]:
    if "assumed" in surface.how:
        is_torn = table.missing and table.functions()
        lacks = f" ({table.missing} of its parameters are missing)" if is_torn else ""
        low, trim, high = surface.parts[0].travel_us or STOCK_TRAVEL_US
        yield (
            "rudder_assumed",
            f"the log does not say which channel moves the {name}, nor how far{lacks}: "
            f"{surface.source} with {low:g}/{trim:g}/{high:g} us is assumed",
        )
    for twin in surface.twins:
        share = twins.share_apart(surface, twin)
        if share > LEAST_SHARE:
            yield (
                "rudder_assumed",
                f"{surface.name_of(twin)} is also a {name} and differs from {surface.source} by "
                f"more than {100 * TOLERANCE:.0f} % of half the travel in {100 * share:.0f} % of "
                f"the messages: {surface.source} is assumed",
            )
    if surface.message in STICKS:
        yield "channel_stand_in", f"{surface.source} is the pilot's stick, not the {name} itself"
