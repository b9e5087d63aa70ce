"""Which session gets which records: one session takes all, or each vehicle has its own."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from yawid.answers.session import LiveFacts
from yawid.errors import ConfigError
from yawid.quantities.vehicles import AUTOPILOT_INVALID, NOT_A_VEHICLE
from yawid.runs.live.vehicle_session import Ended, LiveSession, Setting
from yawid.sinks.terminal.console import VehicleFacts
from yawid.sources.link.tap import sysid_of
from yawid.sources.mavlink.framing import MAGIC_V1, STAMP_SIZE, frame_size

KEPT = 8192
"""How many records of systems without a session are kept, for one that turns out a vehicle."""
MOST_VEHICLES = 64
"""The default for how many sessions may be opened: one sender can claim to be 255 vehicles."""
FEW = 4
"""For up to this many vehicles one thread fits."""
_HEARTBEAT = 0


class Single:
    """One session, which records and reads everything received."""

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self._sessions = {0: LiveSession(setting)}

    def feed(self, data: bytes) -> None:
        """Take whole records in."""
        self._sessions[0].record(data)
        self._sessions[0].estimate(data)

    def tick(self) -> None:
        """Write out and report what is complete; to be called several times each second."""
        self._each(LiveSession.tick)

    def running(self) -> list[LiveSession]:
        """Return the sessions that are running."""
        return [*self._sessions.values()]

    def facts(self) -> list[VehicleFacts]:
        """Return the state of each session."""
        return [session.facts() for session in self.running()]

    def finish(self, live: LiveFacts, answers_s: float) -> list[Ended]:
        """Finish all sessions; ``live`` is the tap's part of their summaries.

        Answers are waited for ``answers_s``; then the processes that make them are ended.
        """
        until_s = time.monotonic() + answers_s
        self._each(LiveSession.settle)  # the last manoeuvres of all are answered together
        self._each(partial(LiveSession.conclude, until_s=until_s))
        self._setting.end_fits()
        return [session.finish(live) for session in self.running()]

    def _each(self, act: Callable[[LiveSession], None]) -> None:
        """Call ``act`` for each session."""
        for sysid in self._sessions:
            self._guard(sysid, act)

    def _guard(self, sysid: int, act: Callable[[LiveSession], None]) -> None:
        """Call ``act`` for the session of one vehicle."""
        act(self._sessions[sysid])


class Fleet(Single):
    """A session for each system whose HEARTBEAT is that of a vehicle, opened with the first one.

    Where there is a key the HEARTBEAT must be signed with it.

    Each session gets its own vehicle's records, also the last ones from before it was opened. At
    most ``MOST_VEHICLES`` sessions are opened. Without any vehicle nothing is recorded.
    """

    def __init__(self, setting: Setting) -> None:
        self._setting, self._sessions = setting, {}
        self._too_many_said = False
        self._early: deque[tuple[int, bytes]] = deque(maxlen=KEPT)
        self._refused: set[int] = set()
        self._unsigned: set[int] = set()

    def feed(self, data: bytes) -> None:
        """See :class:`Single`."""
        parts: dict[int, list[bytes]] = {
            sysid: [] for sysid in self._sessions.keys() | self._refused
        }
        for record in records(data):
            sysid = sysid_of(record[STAMP_SIZE : STAMP_SIZE + 6])
            if sysid not in parts and self._may_open(record[STAMP_SIZE:]):
                parts[sysid] = [early for of, early in self._early if of == sysid]
                self._open(sysid)
            if sysid in parts:
                parts[sysid].append(record)
            else:
                self._early.append((sysid, record))
        joined = {sysid: b"".join(own) for sysid, own in parts.items() if own}
        for act in (LiveSession.record, LiveSession.estimate):  # everything is recorded first
            for sysid, own_data in joined.items():
                self._guard(sysid, partial(act, data=own_data))

    def running(self) -> list[LiveSession]:
        """See :class:`Single`."""
        return [s for sysid, s in self._sessions.items() if sysid not in self._refused]

    def finish(self, live: LiveFacts, answers_s: float) -> list[Ended]:
        """See :class:`Single`; where there was no vehicle, one summary reports that."""
        if ended := super().finish(live, answers_s):
            return ended
        quiet = replace(self._setting.outputs, rerun="off")
        return [LiveSession(self._setting._replace(outputs=quiet)).finish(live)]

    def _may_open(self, frame: bytes) -> bool:
        """Return whether the frame is a HEARTBEAT for which a session is to be opened."""
        if not (is_vehicle(frame) and self._is_signed(frame)):
            return False
        if len(self._sessions) < MOST_VEHICLES:
            return True
        if not self._too_many_said:
            self._too_many_said = True
            self._setting.say(
                f"system {sysid_of(frame)}: no session is opened, as there are {MOST_VEHICLES} "
                "already: without --signing-key-file anybody can claim to be a vehicle"
            )
        return False

    def _is_signed(self, frame: bytes) -> bool:
        """Return whether a HEARTBEAT is signed with the key, if there is one; else report it."""
        key = self._setting.read_options.key
        if key is None or key.has_signed(frame):
            return True
        sysid = sysid_of(frame)
        if sysid not in self._unsigned:
            self._unsigned.add(sysid)
            self._setting.say(
                f"system {sysid}: its HEARTBEAT is not signed with the key, so no session is opened"
            )
        return False

    def _open(self, sysid: int) -> None:
        """Open the session of a vehicle; its files have its number."""
        setting = self._setting
        if len(self._sessions) >= FEW:  # their manoeuvres may end at once
            setting.fits.spread()
        outputs = replace(setting.outputs, name=f"{setting.outputs.name}-{sysid}")
        own = setting._replace(config=replace(setting.config, sysid=sysid), outputs=outputs)
        self._sessions[sysid] = LiveSession(own, f"system {sysid}: ")

    def _guard(self, sysid: int, act: Callable[[LiveSession], None]) -> None:
        """Call ``act`` for one vehicle; a ConfigError ends its session and no other."""
        if sysid in self._refused:
            return
        try:
            act(self._sessions[sysid])
        except ConfigError as error:
            self._refused.add(sysid)
            tlog = self._sessions[sysid].give_up()
            recorded = f"; what was recorded is in {tlog}" if tlog else ""
            self._sessions[sysid].say(f"{error}: no longer estimated{recorded}")


def records(data: bytes) -> Iterator[bytes]:
    """Yield the records of which ``data`` is made up."""
    at = 0
    while at < len(data):
        size = frame_size(data[at + STAMP_SIZE : at + STAMP_SIZE + 3])
        assert size is not None, "a tap hands out whole records"
        yield data[at : at + STAMP_SIZE + size]
        at += STAMP_SIZE + size


def is_vehicle(frame: bytes) -> bool:
    """Return whether the frame is a HEARTBEAT of a vehicle."""
    is_v1 = frame[0] == MAGIC_V1
    header = 6 if is_v1 else 10
    number = frame[5] if is_v1 else int.from_bytes(frame[7:10], "little")
    if number != _HEARTBEAT:
        return False
    payload = frame[header : header + frame[1]].ljust(9, b"\0")  # zeros at the end are not sent
    return payload[5] != AUTOPILOT_INVALID and payload[4] not in NOT_A_VEHICLE
