"""What of a link was heard: the vehicle, its boots, and the counts of frames."""

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Annotated, Final

from msgspec import field

from yawid.answers.part import Count, Number, Part, says
from yawid.quantities.vehicles import autopilot_name, type_name


class VehicleSeen(Part, frozen=True):
    """A vehicle: its address, and its type and autopilot as HEARTBEAT reports them."""

    sysid: Count
    compid: Count
    type: Annotated[Count, says("MAV_TYPE of its HEARTBEAT; 1 is a fixed wing", "MAV_TYPE")]
    autopilot: Annotated[
        Count, says("MAV_AUTOPILOT of its HEARTBEAT; 3 is ArduPilot, 12 is PX4", "MAV_AUTOPILOT")
    ]

    @property
    def address(self) -> tuple[int, int]:
        """The system and component id."""
        return self.sysid, self.compid

    @property
    def type_name(self) -> str:
        """The type in words."""
        return type_name(self.type)

    @property
    def autopilot_name(self) -> str:
        """The autopilot in words."""
        return autopilot_name(self.autopilot)

    @property
    def kind(self) -> str:
        """The type and the autopilot in words."""
        return f"{self.type_name} on {self.autopilot_name}"


class BootSpan(Part, frozen=True):
    """The times that one boot of the vehicle covers, in s since that boot."""

    boot: Count
    from_s: Annotated[Number, says("first second, since boot", "s")] = field(name="from")
    to_s: Annotated[Number, says("last second, since boot", "s")] = field(name="to")


PARAMETERS: Final = "parameters.txt"
"""The text attached to a run with the vehicle's parameters, one on each line."""


def parameters_in(attached: bytes) -> dict[str, float]:
    """Return the vehicle's parameters by name from the text attached to a run."""
    known = {}
    for line in attached.decode("utf-8", "replace").splitlines():
        name, _, value = line.rpartition(" ")
        with suppress(ValueError):
            known[name] = float(value)
    return known


class GainSeen(Part, frozen=True):
    """A gain of the feedback from yaw rate to rudder, and from when in which boot it holds."""

    name: Annotated[str, says("the parameter")]
    value: Annotated[Number, says("its value", "as the quantity it belongs to")]
    boot: Annotated[Count, says("number of the boot")]
    from_s: Annotated[Number, says("time since that boot from which on it holds", "s")]


def gains_between(
    seen: Sequence[GainSeen], boots: Sequence[BootSpan] | None, from_s: float, to_s: float
) -> dict[str, list[float]]:
    """Return the values in s since boot that each gain had in a stretch, in the order flown.

    Where several of ``boots`` have these seconds, those of all of them are given.
    """
    of = [each.boot for each in boots or () if each.from_s <= to_s and from_s <= each.to_s]
    found: dict[str, list[float]] = {}
    for name in dict.fromkeys(each.name for each in seen):
        gains = [each for each in seen if each.name == name]
        # What was received first held before, too.
        starts = [(0, 0.0), *((each.boot, each.from_s) for each in gains[1:])]
        for boot in of or [1]:
            first = bisect_right(starts, (boot, from_s)) - 1
            stop = max(bisect_left(starts, (boot, to_s)), first + 1)
            found.setdefault(name, []).extend(each.value for each in gains[first:stop])
    return found


def words_of_gains(gains: Mapping[str, Sequence[float]]) -> str | None:
    """Return the gains that are not 0 in words, each from its least to its largest value."""
    said = [
        f"{name} {min(of):.3g}" + (f" to {max(of):.3g}" if min(of) < max(of) else "")
        for name, of in gains.items()
        if any(of)
    ]
    return ", ".join(said) or None


class LinkCounts(Part, frozen=True):
    """The counts of the link; empty for a torn run, of which they are unknown."""

    frames: Count | None = None
    skipped_bytes: Count | None = None
    bad_crc: Count | None = None
    unknown: Count | None = None
    lost: Count | None = None
    reboots: Count | None = None
    clock_steps: Count | None = None
    gaps: Count | None = None
    unsigned_rejected: Annotated[
        Count | None, says("frames rejected because they are not signed with the key")
    ] = None
    clock_leap_s: Annotated[Number | None, says("by how much the vehicle's clock jumped", "s")] = (
        None
    )
    signed: Annotated[Count | None, says("signed frames")] = None
