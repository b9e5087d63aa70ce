"""Before there is an answer a session without a screen says no number, and then the answer."""

from __future__ import annotations

import re
import time
from pathlib import Path

from live_link import CONFIG, Session, frames, listening, send, tlog_size, wait_for_size
from places import REPLAY_LOGS
from pymavlink import mavutil

from yawid.config.run import RunConfig

AT_ONCE = 1000
"""Frames on their way at a time: more than the socket holds would be lost."""
NUMBER = re.compile(r"\bwn -?\d")


def sent_to(session: Session, sent: list[bytes]) -> None:
    for first in range(0, len(sent), AT_ONCE):
        send(sent[first : first + AT_ONCE], session.port)
        wait_for_size(session.part("tlog"), tlog_size(sent[: first + AT_ONCE]))


def state_lines(session: Session) -> list[str]:
    return [line for line in session.screen.getvalue().splitlines() if " samples" in line]


def test_of_a_flight_that_cannot_answer_the_line_says_no_number(tmp_path: Path) -> None:
    """An AUTO mission of ArduPlane, in which the rudder follows the aileron: 10.06 is true."""
    log = mavutil.mavlink_connection(str(REPLAY_LOGS / "sitl_auto" / "log.tlog"))
    flown = [bytes(message.get_msgbuf()) for message in iter(log.recv_match, None)]
    log.close()

    with listening(tmp_path, RunConfig(), line_s=0.02) as session:
        sent_to(session, flown[:6000])

    [ended] = session.ended
    assert not ended.summary.deciding.usable
    lines = state_lines(session)
    assert [line for line in lines if NUMBER.search(line)] == []
    assert len([line for line in lines if "running: not known yet" in line]) > 3


def test_once_the_flight_is_usable_the_line_has_its_answer_with_its_sigma(tmp_path: Path) -> None:
    with listening(tmp_path, CONFIG, line_s=0.02) as session:
        sent_to(session, frames(24.0, doublet_s=9.0))
        session.screen.wait_for("manoeuvre 1 (")
        answered, patience_s = len(state_lines(session)), time.monotonic() + 60.0
        while len(state_lines(session)) < answered + 3:
            assert time.monotonic() < patience_s, session.screen.getvalue()[-500:]
            time.sleep(0.02)

    [ended] = session.ended
    roll = ended.summary.flight.dutch_roll
    assert ended.summary.flight.verdict.usable
    line = state_lines(session)[-1]
    shown = re.search(r"wn ([\d.]+) ± ([\d.]+) rad/s, zeta ([\d.]+) ± ([\d.]+)", line)
    assert shown is not None
    of_flight = (roll.wn_rad_s, roll.wn_std, roll.zeta, roll.zeta_std)
    for text, value in zip(shown.groups(), of_flight, strict=True):
        digits = len(text.partition(".")[2])
        assert text == f"{value:.{digits}f}"
    assert roll.wn_std > 2.0 * roll.wn_std_noise
