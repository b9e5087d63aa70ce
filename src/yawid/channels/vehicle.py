"""The choice of the aircraft among the senders of a link.

A link also has ground stations, radios, gimbals and ADS-B receivers, each with its own HEARTBEATs.
The vehicle is the first sender whose HEARTBEAT names an autopilot, and a type that is neither on
the ground nor a payload. Numbers are those of MAV_TYPE and MAV_AUTOPILOT in MAVLink's common.xml.
"""

from dataclasses import dataclass, field

import numpy as np

from yawid.answers.heard import VehicleSeen
from yawid.blocks import FrameBlock, MessageBlock
from yawid.quantities.vehicles import (
    AUTOPILOT_INVALID,
    FIXED_WING,
    NOT_A_VEHICLE,
    TYPE_NAMES,
    VTOL_TYPES,
    type_name,
)


class Vehicle(VehicleSeen, frozen=True):
    """The aircraft found: its address, type, autopilot, and the place of its first HEARTBEAT."""

    order: int

    @property
    def numbered_type(self) -> str:
        """The type in words, with its number."""
        return f"{TYPE_NAMES.get(self.type, 'unknown')} (type {self.type})"


def has_wings(vehicle: Vehicle) -> bool:
    """Return whether the vehicle flies on wings, always or in a part of its flight."""
    return vehicle.type == FIXED_WING or vehicle.type in VTOL_TYPES


@dataclass(slots=True)
class VehicleLock:
    """The search for the vehicle, and the filter that passes only its messages.

    ``sysid`` is the system id to look for, None for any. ``senders`` holds the type and autopilot
    of each sender of a HEARTBEAT, by (sysid, compid).
    """

    sysid: int | None = None
    vehicle: Vehicle | None = None
    senders: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    _parameters: list[MessageBlock] = field(default_factory=list)

    def filter(self, frames: FrameBlock) -> tuple[dict[str, MessageBlock], list[MessageBlock]]:
        """Return the vehicle's messages from its first HEARTBEAT on, by name, and its PARAM_VALUEs.

        Parameters received before that HEARTBEAT count too: they are facts, not samples.
        """
        heartbeats = frames.messages.get("HEARTBEAT")
        if heartbeats is not None:
            self._observe_heartbeats(heartbeats)
        if "PARAM_VALUE" in frames.messages:
            self._parameters.append(frames.messages["PARAM_VALUE"])
        if self.vehicle is None:
            return {}, []
        mine = {}
        for name, block in frames.messages.items():
            own = self._own(block, self.vehicle.order)
            if name != "PARAM_VALUE" and len(own):
                mine[name] = own
        parameters = [own for block in self._parameters if len(own := self._own(block))]
        self._parameters.clear()
        return mine, parameters

    def _own(self, block: MessageBlock, first: int = 0) -> MessageBlock:
        """Return the vehicle's rows at or after the place ``first`` of the stream."""
        assert self.vehicle is not None
        rows = (block.sysid == self.vehicle.sysid) & (block.compid == self.vehicle.compid)
        return block.select(rows & (block.order >= first))

    def _observe_heartbeats(self, block: MessageBlock) -> None:
        kinds, autopilots = block.fields["type"], block.fields["autopilot"]
        senders = np.stack([block.sysid, block.compid, kinds, autopilots], axis=1)
        for sysid, compid, kind, autopilot in np.unique(senders, axis=0).tolist():
            self.senders.setdefault((sysid, compid), (kind, autopilot))
        if self.vehicle is not None:
            return
        flies = (autopilots != AUTOPILOT_INVALID) & ~np.isin(kinds, list(NOT_A_VEHICLE))
        if self.sysid is not None:
            flies &= block.sysid == self.sysid
        if flies.any():
            columns = block.sysid, block.compid, kinds, autopilots, block.order
            self.vehicle = Vehicle(*(int(column[np.argmax(flies)]) for column in columns))

    @property
    def vehicles(self) -> list[dict[str, int]]:
        """Every vehicle on the link, by its address: sysid, compid, type and autopilot."""
        return [
            {"sysid": sysid, "compid": compid, "type": kind, "autopilot": autopilot}
            for (sysid, compid), (kind, autopilot) in sorted(self.senders.items())
            if autopilot != AUTOPILOT_INVALID and kind not in NOT_A_VEHICLE
        ]

    def why_none(self) -> str:
        """Return in words why there is no vehicle, with the senders of HEARTBEATs."""
        if not self.senders:
            return "the log holds no HEARTBEAT, so the vehicle is unknown"
        names = ", ".join(
            f"{sysid}/{compid} {type_name(kind)}"
            for (sysid, compid), (kind, _) in sorted(self.senders.items())
        )
        wanted = "" if self.sysid is None else f" with system id {self.sysid}"
        return f"no vehicle{wanted} is among the senders of HEARTBEAT: {names}"
