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
import msgspec
import pytest
from inspecting import assert_is_read_in_ten_seconds, inspected
from ordinary_plant import AIRSPEED_M_S, as_tlog, flown, truth
from printed import printed
from sinks.mcap.mcap_reading import decoded

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
from yawid.sinks.pages import to_text
from yawid.sinks.run_page import whole_page
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


OPTIONS = {
    "next_to": ["--lateral", "off"], "alone": ["--ordinary", "only"],
    "without": ["--ordinary", "off", "--lateral", "off"],
    "short": ["--ordinary", "only", "--to", "200"],
}  # fmt: skip
"""The runs that the tests look at: next to the other answers, alone, not at all, and too short."""


@pytest.fixture(scope="session")
def runs(log: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Replayed]:
    return {name: replayed(log, tmp_path_factory.mktemp(name), *OPTIONS[name]) for name in OPTIONS}


def page(told: dict[str, Any]) -> str:
    """Return what a terminal shows, on one line."""
    summary = RunSummary.from_json(json.dumps(told).encode())
    return " ".join(to_text(whole_page(summary)).split())


def test_the_mode_stands_next_to_the_refusal_of_the_rudders_question(
    runs: dict[str, Replayed],
) -> None:
    code, told, _ = runs["next_to"]
    found, (wn, zeta), said = told["ordinary"], truth(), page(told)

    assert (code, told["verdict"]["reasons"][0]["id"]) == (5, "not_excited")
    assert found["verdict"]["usable"]
    assert abs(found["dutch_roll"]["wn_rad_s"] - wn) < 2.0 * found["dutch_roll"]["wn_std"]
    assert abs(found["dutch_roll"]["zeta"] - zeta) < 2.0 * found["dutch_roll"]["zeta_std"]
    assert found["airspeed_m_s"] == pytest.approx(AIRSPEED_M_S)
    assert "flight" not in told
    assert "verdict NOT USABLE not_excited: the rudder's largest movement" in said
    row = re.search(r"ordinary wn (\S+) ± \S+ rad/s, zeta (\S+) ± ", said)
    assert float(row[1]) == pytest.approx(found["dutch_roll"]["wn_rad_s"], rel=0.01)
    mode_only = "from ordinary flight: the aircraft without its autopilot, mode only; at 50.0 m/s"
    assert mode_only in said
    assert re.search(r"from 6 of 6 min, \d+ turns", said)


def test_alone_it_is_the_verdict_and_a_short_log_is_refused_with_what_is_needed(
    runs: dict[str, Replayed],
) -> None:
    (code, told, _), (refused_code, refused, _) = runs["alone"], runs["short"]
    [reason], said = refused["verdict"]["reasons"], page(refused)

    assert code == 0
    assert told["verdict"] == {"method": "ordinary", "usable": True, "reasons": []}
    assert told["ordinary"] == runs["next_to"].told["ordinary"]
    assert not {"flight", "manoeuvres", "estimates"} & told.keys()
    assert (refused_code, reason["id"]) == (5, "ordinary_unknown")
    assert "290 s of ordinary flight at one airspeed are needed" in reason["text"]
    assert refused["verdict"]["next"] == refused["ordinary"]["verdict"]["next"]
    assert "dutch_roll" not in refused["ordinary"]
    assert "ordinary from ordinary flight the aircraft's mode is not known: 290 s of" in said
    assert "next: Fly twelve minutes at one airspeed, with turns" in said


def test_switched_off_nothing_of_it_is_there_and_its_answer_is_in_the_file_as_json(
    runs: dict[str, Replayed],
) -> None:
    (_, told, mcap), (_, without, plain) = runs["next_to"], runs["without"]

    assert told.keys() - without.keys() == {"ordinary"}
    added = {"ordinary", "files"}
    assert {k: v for k, v in told.items() if k not in added} == {
        k: v for k, v in without.items() if k not in added
    }
    topics, more = decoded(plain), decoded(mcap)
    assert more.keys() - topics.keys() == {
        "/yawid/attitude", "/yawid/commands", "/yawid/ordinary",
    }  # fmt: skip
    [(message, found)] = more["/yawid/ordinary"]
    jsonschema.Draft202012Validator(found.SHAPE).validate(json.loads(message.data))
    assert json.loads(message.data) == told["ordinary"]


def test_a_replay_of_the_file_gives_the_same_to_the_bit_or_says_that_the_log_is_needed(
    runs: dict[str, Replayed], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("alone", "short"):
        again, before = replayed(runs[name].mcap, tmp_path / name), runs[name]
        assert again.told["ordinary"] == before.told["ordinary"]
        assert again.told["verdict"] == before.told["verdict"]
        assert again.code == before.code
    blind = replayed(runs["without"].mcap, tmp_path, "--ordinary", "only")
    assert (blind.code, blind.told["verdict"]["reasons"][0]["id"]) == (5, "ordinary_unknown")
    assert "holds no lateral motion: for that, replay the log itself" in capsys.readouterr().err


def test_python_has_it_as_a_value_that_is_true_where_it_is_known(
    runs: dict[str, Replayed],
) -> None:
    unasked, run = (yawid.load(runs[name].mcap) for name in ("without", "alone"))

    assert not unasked.ordinary
    assert unasked.ordinary.verdict.next == 'Replay the log with ordinary="auto".'
    assert run.usable
    assert run.ordinary
    assert not run.flight
    assert "from ordinary flight" in repr(run)
    with pytest.raises(NotIdentifiable):
        run.model("flight")


def test_data_set_and_report_have_the_mode_with_what_it_rests_on_or_why_it_is_not_known(
    runs: dict[str, Replayed],
) -> None:
    summaries = [
        RunSummary.from_json(json.dumps(runs[name].told).encode()) for name in ("alone", "short")
    ]
    known, refused = (flight_rows(each, 1, 360.0)[0] for each in summaries)
    shown = write_report(runs["alone"].mcap).read_text(encoding="utf-8")
    wn = runs["alone"].told["ordinary"]["dutch_roll"]["wn_rad_s"]

    assert known["ordinary_kappa_rad_m"] == pytest.approx(wn / 50.0)
    assert known["usable"]
    assert not {"wn_rad_s", "answer", "method"} & known.keys()
    assert {*known, *refused} <= {name for name, *_ in TABLES["flights"].columns}
    assert (refused["ordinary_why"], refused["usable"]) == ("too_short", False)
    assert "ordinary_wn_rad_s" not in refused
    assert "The Dutch roll is ωn" in shown
    assert "Ordinary flight</h2>" in shown
    assert '<figure id="ordinary">' in shown
    assert "290 s of ordinary flight" in "".join(ordinary_section(summaries[1]))
    assert spectra_picture(summaries[1].ordinary) is None


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


def test_inspect_says_whether_the_log_can_give_it_and_what_is_missing(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, known = inspected(log, tmp_path, capsys)
    short_code, short = inspected(log, tmp_path, capsys, "--to", "200")

    assert (code, short_code) == (5, 5)
    assert_is_read_in_ten_seconds(known)
    assert known["can"]["ordinary"] == {"yes": True, "lacks": []}
    assert not short["can"]["ordinary"]["yes"]
    needed = "290 s of ordinary flight at one airspeed are needed"
    assert needed in short["can"]["ordinary"]["lacks"][0]


def test_a_live_session_has_a_number_of_ordinary_flight_while_it_runs_and_ends_with_the_replays(
    log: Path, runs: dict[str, Replayed]
) -> None:
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
    assert msgspec.to_builtins(ended.dutch_roll) == runs["next_to"].told["ordinary"]["dutch_roll"]
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
