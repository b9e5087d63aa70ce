"""Requests to the vehicle to send its messages more often.

Each message needs a MAV_CMD_SET_MESSAGE_INTERVAL (511). ArduPilot's shortest interval is its loop
period / 0.8, and other programs on the link may set the rate back: so the rates are measured, and a
message whose rate falls behind is requested again. A sender of HEARTBEATs as the ground station
(system 255) would keep ArduPilot's failsafe from acting when the real one is gone; therefore this
one is an onboard controller.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from yawid.blocks import MessageBlock
from yawid.sources.link.publisher import COMPID, Outgoing, senders
from yawid.sources.link.tap import Tap
from yawid.sources.open_log import ReadOptions

AGAIN_S, WINDOW_S, ANSWER_S = 10.0, 5.0, 1.0
"""The least time between two requests of a message; the time over which messages are counted; and
how long a request waits for the last one's answer, as answers do not name the message."""
GRANTED = 0.9
"""A rate has fallen behind below this share of the rate asked for, or of the best one seen if that
is lower: the rate asked for may be impossible."""
_SET_MESSAGE_INTERVAL = 511
SYSID: Final = 250
"""The system id used until a vehicle is known: no vehicle's usual one, nor a ground station's."""
_RESULTS = ("accepted", "temporarily rejected", "denied", "unsupported", "failed", "in progress")


@dataclass(slots=True)
class Wish:
    """One message: its request, the answer and the rate; times are in s of the receive clock."""

    message_id: int
    asked_s: float = -math.inf
    answer: str | None = None
    achieved_hz: float | None = None
    best_hz: float = 0.0
    is_refused: bool = False
    count: int = 0


class RateRequests:
    """The requests to one vehicle for ``hz`` of two messages, and the check of their rates.

    Feed it the session's records; :meth:`tick` sends requests, for each message at most every
    ``AGAIN_S``, and returns lines to report: refusals, and the rates achieved where they change.
    With a key the requests are signed, and only signed answers and messages count.

    It is a component of the vehicle's own system, or of ``sysid`` before that is known;
    ``sender_of`` returns the packer of frames for that component of a system.
    """

    def __init__(
        self,
        tap: Tap,
        hz: float = 50.0,
        read_options: ReadOptions | None = None,
        sysid: int = SYSID,
        sender_of: Callable[[int], Outgoing] | None = None,
    ) -> None:
        read_options = read_options or ReadOptions()
        self.hz = hz
        self.wishes = {"ATTITUDE": Wish(30), "SERVO_OUTPUT_RAW": Wish(36)}
        self._tap, self._sysid, self._news = tap, sysid, list[str]()
        self._decoder = read_options.decoder({*self.wishes, "COMMAND_ACK"})
        self._sender_of = sender_of or senders(COMPID, read_options.key)
        self._window_s, self._beat_s = math.inf, -math.inf
        self._asked_last: Wish | None = None

    def feed(self, records: bytes, vehicle: tuple[int, int] | None) -> None:
        """Take records in; only those of ``vehicle`` (sysid, compid) count."""
        frames = self._decoder.feed(records)
        if frames is None or vehicle is None:
            return
        for name, block in frames.messages.items():
            own = block.select((block.sysid == vehicle[0]) & (block.compid == vehicle[1]))
            if name == "COMMAND_ACK":
                self._read_answers(own)
            else:
                self.wishes[name].count += len(own)

    def tick(self, now_s: float, vehicle: tuple[int, int] | None) -> list[str]:
        """Send the requests that are due; return the lines to report."""
        if self._tap.endpoint.kind == "udpout" and now_s - self._beat_s >= 1.0:
            # The listener there only knows of us by what we send.
            self._beat_s = now_s
            sender = self._sender_of(self._sysid if vehicle is None else vehicle[0])
            self._tap.transmit(sender.frame(sender.heartbeat()), 0)
        if vehicle is not None:
            self._measure(now_s)
            for wish in self.wishes.values():
                if self._is_due(
                    wish, now_s
                ):  # after a request no other is: it waits for the answer
                    self._ask(wish, vehicle, now_s)
        news, self._news = self._news, []
        return news

    def summary(self) -> dict[str, dict[str, float | str]]:
        """Return the rate asked for, the answer and the rate achieved, by message."""
        known = {
            name: {"asked_hz": self.hz, "answer": wish.answer, "achieved_hz": wish.achieved_hz}
            for name, wish in self.wishes.items()
        }
        return {
            name: {what: value for what, value in each.items() if value is not None}
            for name, each in known.items()
        }

    def _is_due(self, wish: Wish, now_s: float) -> bool:
        last = self._asked_last
        waits = last is not None and last.answer is None and now_s - last.asked_s < ANSWER_S
        if waits or now_s - wish.asked_s < AGAIN_S:
            return False
        wanted_hz = GRANTED * min(self.hz, wish.best_hz or self.hz)
        return wish.answer is None or (wish.achieved_hz or wanted_hz) < wanted_hz

    def _ask(self, wish: Wish, vehicle: tuple[int, int], now_s: float) -> None:
        sender = self._sender_of(vehicle[0])
        command = sender.messages.command_long_encode(
            *vehicle, _SET_MESSAGE_INTERVAL, 0, wish.message_id, 1e6 / self.hz, 0, 0, 0, 0, 0
        )
        if self._tap.transmit(sender.frame(command), vehicle[0]):
            wish.asked_s, wish.answer, self._asked_last = now_s, None, wish

    def _read_answers(self, block: MessageBlock) -> None:
        rows = zip(block.fields["command"].tolist(), block.fields["result"].tolist(), strict=True)
        for command, result in rows:
            wish = self._asked_last
            if command != _SET_MESSAGE_INTERVAL or wish is None:
                continue
            wish.answer = dict(enumerate(_RESULTS)).get(result, f"result {result}")
            if result not in (0, 5) and not wish.is_refused:
                wish.is_refused = True
                self._news.append(
                    f"message {wish.message_id} at {self.hz:g} Hz: {wish.answer} by the vehicle "
                    "(ArduPilot grants at most 0.8 of SCHED_LOOP_RATE)"
                )

    def _measure(self, now_s: float) -> None:
        elapsed_s, changed = now_s - self._window_s, False
        if 0.0 <= elapsed_s < WINDOW_S:
            return
        self._window_s = now_s
        for wish in self.wishes.values():
            rate, before, wish.count = wish.count / elapsed_s, wish.achieved_hz, 0
            if elapsed_s > 0.0:
                changed |= before is None or abs(rate - before) > 0.1 * max(rate, before, 1.0)
                wish.achieved_hz, wish.best_hz = rate, max(wish.best_hz, rate)
        if changed:
            rates = ", ".join(f"{n} {w.achieved_hz:.1f}" for n, w in self.wishes.items())
            self._news.append(f"rates: {rates} Hz of the {self.hz:g} asked for")
