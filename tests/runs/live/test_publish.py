"""A session that publishes: what a ground station receives, and that the session is no other."""

from __future__ import annotations

import math
import re
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from struct import pack
from typing import Any

import pytest
from checks.children import free_udp_port
from live_link import CONFIG, frames, listening, received, send, wait_until
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import yawid
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll, Flight
from yawid.channels.stage import WANTED
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.summary import of_stream
from yawid.runs.live import LiveOptions
from yawid.runs.live.publish import values_of, verdict_text
from yawid.runs.live.running_answer import Answer, RunningAnswer, said
from yawid.runs.live.screen_facts import Gatherer
from yawid.sources.mavlink.decoder import Decoder

# One doublet, and rest, that ends the manoeuvre.
SENT = frames(24.0, doublet_s=9.0)
PARAM_VALUE = 22


@pytest.fixture
def stations() -> Iterator[list[socket.socket]]:
    """Two ground stations."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        for station in (one, two):
            station.bind(("127.0.0.1", 0))
            station.settimeout(0.2)
        yield [one, two]


def ends(stations: list[socket.socket]) -> tuple[str, ...]:
    return tuple(f"udpout:127.0.0.1:{each.getsockname()[1]}" for each in stations)


def receive(station: socket.socket, enough: Callable[[list[Any]], bool]) -> list[Any]:
    """Return the messages that a station receives until there are enough of them."""
    parser, found, patience_s = mavlink.MAVLink(None), [], time.monotonic() + 60.0
    while not enough(found):
        assert time.monotonic() < patience_s, f"only {Counter(m.get_type() for m in found)}"
        with suppress(TimeoutError):
            found += parser.parse_buffer(station.recv(2048)) or []
    return found


def values(messages: list[Any]) -> dict[str, float]:
    """Return the newest values by name."""
    return {m.name: m.value for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"}


def stamped(sent: list[bytes], first: int = 0) -> bytes:
    """Return a tlog of frames."""
    begin_us = 1_700_000_000_000_000
    return b"".join(pack(">Q", begin_us + 6_000 * i) + f for i, f in enumerate(sent, first))


def test_ground_stations_get_the_flight_s_answer_and_the_session_stays_what_it_is(
    tmp_path: Path, stations: list[socket.socket]
) -> None:
    with listening(tmp_path, publish=ends(stations), line_s=0.02) as session:
        session.fly(SENT)
        got = receive(
            stations[0],
            lambda found: (
                {"yaw_wn", "yaw_ok"} <= values(found).keys()
                and any("yawid m1" in m.text for m in found if m.get_type() == "STATUSTEXT")
            ),
        )
        station = stations[1]  # it gets the same bytes
        for message in got:
            assert station.recv(2048) == bytes(message.get_msgbuf())
        # What is published comes back over the link, as from a router.
        echo = [bytes(message.get_msgbuf()) for message in got]
        session.fly(echo)
        lines = len(session.lines(" samples"))
        wait_until(lambda: len(session.lines(" samples")) >= lines + 3)
    [(summary, _)] = session.ended
    assert (summary.vehicle.sysid, summary.vehicle.compid) == (1, 1)
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in got} == {(1, 194)}
    beats = [m for m in got if m.get_type() == "HEARTBEAT"]
    assert {(m.type, m.autopilot) for m in beats} == {(18, 8)}
    roll = summary.flight.dutch_roll
    assert values(got) == pytest.approx(
        {
            "yaw_wn": roll.wn_rad_s, "yaw_wn_sd": roll.wn_std,
            "yaw_zeta": roll.zeta, "yaw_z_sd": roll.zeta_std, "yaw_ok": 1.0,
        }
    )  # fmt: skip
    assert summary.flight.verdict.usable
    newest = max(m.time_boot_ms for m in got if m.get_type() == "NAMED_VALUE_FLOAT")
    assert newest == pytest.approx(124_000, abs=100)  # the vehicle's time
    decoder = Decoder(WANTED)
    decoder.feed((tmp_path / "live.tlog").read_bytes())
    decoder.finish()
    assert dict(decoder.link.senders) == {(1, 1): len(SENT), (1, 194): len(echo)}
    assert summary.link.lost == 0
    assert session.again().estimates == summary.estimates
    # The line has the flight's answer with its sigma too.
    shown = re.search(
        r"wn ([\d.]+) ± ([\d.]+) rad/s, zeta ([\d.]+) ± ([\d.]+)", session.lines(" samples")[-1]
    )
    of_flight = (roll.wn_rad_s, roll.wn_std, roll.zeta, roll.zeta_std)
    for text, value in zip(shown.groups(), of_flight, strict=True):
        assert text == f"{value:.{len(text.partition('.')[2])}f}"
    assert roll.wn_std > 2.0 * roll.wn_std_noise

    (tmp_path / "quiet.tlog").write_bytes(stamped(SENT))
    options = {name: getattr(CONFIG, name) for name in ("rate", "orders", "memory")}
    quiet = yawid.replay(tmp_path / "quiet.tlog", **options).summary
    assert (quiet.estimates, quiet.verdict) == (summary.estimates, summary.verdict)
    assert quiet.manoeuvres[0].estimates == summary.manoeuvres[0].estimates
    assert quiet.flight.dutch_roll == roll


def test_publish_given_twice_sends_the_same_to_both(
    tmp_path: Path, stations: list[socket.socket], capsys: pytest.CaptureFixture[str]
) -> None:
    port, to = free_udp_port(), ends(stations)
    vehicle = threading.Timer(0.5, send, (frames(4.0), port))
    vehicle.start()
    main(["live", f"udpin:127.0.0.1:{port}", "--seconds", "1.5", "--out", str(tmp_path),
          *(word for each in to for word in ("--publish", each))])  # fmt: skip
    vehicle.join(60.0)

    one, two = map(received, stations)
    assert f"publishing to {', '.join(to)} as" in capsys.readouterr().err
    assert one == two != []


def test_back_over_the_tap_two_vehicles_have_their_turns_each_in_its_own_name(
    tmp_path: Path,
) -> None:
    one, two = frames(10.0, sysid=1), frames(10.0, sysid=2)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link,
        listening(tmp_path, publish=("tap",), every_vehicle=True) as session,
    ):
        link.settimeout(0.2)
        send([*one, *two], session.port, link)
        beats = receive(link, lambda found: sum(m.get_type() == "HEARTBEAT" for m in found) >= 3)
        session.screen.wait_for(
            "2 vehicles share the publisher: the answer of each is sent every 2 s"
        )
    first, second, third = (m.get_srcSystem() for m in beats if m.get_type() == "HEARTBEAT")
    assert {first, second} == {1, 2}
    assert third == first
    assert {m.get_srcComponent() for m in beats} == {194}


def looked_at(config: RunConfig, *until_s: float) -> tuple[Answer, Pipeline]:
    """Return what is known after the last of these times, with a look at each, and the pipeline."""
    decoder, pipeline, answer, first = Decoder(WANTED), Pipeline(config), RunningAnswer(), 0
    for end in (round(len(SENT) * each / 24.0) for each in until_s):
        pipeline.feed(decoder.feed(stamped(SENT[first:end], first)))
        found, first = answer.look(pipeline, decoder.link), end
    return found, pipeline


OFF = replace(CONFIG, manoeuvres="off")
FORGETTING = replace(OFF, memory=5.0)


@pytest.mark.parametrize(
    ("config", "until_s", "is_known"),
    [
        (CONFIG, [8.0], False),  # the rudder has not moved by itself
        (CONFIG, [16.0], True),  # the doublet was flown from 9 s on
        (OFF, [0.1, 4.0, 8.9, 9.3, 11.0, 16.0], True),
        # It has moved within the last 5 s until 15.6 s; a memory later that is forgotten.
        (FORGETTING, [19.6], True),
        (FORGETTING, [21.6], False),
    ],
)
def test_until_a_manoeuvre_is_answered_the_streams_number_is_shown_while_it_is_known_and_not_ok(
    config: RunConfig, until_s: list[float], is_known: bool
) -> None:
    found, pipeline = looked_at(config, *until_s)
    roll = of_stream(pipeline.bank)["els"].dutch_roll

    assert not pipeline.manoeuvres
    assert found == looked_at(config, until_s[-1])[0]
    if not is_known:
        assert (said(found), values_of(found)) == ("running: not known yet", {"yaw_ok": 0.0})
        return
    assert (found.verdict, found.state, found.known) == (None, None, None)
    assert said(found).startswith("running, not judged: wn ")
    assert found.running == roll
    assert roll.wn_std < 0.1 * roll.wn_rad_s
    assert values_of(found) == {
        "yaw_wn": roll.wn_rad_s, "yaw_wn_sd": roll.wn_std,
        "yaw_zeta": roll.zeta, "yaw_z_sd": roll.zeta_std, "yaw_ok": 0.0,
    }  # fmt: skip


def test_what_a_log_lacks_is_the_verdict_before_a_manoeuvre_and_an_assumed_rudder_is_marked() -> (
    None
):
    found = looked_at(CONFIG, 0.0)[0]
    assert found.state == "no_vehicle"
    assert verdict_text(found) == "yawid: not usable: no_vehicle"

    decoder, pipeline = Decoder(WANTED), Pipeline(CONFIG)
    heard = [f for f in SENT if int.from_bytes(f[7:10], "little") != PARAM_VALUE]
    pipeline.feed(decoder.feed(stamped(heard)))
    assert Gatherer().facts(pipeline, decoder.link, "", Answer(None)).rudder == (
        'SERVO_OUTPUT_RAW.servo4_raw (assumed: no parameters were heard; in MAVProxy type "param '
        'fetch")'
    )


ROLL = DutchRoll(wn_rad_s=10.06, wn_std=0.28, zeta=0.646, zeta_std=0.042)
NO_SIGMA = DutchRoll(wn_rad_s=10.06, wn_std=math.nan, zeta=0.646, zeta_std=math.nan)
FLIGHTS = (Flight(dutch_roll=ROLL, used=[1], disagree=[], verdict=Verdict.of([])),)
REFUSED = Verdict.of([Reason("manoeuvres_disagree", "..."), Reason("poor_fit", "...")])
OK, BARE = Verdict.of([]), {"yaw_wn", "yaw_zeta", "yaw_ok"}
NAMED = BARE | {"yaw_wn_sd", "yaw_z_sd"}


@pytest.mark.parametrize(
    ("answer", "names", "ok", "text"),
    [
        (Answer(None), {"yaw_ok"}, 0.0, None),
        (Answer(None, running=NO_SIGMA), BARE, 0.0, None),
        (Answer(OK, FLIGHTS), NAMED, 1.0, "usable, wn 10.06+-0.28, zeta 0.646+-0.042"),
        (Answer(REFUSED, FLIGHTS), {"yaw_ok"}, 0.0, "not usable: poor_fit"),
        (Answer(REFUSED, FLIGHTS, ROLL), NAMED, 0.0, "not usable: poor_fit"),
        (Answer(OK, (), ROLL), NAMED, 0.0, None),
    ],
)
def test_only_the_flights_answer_is_ok_what_is_not_known_is_left_out_and_a_text_fits(
    answer: Answer, names: set[str], ok: float, text: str | None
) -> None:
    assert values_of(answer).keys() == names
    assert values_of(answer)["yaw_ok"] == ok
    assert text is None or verdict_text(answer) == f"yawid: {text}"


def test_what_is_published_back_over_the_tap_may_transmit() -> None:
    options = LiveOptions("udpin:127.0.0.1:14560", publish=("udpout:127.0.0.1:14570",))
    assert not options.may_transmit
    assert replace(options, publish=(*options.publish, "tap")).may_transmit
