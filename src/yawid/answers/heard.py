"""What of a link was heard: the vehicle, its boots, and the counts of frames."""

from msgspec import field

from yawid.answers.part import Count, Number, Part
from yawid.quantities.vehicles import autopilot_name, type_name


class VehicleSeen(Part, frozen=True):
    """A vehicle: its address, and its type and autopilot as HEARTBEAT reports them."""

    sysid: Count
    compid: Count
    type: Count
    autopilot: Count

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
    from_s: Number = field(name="from")
    to_s: Number = field(name="to")


class LinkCounts(Part, frozen=True):
    """The counts of the link; empty for a recovered run, for which they are unknown."""

    frames: Count | None = None
    skipped_bytes: Count | None = None
    bad_crc: Count | None = None
    unknown: Count | None = None
    lost: Count | None = None
    reboots: Count | None = None
    clock_steps: Count | None = None
    gaps: Count | None = None
    unsigned_rejected: Count | None = None
    clock_leap_s: Number | None = None
    signed: Count | None = None
