"""What is published of each session, and when: values each second, a text for each event."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from yawid.answers.run_summary import DutchRoll
from yawid.runs.live.running_answer import Answer
from yawid.runs.live.vehicle_session import LiveSession
from yawid.sinks.words import dutch_roll, says
from yawid.sources.link.publisher import INFO, LONGEST_TEXT, NOTICE, Publisher

ROUND_S = 1.0
SETTLE_S = 10.0
"""What a log lacks is not sent in its first seconds, when few data have arrived."""
SILENT_US = 5_000_000
"""Nothing is published for a vehicle that has been silent for this long."""
ORDINARY_EACH = 5
"""One round in so many has the values of ordinary flight instead: both would be 290 bytes."""
REASON_S = 15.0
"""The least time between two texts that say "not usable" for different reasons."""


@dataclass(slots=True)
class Published:
    """The state of what has been published of one session."""

    round_s: float = -math.inf
    rounds: int = 0
    manoeuvres: int = 0
    since_s: float = math.inf
    state: str | None = None
    said_s: float = -math.inf


class Publish:
    """The publisher of all sessions' running answers: values of one session each second, in turn.

    ``reached_us`` returns the stamp up to which all that arrived has been read.
    """

    def __init__(self, publisher: Publisher, reached_us: Callable[[], int]) -> None:
        self._publisher = publisher
        self.sender_of = publisher.sender_of
        self._reached_us = reached_us
        self._known: dict[tuple[int, int], Published] = {}
        self._next_s = -math.inf
        self._refused: set[tuple[int, int]] = set()
        self._shared_said = False

    def tick(self, sessions: Sequence[LiveSession], now_s: float) -> list[str]:
        """Send what is due and return lines for the user; to be called several times a second."""
        self._publisher.send_texts(now_s)
        if now_s < self._next_s:
            return []
        late = now_s - self._next_s >= ROUND_S
        self._next_s = now_s + ROUND_S if late else self._next_s + ROUND_S
        speaking = {
            vehicle: session
            for session in sessions
            if (vehicle := session.vehicle) is not None and self._may_speak(vehicle, session)
        }
        for vehicle, session in speaking.items():
            known = self._known.setdefault(vehicle, Published())
            report = partial(self._report_manoeuvres, vehicle[0], session, known)
            session.publishing.attempt(report, None)
        if speaking:
            self._say_how_many(len(speaking))
            turn = min(speaking, key=lambda vehicle: self._known[vehicle].round_s)
            send = partial(self._send_round, turn, speaking[turn], now_s)
            speaking[turn].publishing.attempt(send, None)
        self._publisher.send_texts(now_s)
        news = self._publisher.news
        return [news.popleft() for _ in range(len(news))]

    def _may_speak(self, vehicle: tuple[int, int], session: LiveSession) -> bool:
        """Return whether to publish: estimated, not silent, and of a component other than ours."""
        if session.publishing.failure is not None or not session.is_estimated:
            return False
        if vehicle[1] == self._publisher.compid:
            if vehicle not in self._refused:
                self._refused.add(vehicle)
                self._publisher.news.append(
                    f"nothing is published for system {vehicle[0]}, as component {vehicle[1]} is "
                    "its autopilot: choose another --publish-compid"
                )
            return False
        received_us = max(session.pipeline.channels.segmenter.received_us)
        return not received_us or self._reached_us() - received_us < SILENT_US

    def _say_how_many(self, count: int) -> None:
        if count > 1 and not self._shared_said:
            self._shared_said = True
            self._publisher.news.append(
                f"{count} vehicles share the publisher: the answer of each is sent every "
                f"{count * ROUND_S:.0f} s"
            )

    def _send_round(self, vehicle: tuple[int, int], session: LiveSession, now_s: float) -> None:
        known, pipeline = self._known[vehicle], session.pipeline
        answer = session.answer.look(pipeline, session.decoder.link)
        known.since_s = min(known.since_s, now_s)
        if now_s - known.since_s >= SETTLE_S:
            self._report_change(vehicle[0], answer, known, now_s)
        boot_ms = max(*pipeline.channels.segmenter.newest, 0) // 1000
        values = values_of(answer, known.rounds)
        if self._publisher.send_round(vehicle[0], boot_ms, values, now_s):
            known.round_s, known.rounds = now_s, known.rounds + 1

    def _report_manoeuvres(self, sysid: int, session: LiveSession, known: Published) -> None:
        """Queue a text on each manoeuvre answered since the last call."""
        answered = session.pipeline.manoeuvres or []
        news, known.manoeuvres = answered[known.manoeuvres :], len(answered)
        for found in news:
            self._publisher.say(sysid, INFO, _fitting(f"yawid m{found.n}: {says(found)}"))

    def _report_change(self, sysid: int, answer: Answer, known: Published, now_s: float) -> None:
        """Queue a text where the verdict differs from the one that was sent last.

        While a session is not usable, its first reason may change with every call: such changes are
        sent less often.
        """
        turns = "usable" in (answer.state, known.state) or known.state is None
        if answer.state in (None, known.state) or not (turns or now_s - known.said_s >= REASON_S):
            return
        known.state, known.said_s = answer.state, now_s
        severity = INFO if answer.known is None else NOTICE
        self._publisher.say(sysid, severity, verdict_text(answer), about="verdict")


def values_of(answer: Answer, number: int = 0) -> dict[str, float]:
    """Return the values to publish: wn in rad/s, zeta, their sigmas, and ``yaw_ok``.

    ``yaw_ok`` is 1.0 for a usable answer of the flight. For the running number, which is not
    judged and whose sigma is of noise, it is 0.0. A number that is unknown is left out. Where
    ordinary flight has numbers, some rounds, by their ``number``, have these instead.
    """
    ordinary = None if answer.ordinary is None else answer.ordinary.dutch_roll
    if ordinary is not None and number % ORDINARY_EACH == ORDINARY_EACH - 1:
        return _named("ord", ordinary)
    roll = answer.known or answer.running
    return _named("yaw", roll) | {"yaw_ok": float(answer.known is not None)}


def _named(first: str, roll: DutchRoll | None) -> dict[str, float]:
    """Return the known numbers of a Dutch roll, by names that begin with a word."""
    if roll is None:
        return {}
    values = {"wn": roll.wn_rad_s, "wn_sd": roll.wn_std, "zeta": roll.zeta, "z_sd": roll.zeta_std}
    return {
        f"{first}_{name}": value
        for name, value in values.items()
        if value is not None and math.isfinite(value)
    }


def verdict_text(answer: Answer) -> str:
    """Return the STATUSTEXT of a verdict."""
    if answer.known is None:
        return f"yawid: not usable: {answer.state}"
    return _fitting(f"yawid: usable, {dutch_roll(answer.known)}")


def _fitting(text: str) -> str:
    """Return a text in ASCII; one too long loses its unit, and then its sigmas if need be."""
    text = text.replace(" ± ", "+-")
    if len(text) > LONGEST_TEXT:
        text = text.replace(" rad/s", "")
    return text if len(text) <= LONGEST_TEXT else re.sub(r"\+-[^ ,]+", "", text)
