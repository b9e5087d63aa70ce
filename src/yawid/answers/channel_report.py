"""What a run's channels have to say to its summary.

Reasons are pairs of id and text: what an id means is said in ``results/reasons.py``.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from yawid.answers.run_summary import BootSpan, ChannelFound, LinkCounts, VehicleSeen
from yawid.blocks import Held

Said = tuple[str, str]
"""The id of a reason, and its text."""


@dataclass(frozen=True, slots=True)
class ChannelReport:
    """What the channels have to say.

    ``vehicles`` are all on the link, ``breaks`` those that the clock and the messages made.
    ``missing`` says which of rudder and yaw there is not, where a vehicle was found;
    ``why_no_vehicle`` why none was. ``reasons`` are what is assumed of the channels; ``commands``
    gives those of a rudder that commanded nothing, where it is told why it is believed all the
    same. ``rates_hz`` are those of yaw and rudder in the first seconds, None without samples,
    ``later_hz`` those of the whole run. ``used`` samples update the estimators, ``held`` is why
    others do not. ``rudder_message`` is the one that a rudder was found in, and ``has_functions``
    says whether any servo has one.
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
    missing: tuple[Said, ...]
    reasons: tuple[Said, ...]
    commands: Callable[[Callable[[], str]], Iterable[Said]]
    rates_hz: tuple[float, float] | None
    later_hz: tuple[float, float]
    used: int
    held: Held
