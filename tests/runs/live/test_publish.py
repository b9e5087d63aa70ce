"""A session that publishes: what a ground station receives, and that the session is no other."""

from __future__ import annotations

import math
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from struct import pack

import pytest
from checks.children import free_udp_port
from live_link import CONFIG, frames, listening, send, tlog_size, wait_for_size
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll, Flight
from yawid.channels.stage import WANTED
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.pipeline import Pipeline
from yawid.results.summary import of_stream
from yawid.runs.live import LiveOptions
from yawid.runs.live.publish import values_of, verdict_text
from yawid.runs.live.running_answer import Answer, RunningAnswer, said
from yawid.runs.live.screen_facts import Gatherer
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions

# One doublet, and rest, that ends the manoeuvre.
SENT = frames(24.0, doublet_s=9.0)
PARAM_VALUE = 22


@pytest.fixture
def ground() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(0.2)
        yield station


def receive(station: socket.socket, enough: Callable[[list[object]], bool]) -> list[object]:
    """Return the messages that a station receives until there are enough of them."""
    parser, found, patience_s = mavlink.MAVLink(None), [], time.monotonic() + 60.0
    while not enough(found):
        assert time.monotonic() < patience_s, f"only {Counter(m.get_type() for m in found)}"
        try:
            found += parser.parse_buffer(station.recv(2048)) or []
        except TimeoutError:
            continue
    return found


def at_free_port(listener: socket.socket) -> int:
    listener.bind(("127.0.0.1", 0))
    listener.settimeout(10.0)
    return int(listener.getsockname()[1])


def values(messages: list[object]) -> dict[str, float]:
    """Return the newest values by name."""
    return {m.name: m.value for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"}


def test_a_ground_station_gets_the_flight_s_answer_and_the_session_stays_what_it_is(
    tmp_path: Path, ground: socket.socket
):
    host, port = ground.getsockname()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
        listening(
            tmp_path, publish=(f"udpout:{host}:{port}", f"udpout:{host}:{at_free_port(second)}")
        ) as session,
    ):
        second.settimeout(60.0)
        send(SENT, session.port)
        got = receive(
            ground,
            lambda found: (
                {"yaw_wn", "yaw_ok"} <= values(found).keys()
                and any("yawid m1" in m.text for m in found if m.get_type() == "STATUSTEXT")
            ),
        )
        for message in got:  # the second ground station gets the same bytes
            assert second.recv(2048) == bytes(message.get_msgbuf())
        # What is published comes back over the link, as from a router.
        echo = [bytes(message.get_msgbuf()) for message in got]
        send(echo, session.port)
        wait_for_size(session.part("tlog"), tlog_size([*SENT, *echo]))
    [ended] = session.ended
    summary = ended.summary
    assert (summary.vehicle.sysid, summary.vehicle.compid) == (1, 1)
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in got} == {(1, 194)}
    beats = [m for m in got if m.get_type() == "HEARTBEAT"]
    assert {(m.type, m.autopilot) for m in beats} == {(18, 8)}
    told, roll = values(got), summary.flight.dutch_roll
    assert told == pytest.approx(
        {
            "yaw_wn": roll.wn_rad_s, "yaw_wn_sd": roll.wn_std,
            "yaw_zeta": roll.zeta, "yaw_z_sd": roll.zeta_std,
            "yaw_ok": float(summary.flight.verdict.usable),
        }
    )  # fmt: skip
    newest = max(m.time_boot_ms for m in got if m.get_type() == "NAMED_VALUE_FLOAT")
    assert newest == pytest.approx(124_000, abs=100)  # the vehicle's time
    decoder = Decoder(WANTED)
    decoder.feed((tmp_path / "live.tlog").read_bytes())
    decoder.finish()
    assert dict(decoder.link.senders) == {(1, 1): len(SENT), (1, 194): len(echo)}
    assert summary.link.lost == 0

    quiet = tmp_path / "quiet"
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        listening(tmp_path, outputs=Outputs(quiet, "live")) as session,
    ):
        send(SENT, session.port, vehicle)
        wait_for_size(session.part("tlog"), tlog_size(SENT))
        session.screen.wait_for("manoeuvre 1 (")
        time.sleep(1.1)
        vehicle.settimeout(0.0)
        with pytest.raises(BlockingIOError):  # not one byte that was not asked for
            vehicle.recv(1)
    [other] = session.ended
    assert (other.summary.estimates, other.summary.verdict) == (summary.estimates, summary.verdict)
    assert other.summary.manoeuvres[0].estimates == summary.manoeuvres[0].estimates
    assert other.summary.flight.dutch_roll == summary.flight.dutch_roll
    again = replay(tmp_path / "live.tlog", asdict(CONFIG), Outputs(tmp_path, "again"), StopFlag())
    assert again.estimates == summary.estimates


def test_publish_given_twice_sends_the_same_to_both(
    tmp_path: Path, ground: socket.socket, capsys: pytest.CaptureFixture[str]
):
    port, sent = free_udp_port(), frames(8.0)

    def vehicle() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            for frame in sent:
                link.sendto(frame, ("127.0.0.1", port))
                time.sleep(2.0 / len(sent))

    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
        ThreadPoolExecutor(1) as flying,
    ):
        ends = [f"udpout:127.0.0.1:{ground.getsockname()[1]}"]
        ends.append(f"udpout:127.0.0.1:{at_free_port(second)}")
        flying.submit(vehicle)
        main(["live", f"udpin:127.0.0.1:{port}", "--seconds", "3.5", "--rerun", "off", "--out",
              str(tmp_path), *(x for each in ends for x in ("--publish", each))])  # fmt: skip
        got = []
        for station in (ground, second):
            station.settimeout(0.2)
            got.append([])
            with suppress(TimeoutError):
                while True:
                    got[-1].append(station.recv(2048))

    assert f"publishing to {', '.join(ends)} as" in capsys.readouterr().err
    assert got[0]
    assert got[0] == got[1]


def test_back_over_the_tap_two_vehicles_have_their_turns_each_in_its_own_name(tmp_path: Path):
    one, two = frames(10.0, sysid=1), frames(10.0, sysid=2)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link,
        listening(tmp_path, publish=("tap",), every_vehicle=True) as session,
    ):
        link.settimeout(0.2)
        send([*one, *two], session.port, link)
        beats = receive(link, lambda found: sum(m.get_type() == "HEARTBEAT" for m in found) >= 4)
        session.screen.wait_for(
            "2 vehicles share the publisher: the answer of each is sent every 2 s"
        )
    senders = [m.get_srcSystem() for m in beats if m.get_type() == "HEARTBEAT"]
    assert {*senders[:2]} == {*senders[2:4]} == {1, 2}
    assert {m.get_srcComponent() for m in beats} == {194}


def test_what_is_asked_and_what_is_published_is_of_one_sender_in_one_sequence(tmp_path: Path):
    key = bytes(range(32))
    reader, link = mavlink.MAVLink(None), mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key, link.signing.timestamp, link.signing.sign_outgoing = key, 1, True
    options = {
        "publish": ("tap",),
        "request_hz": 50.0,
        "read_options": ReadOptions(key=SigningKey(key)),
    }
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        listening(tmp_path, **options) as session,
    ):
        vehicle.settimeout(60.0)
        send(
            [bytes(reader.decode(bytearray(f)).pack(link)) for f in SENT[:60]],
            session.port,
            vehicle,
        )
        got = [vehicle.recv(300) for _ in range(5)]
    strict = mavlink.MAVLink(None)  # it refuses what is not newer than the frame before
    strict.signing.secret_key, strict.signing.timestamp = key, 1
    read = [strict.decode(bytearray(frame)) for frame in got]
    assert {"COMMAND_LONG", "HEARTBEAT"} <= {m.get_type() for m in read}
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in read} == {(1, 194)}
    assert [m.get_seq() for m in read] == [*range(5)]


def flown(config: RunConfig, until_s: float) -> tuple[Pipeline, Decoder]:
    """Return a session's pipeline and decoder after ``until_s`` of what is sent."""
    decoder, pipeline = Decoder(WANTED), Pipeline(config)
    sent = SENT[: round(len(SENT) * until_s / 24.0)]
    records = [pack(">Q", 1_700_000_000_000_000 + 6_000 * i) + f for i, f in enumerate(sent)]
    pipeline.feed(decoder.feed(b"".join(records)))
    return pipeline, decoder


def test_until_a_manoeuvre_is_answered_the_streams_number_is_published_as_not_ok():
    pipeline, decoder = flown(CONFIG, 16.0)  # the doublet was flown from 9 s on
    found = RunningAnswer().look(pipeline, decoder.link)

    roll = of_stream(pipeline.bank)["els"].dutch_roll
    assert not pipeline.manoeuvres
    assert (found.verdict, found.state, found.known) == (None, None, None)
    assert found.running == roll
    assert roll.wn_std < 0.1 * roll.wn_rad_s
    assert values_of(found) == {
        "yaw_wn": roll.wn_rad_s, "yaw_wn_sd": roll.wn_std,
        "yaw_zeta": roll.zeta, "yaw_z_sd": roll.zeta_std, "yaw_ok": 0.0,
    }  # fmt: skip
    assert said(found).startswith("running, not judged: wn ")


def test_before_the_rudder_has_moved_by_itself_there_is_no_number():
    pipeline, decoder = flown(CONFIG, 8.0)
    found = RunningAnswer().look(pipeline, decoder.link)

    assert values_of(found) == {"yaw_ok": 0.0}
    assert said(found) == "running: not known yet"


def test_once_the_movement_is_forgotten_the_streams_number_is_not_known_any_more():
    """The rudder has moved within the last 5 s until 15.6 s, and a memory later that is forgotten.

    Without a search for manoeuvres the number is shown by the same rule.
    """
    off = replace(CONFIG, memory=5.0, manoeuvres="off")
    pipeline, decoder = flown(off, 19.6)
    recent = RunningAnswer().look(pipeline, decoder.link)
    pipeline, decoder = flown(off, 21.6)
    roll = of_stream(pipeline.bank)["els"].dutch_roll

    assert said(recent).startswith("running, not judged: wn ")
    assert roll.wn_std < 0.1 * roll.wn_rad_s  # P alone would show it
    assert said(RunningAnswer().look(pipeline, decoder.link)) == "running: not known yet"


def test_looks_in_between_see_the_movement_that_one_look_at_the_end_sees():
    pipeline, decoder = flown(replace(CONFIG, manoeuvres="off"), 0.1)
    answer, last = RunningAnswer(), 0.1
    for until_s in (4.0, 8.9, 9.3, 11.0, 16.0):
        first, end = (round(len(SENT) * each / 24.0) for each in (last, until_s))
        sent = enumerate(SENT[first:end], first)
        stamped = [pack(">Q", 1_700_000_000_000_000 + 6_000 * i) + f for i, f in sent]
        pipeline.feed(decoder.feed(b"".join(stamped)))
        found, last = answer.look(pipeline, decoder.link), until_s
        assert (found.running is not None) == (until_s > 10.0), until_s

    once = RunningAnswer()
    assert once.look(pipeline, decoder.link) == found
    assert once._excited_at == answer._excited_at


def test_what_a_log_lacks_is_the_verdict_before_a_manoeuvre():
    decoder, pipeline = Decoder(WANTED), Pipeline(CONFIG)
    found = RunningAnswer().look(pipeline, decoder.link)

    assert found.state == "no_vehicle"
    assert verdict_text(found) == "yawid: not usable: no_vehicle"


def test_the_screen_marks_a_rudder_that_was_assumed():
    decoder, pipeline = Decoder(WANTED), Pipeline(CONFIG)
    heard = [f for f in SENT if int.from_bytes(f[7:10], "little") != PARAM_VALUE]
    records = [pack(">Q", 1_700_000_000_000_000 + 6_000 * i) + f for i, f in enumerate(heard)]
    pipeline.feed(decoder.feed(b"".join(records)))

    assert Gatherer().facts(pipeline, decoder.link, "", Answer(None)).rudder == (
        'SERVO_OUTPUT_RAW.servo4_raw (assumed: no parameters were heard; in MAVProxy type "param '
        'fetch")'
    )


ROLL = DutchRoll(wn_rad_s=10.06, wn_std=0.28, zeta=0.646, zeta_std=0.042)


FLIGHT = Flight(dutch_roll=ROLL, used=[1], disagree=[], verdict=Verdict.of([]))


def test_a_number_that_is_not_known_is_left_out():
    assert values_of(Answer(None)) == {"yaw_ok": 0.0}
    unknown = DutchRoll(wn_rad_s=10.06, wn_std=math.nan, zeta=0.646, zeta_std=math.nan)
    assert values_of(Answer(None, running=unknown)).keys() == {"yaw_wn", "yaw_zeta", "yaw_ok"}


def test_only_the_flights_answer_is_ok():
    refused = Verdict.of([Reason("poor_fit", "...")])

    assert values_of(Answer(Verdict.of([]), (FLIGHT,)))["yaw_ok"] == 1.0
    assert values_of(Answer(refused, (FLIGHT,)))["yaw_ok"] == 0.0
    assert values_of(Answer(refused, (FLIGHT,), ROLL))["yaw_ok"] == 0.0
    assert values_of(Answer(Verdict.of([]), (), ROLL))["yaw_ok"] == 0.0


def test_a_verdict_is_a_text_that_fits():
    refused = Verdict.of([Reason("manoeuvres_disagree", "..."), Reason("poor_fit", "...")])
    assert verdict_text(Answer(refused, (FLIGHT,))) == "yawid: not usable: poor_fit"
    told = verdict_text(Answer(Verdict.of([]), (FLIGHT,)))
    assert told == "yawid: usable, wn 10.06+-0.28, zeta 0.646+-0.042"


def test_what_is_published_back_over_the_tap_may_transmit_and_no_end_is_given_twice():
    options = LiveOptions("udpin:127.0.0.1:14560", publish=("udpout:127.0.0.1:14570",))
    assert not options.may_transmit
    assert replace(options, publish=("tap",)).may_transmit
    assert replace(options, publish=(*options.publish, "tap")).may_transmit
    with pytest.raises(ConfigError, match="14570 is given twice"):
        replace(options, publish=options.publish * 2)
