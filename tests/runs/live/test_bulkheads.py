"""An error nobody foresaw, raised in each part of a session: that part ends, the others go on."""

from __future__ import annotations

import io
import re
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest
from checks.children import free_udp_port
from flights.surgery import split
from live_link import CONFIG, Session, frames, listening, send, tlog_size, wait_for_size

from yawid.errors import ConfigError
from yawid.runs.live import LiveOptions, live
from yawid.runs.live.bulkhead import Bulkhead
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sinks.mcap.reader import open_run
from yawid.sinks.terminal.console import Console

SENT = {sysid: frames(20.0, sysid=sysid, doublet_s=6.0) for sysid in (1, 2)}
FIRST = list(chain.from_iterable(zip(*(sent[:1000] for sent in SENT.values()), strict=True)))
REST = list(chain.from_iterable(zip(*(sent[1000:] for sent in SENT.values()), strict=True)))
CAUSE = "ZeroDivisionError at test_bulkheads.py:"


def fail(
    monkeypatch: pytest.MonkeyPatch, place: str, where: Callable[..., bool] = lambda *_: True
) -> None:
    """Have a function raise where its arguments say so."""
    real = resolve_name(place)

    def raising(*given: Any, **named: Any) -> Any:
        if where(*given):
            raise ZeroDivisionError("one wrong number")
        return real(*given, **named)

    monkeypatch.setattr(place, raising)


def fly_two(session: Session) -> None:
    """Send both flights to their ends and wait until the tlogs hold them."""
    for sent in (FIRST, REST):
        for at in range(0, len(sent), 500):
            send(sent[at : at + 500], session.port)
            time.sleep(0.02)
    for sysid, sent in SENT.items():
        wait_for_size(session.part("tlog", f"live-{sysid}"), tlog_size(sent))


def whole(path: Path, sysid: int) -> bool:
    """Whether a tlog holds every frame that the vehicle sent."""
    recorded = [frame for _, frame in split(path.read_bytes())]
    return [frame for frame in recorded if frame[5] == sysid] == SENT[sysid]


ESTIMATING: dict[str, Callable[..., bool]] = {
    "yawid.estimation.bank.Bank.run": lambda bank, _: bank.config.sysid == 2,
    "yawid.manoeuvre.stage.answer": lambda _, __, setting, ___: setting.config.sysid == 2,
    "yawid.runs.live.vehicle_session.summarise": lambda pipeline, *_: (
        pipeline.config.sysid == 2 and pipeline.bank is not None
    ),
}


@pytest.mark.parametrize("place", ESTIMATING)
def test_where_one_vehicle_s_estimation_fails_its_tlog_and_the_other_vehicle_go_on(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with monkeypatch.context() as patched:
        fail(patched, place, ESTIMATING[place])
        with listening(tmp_path, every_vehicle=True) as session:
            fly_two(session)
    ended = dict(zip((1, 2), session.ended, strict=True))
    assert all(whole(tmp_path / f"live-{sysid}.tlog", sysid) for sysid in SENT)

    said = [line for line in session.screen.getvalue().splitlines() if "estimation failed" in line]
    assert len(said) == 1
    assert "system 2: the estimation failed because of" in said[0]
    assert CAUSE in said[0]
    assert "one wrong number" in said[0]
    assert "system 2: failed in this session: estimation; exit code 70" in session.screen.getvalue()
    assert ended[2].exit_code == 70
    for of_file in (
        open_run(tmp_path / "live-2.mcap").summary.to_json(),
        ended[2].summary.to_json(),
    ):
        assert not of_file["verdict"]["usable"]
        assert CAUSE in of_file["verdict"]["reasons"][0]["text"]
        assert of_file["vehicle"]["sysid"] == 2
        assert any(CAUSE in text for text in of_file["live"]["failed"])

    assert ended[1].exit_code in (0, 5)
    again = replay(tmp_path / "live-1.tlog", asdict(CONFIG), Outputs(tmp_path, "again"), StopFlag())
    assert again.estimates == ended[1].summary.estimates
    assert [m.estimates for m in again.manoeuvres] == [
        m.estimates for m in ended[1].summary.manoeuvres
    ]
    assert len(again.manoeuvres) == 1


def causes(session: Session) -> list[str]:
    return [line for line in session.screen.getvalue().splitlines() if CAUSE in line]


OUTPUTS = {
    "yawid.runs.live.screen_facts.Gatherer.facts": "status",
    "yawid.runs.live.vehicle_session.RerunSink.take": "viewer",
    "yawid.runs.live.publish.values_of": "publishing",
    "yawid.sources.link.publisher.Publisher.send_texts": "publishing",
    "yawid.runs.live.loop.RateRequests.tick": "asking for rates",
    "yawid.sinks.mcap.sink.McapSink._write": "mcap",
    "yawid.sinks.mcap.sink.McapSink._finish": "mcap",
    "yawid.runs.live.guarded_sink.TlogRecorder._write": "tlog",
}
LIVE, LINK, SINK = "yawid.runs.live.", "yawid.sources.link.", "yawid.sinks.mcap.sink.McapSink."


@pytest.mark.parametrize(
    "places",
    [
        (*list(OUTPUTS)[:3], LIVE + "loop.RateRequests.tick"),
        (LINK + "publisher.Publisher.send_texts", SINK + "_write"),
        (SINK + "_finish",),
        (LIVE + "guarded_sink.TlogRecorder._write",),
    ],
    ids=("beside", "mcap and publisher", "the end of the mcap", "tlog"),
)
def test_where_outputs_fail_each_is_said_once_the_rest_goes_on_and_the_exit_code_is_6(
    places: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    failed = {OUTPUTS[place] for place in places}
    shown = Outputs(tmp_path, "live", "rerun+http://127.0.0.1:9/proxy")
    asked = {"publish": ("tap",), "request_hz": 50.0}
    with monkeypatch.context() as patched:
        for place in places:
            fail(patched, place)
        with listening(tmp_path, outputs=shown, **asked) as session:
            send(SENT[1][:1500], session.port)
            if failed == {"tlog"}:
                session.screen.wait_for("tracking")
            else:
                wait_for_size(session.part("tlog"), tlog_size(SENT[1][:1500]))
                send(SENT[1][1500:], session.port)
                wait_for_size(session.part("tlog"), tlog_size(SENT[1]))
            patience_s = time.monotonic() + 60.0
            while len(causes(session)) < len(failed - {"mcap"}) and time.monotonic() < patience_s:
                time.sleep(0.05)
    [ended] = session.ended
    text = session.screen.getvalue()
    assert len(causes(session)) == len(failed), text
    for name in failed:
        assert re.search(f"failed in this session: .*{name}.*; exit code 6", text)
    files = {"mcap", "tlog"} - failed
    assert (ended.exit_code, set(ended.summary.files)) == (6, files)
    assert [CAUSE in text for text in ended.summary.live.failed] == [True] * len(failed)
    assert ended.summary.estimates["els"].updates > 100
    if "tlog" in files:
        assert whole(tmp_path / "live.tlog", 1)
        again = replay(
            tmp_path / "live.tlog", asdict(CONFIG), Outputs(tmp_path, "again"), StopFlag()
        )
        assert again.estimates == ended.summary.estimates


def test_a_screen_that_fails_is_left_for_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    fail(monkeypatch, "yawid.sinks.terminal.live_page.Page.__rich_console__")
    stream, stop, ended = io.StringIO(), StopFlag(), []
    console = Console(stream, draws=True)
    options = LiveOptions(f"udpin:127.0.0.1:{free_udp_port()}", seconds=600.0)

    def listen() -> None:
        ended.extend(live(options, CONFIG, Outputs(tmp_path, "live"), stop, console))

    session = threading.Thread(target=listen, daemon=True)
    session.start()
    patience_s = time.monotonic() + 60.0
    while stream.getvalue().count("samples") < 2 and time.monotonic() < patience_s:
        send(SENT[1][:100], int(options.endpoint.rpartition(":")[2]))
        time.sleep(0.1)
    stop.is_set = True
    session.join(60.0)
    text = stream.getvalue()
    assert text.count(CAUSE) == 1
    assert "the screen failed because of" in text
    assert "Traceback" not in text
    assert text.count("samples") >= 2  # lines on where the session stands
    assert "failed in this session: the screen; exit code 6" in text
    assert [each.exit_code for each in ended] == [6]


def test_a_link_whose_thread_fails_ends_the_session_with_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    calls = []
    fail(
        monkeypatch, "yawid.sources.link.udp.UdpTap._put", lambda *_: len(calls) or calls.append(1)
    )
    with listening(tmp_path) as session:
        send(SENT[1], session.port)
        session.screen.wait_for("failed: ZeroDivisionError: one wrong number")
    assert [each.exit_code for each in session.ended] == [6]


def test_what_does_not_fit_passes_and_the_first_of_other_errors_is_said():
    said: list[str] = []
    part = Bulkhead("the part", "it goes on", said.append, lambda e: isinstance(e, ConfigError))
    assert part.attempt(lambda: 1, 0) == 1
    with pytest.raises(ConfigError):
        part.attempt(lambda: LiveOptions("udp:").seconds, None)
    assert (part.failure, said) == (None, [])
    for _ in range(2):
        assert part.attempt(lambda: 1 // 0, 0) == 0
    [line] = said
    assert line.startswith("the part failed because of ZeroDivisionError at test_bulkheads.py:")
    assert line.endswith(": it goes on")
