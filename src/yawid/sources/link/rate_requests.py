"""Requests to the vehicle to send its messages more often.

Each message needs a MAV_CMD_SET_MESSAGE_INTERVAL (511). ArduPilot's shortest interval is its loop
period / 0.8, and other programs on the link may set the rate back: so the rates are measured, and a
message whose rate falls behind is requested again. A sender of HEARTBEATs as the ground station
(system 255) would keep ArduPilot's failsafe from acting when the real one is gone; therefore this
one is an onboard controller.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from yawid.blocks import MessageBlock
from yawid.sources.link.outgoing import COMPID, Outgoing, senders
from yawid.sources.link.tap import Tap
from yawid.sources.open_log import ReadOptions

ASKED_HZ = 50.0
AGAIN_S = 10.0
"""The least time between two requests of a message, in s."""
WINDOW_S = 5.0
"""The time in s over which messages are counted."""
ANSWER_S = 1.0
"""The time in s that a request waits for the last one's answer: answers do not name the message."""
GRANTED = 0.9
"""A rate has fallen behind below this share of the rate asked for, or of the best one seen if that
is lower: the rate asked for may be impossible."""
MESSAGES = {"ATTITUDE": 30, "SERVO_OUTPUT_RAW": 36}
_SET_MESSAGE_INTERVAL = 511
SYSID: Final = 250
"""The system id used until a vehicle is known: no vehicle's usual one, nor a ground station's."""
_RESULTS = {
    0: "accepted", 1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed",
    5: "in progress",
}  # fmt: skip


@dataclass(slots=True)
class Wish:
    """One message: its request, the answer and the rate; times are in s of the receive clock."""

    message_id: int
    asked_s: float | None = None
    answer: str | None = None
    achieved_hz: float | None = None
    best_hz: float = 0.0
    count: int = 0


class RateRequests:
    """The requests to one vehicle for ``hz`` of each of ``MESSAGES``, and the check of the rates.

    Feed it the session's records; :meth:`tick` sends requests, for each message at most every
    ``AGAIN_S``, and returns lines to report: refusals, and the rates achieved where they change.
    With a key the requests are signed, and only signed answers and messages count.

    It is a component of the vehicle's own system, or of ``sysid`` before that is known;
    ``sender_of`` returns the packer of frames for that component of a system.
    """

    def __init__(
        self,
        tap: Tap,
        hz: float = ASKED_HZ,
        read_options: ReadOptions | None = None,
        sysid: int = SYSID,
        sender_of: Callable[[int], Outgoing] | None = None,
    ) -> None:
        read_options = read_options or ReadOptions()
        self.hz = hz
        self.wishes = {name: Wish(number) for name, number in MESSAGES.items()}
        self._tap = tap
        self._decoder = read_options.decoder({*MESSAGES, "COMMAND_ACK"})
        self._sysid = sysid
        self._sender_of = sender_of or senders(COMPID, read_options.key)
        self._news: list[str] = []
        self._window_s: float | None = None
        self._beat_s = float("-inf")
        self._asked_last: Wish | None = None
        self._refused: set[int] = set()

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
                if self._is_due(wish, now_s):
                    self._ask(wish, vehicle, now_s)
        news, self._news = self._news, []
        return news

    def summary(self) -> dict[str, dict[str, float | str]]:
        """Return the rate asked for, the answer and the rate achieved, by message."""
        found = {}
        for name, wish in self.wishes.items():
            entry: dict[str, float | str] = {"asked_hz": self.hz}
            if wish.answer is not None:
                entry["answer"] = wish.answer
            if wish.achieved_hz is not None:
                entry["achieved_hz"] = wish.achieved_hz
            found[name] = entry
        return found

    def _is_due(self, wish: Wish, now_s: float) -> bool:
        last = self._asked_last
        if last is not None and last.answer is None and now_s - (last.asked_s or 0.0) < ANSWER_S:
            return False
        if wish.asked_s is None:
            return True
        if now_s - wish.asked_s < AGAIN_S:
            return False
        behind = wish.achieved_hz is not None and wish.achieved_hz < GRANTED * min(
            self.hz, wish.best_hz or self.hz
        )
        return wish.answer is None or behind

    def _ask(self, wish: Wish, vehicle: tuple[int, int], now_s: float) -> None:
        interval_us = 1e6 / self.hz
        sender = self._sender_of(vehicle[0])
        command = sender.messages.command_long_encode(
            *vehicle, _SET_MESSAGE_INTERVAL, 0, wish.message_id, interval_us, 0, 0, 0, 0, 0
        )
        if self._tap.transmit(sender.frame(command), vehicle[0]):
            wish.asked_s, wish.answer, self._asked_last = now_s, None, wish

    def _read_answers(self, block: MessageBlock) -> None:
        for command, result in zip(block.fields["command"], block.fields["result"], strict=True):
            wish = self._asked_last
            if int(command) != _SET_MESSAGE_INTERVAL or wish is None:
                continue
            wish.answer = _RESULTS.get(int(result), f"result {int(result)}")
            if int(result) not in (0, 5) and wish.message_id not in self._refused:
                self._refused.add(wish.message_id)
                self._news.append(
                    f"message {wish.message_id} at {self.hz:g} Hz: {wish.answer} by the vehicle "
                    "(ArduPilot grants at most 0.8 of SCHED_LOOP_RATE)"
                )

    def _measure(self, now_s: float) -> None:
        if self._window_s is None:
            self._start_window(now_s)
            return
        elapsed_s = now_s - self._window_s
        if elapsed_s < WINDOW_S:
            return
        changed = False
        for wish in self.wishes.values():
            rate, before = wish.count / elapsed_s, wish.achieved_hz
            changed |= before is None or abs(rate - before) > 0.1 * max(rate, before, 1.0)
            wish.achieved_hz, wish.best_hz = rate, max(wish.best_hz, rate)
        self._start_window(now_s)
        if changed:
            rates = ", ".join(f"{n} {w.achieved_hz:.1f}" for n, w in self.wishes.items())
            self._news.append(f"rates: {rates} Hz of the {self.hz:g} asked for")

    def _start_window(self, now_s: float) -> None:
        self._window_s = now_s
        for wish in self.wishes.values():
            wish.count = 0
