"""The check whether the autopilot flew the aircraft at all: it was armed, and its outputs moved.

A log may contain commands without effect: those of an autopilot that was carried along disarmed, or
whose outputs a safety switch blocks. Only messages from the time of the samples count: the boot and
the stretch asked for, and not on the ground.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from yawid.answers.reasons import Reason
from yawid.blocks import Floats, Ints, MessageBlock
from yawid.channels.series import Latest, Piece
from yawid.channels.surface import raw_outputs
from yawid.channels.vehicle import Vehicle
from yawid.channels.yaw_reader import ON_GROUND
from yawid.config.run import RunConfig
from yawid.quantities.vehicles import ARMED

MOVED = 0.002
"""An output has moved if its values differ by more than this part of them: 3 us of a servo."""
LEAST_ROWS = 10
"""The least number of messages that show that an output stood still."""
_OUTPUTS = ("SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS", "HIL_ACTUATOR_CONTROLS")
_OFF = 65535.0
_NO_ROWS: tuple[Ints, Floats] = np.zeros(0, np.int64), np.zeros((0, 1))


@dataclass(slots=True)
class Command:
    """The facts from the messages; ``texts`` yields the reasons against the log.

    ``config`` says which boot and which stretch are sampled. ``outputs`` has of each output, by its
    message and its number from 1, how many raw values were reported and their range.
    """

    config: RunConfig
    outputs: dict[tuple[str, int], tuple[int, float, float]] = field(default_factory=dict)
    moved: bool = False
    armed: bool = False
    disarmed: bool = False
    on_board: bool = False
    _rows: list[tuple[Ints, Floats]] = field(default_factory=list)
    _sampled: Latest = field(default_factory=lambda: Latest(1))
    _armed: Latest = field(default_factory=lambda: Latest(1))

    def observe_yaw(self, piece: Piece) -> None:
        """Take in a piece of a segment: its rows of yaw say where there can be samples."""
        yaw, (low_us, high_us) = piece.yaw, self.config.window_us
        sampled = (yaw.t_us >= low_us) & (yaw.t_us <= high_us)
        sampled &= (yaw.values[:, ON_GROUND] != 1.0) & (self.config.boot in (None, piece.boot))
        self._rows.append((yaw.order, sampled[:, None].astype(float)))

    def observe(self, messages: Mapping[str, MessageBlock]) -> None:
        """Take in the messages that those rows came with."""
        rows, self._rows = [_NO_ROWS, *self._rows], []
        if self.moved and self.armed:  # everything is known already
            return
        order, sampled = (np.concatenate(column) for column in zip(*rows, strict=True))
        if (beats := messages.get("HEARTBEAT")) is not None:
            armed = beats.fields["base_mode"] & ARMED != 0
            self._armed.add(beats.order, armed[:, None].astype(float))
            # A HEARTBEAT made from an on-board log lacks a field that every link has.
            self.on_board = "system_status" not in (beats.fields.dtype.names or ())
        armed = self._armed.at(order[sampled[:, 0] != 0.0])
        self.armed |= bool((armed == 1.0).any())
        self.disarmed |= bool((armed == 0.0).any())
        self._sampled.add(order, sampled)
        for block in (messages[name] for name in _OUTPUTS if name in messages):
            own = block.select(self._sampled.at(block.order)[:, 0] == 1.0)
            for number, values in raw_outputs(own) if not self.moved else ():
                reported = values[np.isfinite(values) & (values != 0.0) & (values < _OFF)]
                if len(reported):
                    key = block.name, number
                    rows_of, low, high = self.outputs.get(key, (0, math.inf, -math.inf))
                    low, high = min(low, float(reported.min())), max(high, float(reported.max()))
                    self.outputs[key] = rows_of + len(reported), low, high
                    self.moved |= high - low > MOVED * max(abs(low), abs(high))

    def reasons(self, vehicle: Vehicle | None, why_believed: Callable[[], str]) -> Iterator[Reason]:
        """Yield the reasons of a rudder without command.

        ``why_believed`` returns why the rudder moved the aircraft all the same, "" if nothing shows
        it: a pilot's receiver may have moved the servos by the same sticks.
        """
        never_armed = self.disarmed and not self.armed
        still = {key: low for key, (rows, low, _) in self.outputs.items() if rows >= LEAST_ROWS}
        said = []
        if never_armed and self.on_board:
            name = "the autopilot" if vehicle is None else vehicle.autopilot_name
            said.append(f"{name} was never armed")
        if still and not self.moved:
            said.append(_still(still))
        if said and (why := why_believed()):
            yield Reason("disarmed", f"{' and '.join(said)}; {why}")
        elif said:
            what = "the autopilot did not move its outputs"
            if self.moved or not still:
                what = "nothing shows that its outputs moved a surface"
            yield Reason("not_in_command", f"{' and '.join(said)}: {what}")
        elif never_armed:
            yield Reason(
                "disarmed",
                "every HEARTBEAT reports disarmed while the log was sampled: nothing shows that "
                "the outputs reached the servos",
            )


def _still(outputs: Mapping[tuple[str, int], float]) -> str:
    """Return in words which outputs (by message and number) stood still, and at what value."""
    said = []
    for message in sorted({message for message, _ in outputs}):
        own = {number: low for (name, number), low in outputs.items() if name == message}
        numbers = ", ".join(map(str, sorted(own)))
        values = sorted({f"{low:g}" for low in own.values()})
        at = f" at {values[0]}" if len(values) == 1 else ""
        said.append(f"{message} outputs {numbers} stood still{at}")
    return " and ".join(said)
