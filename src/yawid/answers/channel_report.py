"""The report of a run's channels, for its summary."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from yawid.answers.heard import BootSpan, LinkCounts, VehicleSeen
from yawid.answers.reasons import Reason
from yawid.answers.run_summary import ChannelFound


@dataclass(frozen=True, slots=True)
class ChannelReport:
    """The state of the channels, as far as the summary and the verdict need it.

    ``vehicles`` are all vehicles on the link; ``breaks`` counts the breaks of clock and messages.
    ``missing`` has the reasons for a missing rudder or yaw rate, if a vehicle was found;
    ``why_no_vehicle`` says why none was. ``reasons`` are about what is assumed of the channels.
    ``commands`` yields the reasons of a rudder without command; its argument returns why the rudder
    is believed all the same. ``rates_hz`` are the rates of yaw and rudder in the first seconds,
    None without samples; ``later_hz`` those of the whole run. ``rudder_message`` is the message
    with the rudder, and ``has_functions`` says whether any servo has a function.
    """

    is_record: bool
    vehicle: VehicleSeen | None
    vehicles: list[VehicleSeen]
    why_no_vehicle: str
    boots: list[BootSpan]
    breaks: LinkCounts
    channels: Mapping[str, ChannelFound]
    rudder_message: str | None
    has_functions: bool
    missing: tuple[Reason, ...]
    reasons: tuple[Reason, ...]
    commands: Callable[[Callable[[], str]], Iterable[Reason]]
    rates_hz: tuple[float, float] | None
    later_hz: tuple[float, float]
