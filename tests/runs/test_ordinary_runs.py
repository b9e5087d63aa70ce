"""Ordinary flight at the door: next to the other answers, or alone, and never in their place."""

from __future__ import annotations

import io
import json
import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import jsonschema
import pytest
from flights.surgery import split
from live_link import listening, send, tlog_size, wait_for_size
from mcap.reader import make_reader
from ordinary_plant import AIRSPEED_M_S, as_tlog, flown, truth
from printed import printed

import yawid
from yawid.answers.model_parts import DutchRoll
from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Flight, RunSummary
from yawid.channels.stage import WANTED
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.dataset.schema import TABLES
from yawid.dataset.summary_rows import flight_rows
from yawid.errors import NotIdentifiable
from yawid.pipeline import Pipeline
from yawid.report.bare import ordinary_section, spectra_picture
from yawid.report.write import write_report
from yawid.results.ordinary_flight import compared
from yawid.runs.live.publish import values_of
from yawid.runs.live.running_answer import RunningAnswer, said
from yawid.sinks.run_page import print_summary
from yawid.sources.mavlink.decoder import Decoder


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six minutes of turns in light gusts, in which the rudder rests."""
    path = tmp_path_factory.mktemp("ordinary") / "turns.tlog"
    path.write_bytes(as_tlog(flown(4, seconds=360.0, gust=0.005)))
    return path


class Replayed(NamedTuple):
    """A replay with --json: its exit code, what it printed, and its file."""

    code: int
    told: dict[str, Any]
    mcap: Path


def replayed(log: Path, folder: Path, *options: object) -> Replayed:
    words = "replay", log, "--json", "--out", folder, *options
    with redirect_stdout(io.StringIO()) as out:
        code = main([str(word) for word in words])
    return Replayed(code, printed("replay", out.getvalue()), folder / "turns.mcap")


@pytest.fixture(scope="session")
def next_to(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    return replayed(log, tmp_path_factory.mktemp("auto"))


@pytest.fixture(scope="session")
def alone(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    return replayed(log, tmp_path_factory.mktemp("only"), "--ordinary", "only")


@pytest.fixture(scope="session")
def without(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    return replayed(log, tmp_path_factory.mktemp("off"), "--ordinary", "off")


@pytest.fixture(scope="session")
def short(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    return replayed(log, tmp_path_factory.mktemp("short"), "--ordinary", "only", "--to", 200)


def page(told: dict[str, Any]) -> str:
    """Return what a terminal shows, on one line."""
    out = io.StringIO()
    print_summary(RunSummary.from_json(json.dumps(told).encode()), out)
    return " ".join(out.getvalue().split())


def messages(path: Path, *topics: str) -> list[tuple[str, Any, bytes]]:
    with path.open("rb") as stream:
        found = make_reader(stream).iter_messages(topics or None, log_time_order=False)
        return [(channel.topic, schema, message.data) for schema, channel, message in found]


def test_the_mode_stands_next_to_the_refusal_of_the_rudders_question(next_to: Replayed) -> None:
    found, (wn, zeta) = next_to.told["ordinary"], truth()

    assert (next_to.code, next_to.told["verdict"]["reasons"][0]["id"]) == (5, "not_excited")
    assert found["verdict"]["usable"]
    assert abs(found["dutch_roll"]["wn_rad_s"] - wn) < 2.0 * found["dutch_roll"]["wn_std"]
    assert abs(found["dutch_roll"]["zeta"] - zeta) < 2.0 * found["dutch_roll"]["zeta_std"]
    assert found["airspeed_m_s"] == pytest.approx(AIRSPEED_M_S)
    assert "flight" not in next_to.told


def test_alone_it_is_the_verdict_and_nothing_else_is_answered(
    next_to: Replayed, alone: Replayed
) -> None:
    assert alone.code == 0
    assert alone.told["verdict"] == {"method": "ordinary", "usable": True, "reasons": []}
    assert alone.told["ordinary"] == next_to.told["ordinary"]
    assert not {"flight", "manoeuvres", "estimates"} & alone.told.keys()


def test_alone_a_short_log_is_refused_with_what_is_needed(short: Replayed) -> None:
    [reason] = short.told["verdict"]["reasons"]

    assert (short.code, reason["id"]) == (5, "ordinary_unknown")
    assert "290 s of ordinary flight at one airspeed are needed" in reason["text"]
    assert short.told["verdict"]["next"] == short.told["ordinary"]["verdict"]["next"]
    assert "dutch_roll" not in short.told["ordinary"]


def test_switched_off_nothing_of_it_is_there(without: Replayed, next_to: Replayed) -> None:
    added = {"ordinary"}

    assert next_to.told.keys() - without.told.keys() == added
    assert {k: v for k, v in next_to.told.items() if k not in {*added, "files"}} == {
        k: v for k, v in without.told.items() if k != "files"
    }
    topics, more = ({topic for topic, *_ in messages(run.mcap)} for run in (without, next_to))
    assert more - topics == {"/yawid/attitude", "/yawid/commands", "/yawid/ordinary"}


def test_the_file_has_the_answer_as_json_with_its_schema(next_to: Replayed) -> None:
    [(_, schema, data)] = messages(next_to.mcap, "/yawid/ordinary")
    shape = json.loads(schema.data)

    assert (schema.encoding, shape["type"]) == ("jsonschema", "object")
    jsonschema.Draft202012Validator(shape).validate(json.loads(data))
    assert json.loads(data) == next_to.told["ordinary"]


def test_a_replay_of_the_file_gives_the_same_to_the_bit(
    alone: Replayed, short: Replayed, tmp_path: Path
) -> None:
    whole, cut = (replayed(run.mcap, tmp_path / run.mcap.parent.name) for run in (alone, short))

    for before, again in ((alone, whole), (short, cut)):
        assert again.told["ordinary"] == before.told["ordinary"]
        assert again.told["verdict"] == before.told["verdict"]
        assert again.code == before.code


def test_a_file_without_motion_says_that_the_log_is_needed(
    without: Replayed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = replayed(without.mcap, tmp_path, "--ordinary", "only")

    [reason] = again.told["verdict"]["reasons"]
    assert (again.code, reason["id"]) == (5, "ordinary_unknown")
    assert "holds no lateral motion: for that, replay the log itself" in capsys.readouterr().err


def test_the_page_says_both_plainly(next_to: Replayed) -> None:
    said = page(next_to.told)

    assert "verdict NOT USABLE not_excited: the rudder's largest movement" in said
    row = re.search(r"ordinary wn (\S+) ± \S+ rad/s, zeta (\S+) ± ", said)
    assert row
    assert float(row[1]) == pytest.approx(truth()[0], rel=0.1)
    mode_only = "from ordinary flight: the aircraft without its autopilot, mode only; at 50.0 m/s"
    assert mode_only in said
    assert re.search(r"from 6 of 6 min, \d+ turns", said)


def test_the_page_of_a_refusal_has_the_cause_and_the_remedy(short: Replayed) -> None:
    said = page(short.told)

    assert "ordinary from ordinary flight the aircraft's mode is not known: 290 s of" in said
    assert "next: Fly twelve minutes at one airspeed, with turns" in said


def test_python_has_it_as_a_value_that_is_true_where_it_is_known(
    without: Replayed, alone: Replayed
) -> None:
    unasked, run = (yawid.load(each.mcap) for each in (without, alone))

    assert not unasked.ordinary
    assert unasked.ordinary.verdict.next == 'Replay the log with ordinary="auto".'
    assert run.usable
    assert run.ordinary
    assert not run.flight
    assert "from ordinary flight" in repr(run)
    with pytest.raises(NotIdentifiable):
        run.model("flight")


def test_a_data_set_has_the_mode_over_the_equivalent_airspeed_or_why_not(
    alone: Replayed, short: Replayed
) -> None:
    known, refused = (
        flight_rows(RunSummary.from_json(json.dumps(run.told).encode()), 1, 360.0)[0]
        for run in (alone, short)
    )
    found = alone.told["ordinary"]

    assert known["ordinary_kappa_rad_m"] == pytest.approx(found["dutch_roll"]["wn_rad_s"] / 50.0)
    assert known["usable"]
    assert not {"wn_rad_s", "answer", "method"} & known.keys()
    assert {*known, *refused} <= {name for name, *_ in TABLES["flights"].columns}
    assert refused["ordinary_why"] == "too_short"
    assert not refused["usable"]
    assert "ordinary_wn_rad_s" not in refused


def test_short_flights_of_one_day_answer_together_where_none_alone_can(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    days_s, logs = (0.0, 1200.0, 2400.0, 86400.0), tmp_path / "logs"
    logs.mkdir()
    for i, later_s in enumerate(days_s):  # the last one is alone on its day
        flight = as_tlog(flown(20 + i, seconds=170.0, gust=0.005), later_s)
        (logs / f"{i}.tlog").write_bytes(flight)
    words = "fleet", logs, "--out", tmp_path / "set"
    main([str(word) for word in words])
    capsys.readouterr()

    main(["trend", str(tmp_path / "set"), "--json"])

    kappa, zeta = printed("trend", capsys.readouterr().out)["followed"]
    for each, value in ((kappa, truth()[0] / 50.0), (zeta, truth()[1])):
        assert (each["loop"], each["days"]) == ("ordinary", 1)
        assert abs(each["now"]["value"] - value) < 2.0 * each["now"]["std"]


def test_the_report_shows_the_spectra_it_rests_on(alone: Replayed, short: Replayed) -> None:
    shown = write_report(alone.mcap).read_text(encoding="utf-8")
    refused = RunSummary.from_json(json.dumps(short.told).encode())

    assert "The Dutch roll is ωn" in shown
    assert "Ordinary flight</h2>" in shown
    assert '<figure id="ordinary">' in shown
    assert "290 s of ordinary flight" in "".join(ordinary_section(refused))
    assert spectra_picture(refused.ordinary) is None


def test_inspect_says_whether_the_log_can_give_it_and_what_is_missing(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(log), "--json"]) == 5
    can = printed("inspect", capsys.readouterr().out)["can"]
    assert main(["inspect", str(log), "--json", "--to", "200"]) == 5
    cannot = printed("inspect", capsys.readouterr().out)["can"]

    assert can == {"ordinary": {"yes": True, "lacks": []}}
    assert not cannot["ordinary"]["yes"]
    assert "290 s of ordinary flight at one airspeed are needed" in cannot["ordinary"]["lacks"][0]


def test_a_live_session_ends_with_the_answer_of_the_replay(log: Path, tmp_path: Path) -> None:
    sent = [frame for _, frame in split(log.read_bytes())]
    config = RunConfig()
    with listening(tmp_path, config) as session:
        for i in range(0, len(sent), 64):
            send([b"".join(sent[i : i + 64])], session.port)
        wait_for_size(session.part("tlog"), tlog_size(sent))
    [ended] = session.ended
    again = yawid.replay(tmp_path / "live.tlog")

    assert ended.summary.ordinary
    assert ended.summary.ordinary == again.ordinary
    assert ended.exit_code == 5


def test_a_live_session_has_a_number_of_ordinary_flight_while_it_runs(log: Path) -> None:
    """Its worker fits once a window, and what is published has names of its own."""
    decoder, config = Decoder(WANTED), RunConfig()
    with ThreadPoolExecutor(1) as fits, ThreadPoolExecutor(1) as lateral:
        pipeline = Pipeline(config, worker=fits, lateral_worker=lateral)
        data = log.read_bytes()
        size = len(data) // 36
        seen = []
        for first in range(0, len(data), size):
            pipeline.feed(decoder.feed(data[first : first + size]))
            lateral.submit(int).result(60.0)  # the fit before this one has ended
            seen.append(said(RunningAnswer().look(pipeline, decoder.link)))
        pipeline.finish()
        ended = pipeline.ordinary()
    texts = list(dict.fromkeys(text for text in seen if "ordinary" in text))
    answer = RunningAnswer().look(pipeline, decoder.link)
    running = answer.ordinary.dutch_roll

    assert not any("ordinary" in text for text in seen[:25])  # 290 s of flight are needed
    assert re.fullmatch(
        r"running: not known yet; ordinary: wn [\d.]+ ± [\d.]+ rad/s, .*after [56] min", texts[0]
    )
    assert abs(running.wn_rad_s - ended.dutch_roll.wn_rad_s) < running.wn_std
    assert [values_of(answer, i) for i in range(4)] == [{"yaw_ok": 0.0}] * 4
    assert values_of(answer, 4) == {
        "ord_wn": running.wn_rad_s, "ord_wn_sd": running.wn_std,
        "ord_zeta": running.zeta, "ord_z_sd": running.zeta_std,
    }  # fmt: skip


def summary(wn: float, zeta: float, loop: str = "airframe") -> RunSummary:
    """A run at 50 m/s at sea level: ordinary flight has wn 2 and zeta .1, as flown 1.8 and .3."""
    known = Verdict(usable=True, reasons=[])
    found = OrdinaryAnswer(
        dutch_roll=DutchRoll(wn_rad_s=2.0, wn_std=0.03, zeta=0.1, zeta_std=0.012),
        flown=DutchRoll(wn_rad_s=1.8, wn_std=0.03, zeta=0.3, zeta_std=0.012),
        airspeed_m_s=50.0, altitude_m=0.0, verdict=known,
    )  # fmt: skip
    mode = DutchRoll(wn_rad_s=wn, wn_std=0.04, zeta=zeta, zeta_std=0.016)
    flight = Flight(
        airspeed_m_s=54.0, altitude_m=0.0, loop=loop, dutch_roll=mode, used=[1], disagree=[],
        verdict=known,
    )  # fmt: skip
    return RunSummary(
        log="a", duration_s=1.0, link={}, channels={}, verdict=known, flight=flight,
        ordinary=found,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("loop", "wn", "zeta"), [("airframe", 2.0, 0.1), ("with_roll_loop", 1.8, 0.3)]
)
def test_what_was_flown_with_a_roll_loop_is_compared_with_the_mode_under_it(
    loop: str, wn: float, zeta: float
) -> None:
    both = compared(summary(1.08 * wn, zeta + 0.02, loop))

    # By the airspeed wn is 1.08 times as large; sigma of zeta's difference is .012 and .016, .02.
    assert both.ordinary.agrees.against == "flight"
    assert both.ordinary.agrees.wn_sigmas == pytest.approx(0.0, abs=1e-9)
    assert both.ordinary.agrees.zeta_sigmas == pytest.approx(1.0)
    assert not both.ordinary.verdict.reasons
    assert not both.verdict.reasons


def test_answers_that_disagree_have_a_warning_each() -> None:
    both = compared(summary(2.16, 0.1 + 3.1 * 0.02))

    for verdict in (both.verdict, both.flight.verdict, both.ordinary.verdict):
        assert [reason.id for reason in verdict.reasons] == ["ordinary_disagrees"]
        assert "3.1 sigma apart" in verdict.reasons[0].text
        assert verdict.usable
