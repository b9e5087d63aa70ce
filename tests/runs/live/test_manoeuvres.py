"""Manoeuvres of a live session: answered beside the loop, told as they end, as in a replay."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
import time
from dataclasses import asdict, replace
from operator import itemgetter
from pathlib import Path

import pytest
from finished_runs import messages
from flights.surgery import split
from live_link import (
    CONFIG,
    attend,
    frames,
    interrupt,
    left,
    listening,
    send,
    tlog_size,
    wait_for_size,
)
from places import REPLAY_LOGS

from yawid.answers.run_summary import Manoeuvre
from yawid.config.run import RunConfig
from yawid.manoeuvre.answered import answer
from yawid.runs.live import Ended
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay

GAPS = [f for _, f in split((REPLAY_LOGS / "c172p_gaps" / "log.tlog").read_bytes())]
"""Four manoeuvres of a Cessna, of which three end before the flight does."""


def replayed(tlog: Path, config: RunConfig) -> Ended:
    """Replay what a session recorded; return its summary and verdict."""
    outputs = Outputs(tlog.parent, f"{tlog.stem}-again")
    summary = replay(tlog, asdict(config), outputs, StopFlag())
    return Ended(summary, summary.exit_code)


def by_topic(path: Path) -> list[tuple[str, int, int, bytes]]:
    """Return the messages topic by topic: a manoeuvre has the log_time of its last sample."""
    return sorted(messages(path), key=itemgetter(0))


def told(ended: Ended) -> list[str]:
    """Return the session's lines on manoeuvres."""
    return [line for line in ended.summary.live.events if line.startswith("manoeuvre ")]


def to_two_digits(value: float, std: float) -> str:
    """Return a number with two digits of its sigma."""
    digits = 1 - math.floor(math.log10(std))
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def test_live_and_the_replay_of_its_tlog_give_the_same_manoeuvres_to_the_bit(tmp_path: Path):
    with listening(tmp_path, RunConfig(), Outputs(tmp_path, "live", "save")) as session:
        send(GAPS, session.port)
        session.screen.wait_for("manoeuvre 3 (")
        wait_for_size(session.part("tlog"), tlog_size(GAPS))
    [ended] = session.ended
    again = replayed(tmp_path / "live.tlog", RunConfig())

    found = [each.to_json() for each in ended.summary.manoeuvres]
    assert len(found) == 4
    assert found == [each.to_json() for each in again.summary.manoeuvres]
    assert ended.summary.flight.to_json() == again.summary.flight.to_json()
    live, own = (by_topic(tmp_path / f"{name}.mcap") for name in ("live", "live-again"))
    assert [topic for topic, *_ in live].count("/yawid/manoeuvre") == 4
    assert live == own
    assert ended.exit_code == again.exit_code == 0


def test_a_line_is_said_as_a_manoeuvre_ends_and_stands_in_the_summary(tmp_path: Path):
    with listening(tmp_path, RunConfig()) as session:
        # The fourth manoeuvre begins at 110 s of the vehicle's time.
        send(GAPS, session.port)
        session.screen.wait_for("manoeuvre 3 (")
    [ended] = session.ended
    roll = ended.summary.manoeuvres[0].dutch_roll
    assert told(ended)[0] == (
        "manoeuvre 1 (34 to 60 s, FBWA, 50.9 m/s): "
        f"wn {to_two_digits(roll.wn_rad_s, roll.wn_std)} rad/s, "
        f"zeta {to_two_digits(roll.zeta, roll.zeta_std)}"
    )
    assert [line.split(" ")[1] for line in told(ended)] == ["1", "2", "3", "4"]
    said = session.screen.getvalue()
    assert [line in said for line in told(ended)] == [True] * 4


def test_of_one_that_cannot_be_used_the_first_fatal_reason_is_said(tmp_path: Path):
    sent = frames(20.0)
    config = replace(CONFIG, rate=4.0)
    with listening(tmp_path, config) as session:
        send(sent, session.port)
    [ended] = session.ended
    [found] = ended.summary.manoeuvres
    fatal = [reason.id for reason in found.verdict.reasons if reason.weight == "fatal"]
    [line] = told(ended)
    assert line.endswith(f": not usable: {fatal[0]}")
    assert ended.exit_code == ended.summary.exit_code != 0


@pytest.fixture
def slow_fit(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """A fit that is not done before this is set."""
    done = threading.Event()

    def wait(*asked: object) -> Manoeuvre:
        assert done.wait(60.0)
        return answer(*asked)  # type: ignore[arg-type] # as the stage calls it

    monkeypatch.setattr("yawid.manoeuvre.stage.answer", wait)
    return done


def test_the_loop_does_not_wait_for_a_fit_and_the_end_of_the_session_does(
    slow_fit: threading.Event, tmp_path: Path
):
    with listening(tmp_path, RunConfig()) as session:
        send(GAPS, session.port)
        wait_for_size(session.part("tlog"), tlog_size(GAPS))
        session.screen.wait_for("tracking")
        assert "manoeuvre 1" not in session.screen.getvalue()
        session.stop.is_set = True
        slow_fit.set()
    assert len(told(session.ended[0])) == 4


def test_a_second_signal_ends_a_session_that_waits_for_a_fit(
    slow_fit: threading.Event, tmp_path: Path
):
    def end_twice(stop: StopFlag, _: object) -> None:
        stop.is_set = True
        time.sleep(1.0)
        interrupt()

    begun_s = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        attend(tmp_path, end_twice)
    assert time.monotonic() - begun_s < 300.0
    assert left(tmp_path) == {"live.tlog.part", "live.mcap.part"}
    slow_fit.set()


def test_a_process_does_not_wait_for_the_worker_when_it_exits():
    begun_s = time.monotonic()
    script = (
        "import time; from yawid.runs.live.worker import WorkThread; "
        "print(WorkThread('fits').submit(time.sleep, 300).done())"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, timeout=100, check=True
    )
    assert ended.stdout.strip() == b"False"
    assert time.monotonic() - begun_s < 100.0


def test_a_fit_that_fails_ends_a_replay_and_of_a_session_the_estimation_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    attend(tmp_path, lambda stop, _: setattr(stop, "is_set", True))

    def fail(*_: object) -> Manoeuvre:
        raise ArithmeticError("singular")

    monkeypatch.setattr("yawid.manoeuvre.stage.answer", fail)
    with pytest.raises(ArithmeticError, match="singular"):
        replayed(tmp_path / "live.tlog", CONFIG)
    folder = tmp_path / "failed"
    screen = attend(folder, lambda stop, _: setattr(stop, "is_set", True)).getvalue()
    assert "estimation failed because of" in screen
    assert "singular" in screen
    assert "exit code 70" in screen
    assert left(folder) == {"live.tlog", "live.mcap"}


def test_a_manoeuvre_is_reported_when_it_ends_and_not_when_the_session_does(tmp_path: Path):
    longest, sent = frames(120.0), 0
    with listening(tmp_path, RunConfig()) as session:
        for first in range(0, len(longest), 2000):  # no socket's buffer holds all of them
            send(longest[first : first + 2000], session.port)
            sent += tlog_size(longest[first : first + 2000])
            wait_for_size(session.part("tlog"), sent)
        # Two seconds of silence end it, which the next frames show.
        send(frames(6.0, first_s=230.0), session.port)
        session.screen.wait_for("manoeuvre 1 (")


def test_how_threads_switch_is_afterwards_as_it_was(tmp_path: Path):
    before_s = sys.getswitchinterval()
    with listening(tmp_path):
        assert sys.getswitchinterval() == pytest.approx(0.001)
    assert sys.getswitchinterval() == before_s


def test_each_vehicle_has_its_own_manoeuvres(tmp_path: Path):
    sent = {sysid: frames(20.0 + sysid, sysid=sysid) for sysid in (1, 2)}
    with listening(tmp_path, every_vehicle=True) as session:
        for own in sent.values():
            send(own, session.port)
        # What 1 sent before 2 was known to be a vehicle stands in its tlog too.
        wait_for_size(session.part("tlog", "live-2"), tlog_size(sent[2]))

    for sysid, ended in zip(sent, session.ended, strict=True):
        again = replayed(tmp_path / f"live-{sysid}.tlog", CONFIG)
        assert ended.summary.vehicle.sysid == sysid
        [found] = ended.summary.manoeuvres
        assert found.n == 1
        assert found.to_json() == again.summary.manoeuvres[0].to_json()
        assert ended.summary.flight.to_json() == again.summary.flight.to_json()
        [line] = told(ended)
        assert line.startswith(f"manoeuvre 1 ({found.from_s:.0f} to {found.to_s:.0f} s, ")
        assert f"system {sysid}: {line}" in session.screen.getvalue()
    one, two = (ended.summary.manoeuvres[0] for ended in session.ended)
    assert (one.duration_s, one.dutch_roll) != (two.duration_s, two.dutch_roll)
