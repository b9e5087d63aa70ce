"""What the command line says to who asks wrongly or for too much: one line, and the right code."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from finished_runs import replayed
from places import REPLAY_LOGS

from yawid.cli.main import main
from yawid.sinks.terminal.summary_table import print_orders

C172P = str(REPLAY_LOGS / "c172p_3211" / "log.tlog")
NO_RUDDER = str(REPLAY_LOGS / "no_rudder" / "log.tlog")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "COMMAND"),
        (["fly"], "'fly'"),
        (["replay"], "LOG"),
        (["replay", "x.tlog", "--rat", "3", "--also"], "--also"),
        (["replay", "x.tlog", "--rate", "fast"], "'fast'"),
        (["replay", "x.tlog", "--sysid", "first"], "1 to 255"),
        (["live", "udpin:127.0.0.1:14560", "--request-rates", "often"], "'often'"),
    ],
)
def test_a_command_line_with_a_mistake_gets_one_line(arguments, named, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)

    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert said.startswith("yawid: ")
    assert said.count("\n") == 1
    assert named in said
    assert "--help" in said
    assert "_sysid" not in said


def test_help_names_every_channel_that_can_be_the_rudder(capsys):
    with pytest.raises(SystemExit):
        main(["replay", "--help"])

    assert "vtail:L,R" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--orders", "3,3"], "na,nb,nc,nk, got 3,3"),
        (["--orders", "a,b,c,d"], "na,nb,nc,nk, four whole numbers"),
        (["--band", "3,1"], "got 3,1"),
        (["--band", "low,high"], "LO,HI in Hz"),
        (["--rudder-max-deg", "1e9"], "at most 90"),
        (["--memory", "1e-9"], "--memory"),
        (["--sysid", "all"], "a whole number"),
    ],
)
def test_a_value_that_cannot_be_is_named_as_it_was_written(arguments, said, tmp_path, capsys):
    code = main(["replay", C172P, "--out", str(tmp_path / "out"), *arguments])

    told = capsys.readouterr().err
    assert code == 2
    assert said in told
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [("orders = [3.5, 2, 2, 1]", "whole numbers"), ("orders = 'auto'", "--orders auto")],
)
def test_a_toml_file_s_orders_are_four_whole_numbers(text, said, tmp_path: Path, capsys):
    settings = tmp_path / "run.toml"
    settings.write_text(text)

    assert main(["replay", C172P, "--config", str(settings), "--out", str(tmp_path / "o")]) == 2
    assert said in capsys.readouterr().err


def test_an_unknown_setting_is_answered_with_the_options_as_they_are_written(tmp_path, capsys):
    settings = tmp_path / "run.toml"
    settings.write_text("start = 3")

    assert main(["replay", C172P, "--config", str(settings)]) == 2
    said = capsys.readouterr().err
    assert " from," in said
    assert " rudder-max-deg," in said
    assert "_" not in said.replace(str(settings), "")


def test_forgetting_on_the_command_line_overrules_the_memory_of_the_file(tmp_path: Path, capsys):
    settings = tmp_path / "run.toml"
    settings.write_text("memory = 30\nrate = 10\n")
    arguments = ["--config", str(settings), "--forgetting", "1", "--out", str(tmp_path), "--json"]

    assert main(["replay", C172P, *arguments]) == 0
    assert '"forgetting_factor": 1.0' in capsys.readouterr().out


def test_orders_says_that_a_log_has_no_rudder_with_the_code_for_it(capsys):
    assert main(["orders", NO_RUDDER]) == 3

    said = capsys.readouterr().err
    assert "no_rudder" in said
    assert said.count("\n") == 1


def test_a_replay_with_orders_auto_of_a_log_without_rudder_writes_its_verdict(tmp_path, capsys):
    code = main(["replay", NO_RUDDER, "--orders", "auto", "--json", "--out", str(tmp_path)])

    assert code == 3
    assert '"no_rudder"' in capsys.readouterr().out
    assert (tmp_path / "log.mcap").exists()


def test_orders_compares_all_structures_and_takes_none(capsys):
    assert main(["orders", C172P, "--orders", "2,2,2,1"]) == 2
    assert "leave it out" in capsys.readouterr().err


@pytest.mark.parametrize("seconds", ["1e12", "nan", "0.001", "inf"])
def test_a_simulation_too_long_or_too_short_is_refused_at_once(seconds, tmp_path: Path, capsys):
    out = str(tmp_path / "x.csv")

    assert main(["simulate", "yaw", "--out", out, "--seconds", seconds]) == 2
    assert "--seconds must lie in 0.02 to 100000 at 50 Hz" in capsys.readouterr().err


def test_a_viewer_s_address_without_its_scheme_is_a_usage_error(tmp_path: Path, capsys):
    run = replayed(Path(C172P), tmp_path, "--rate", 10)

    assert main(["view", str(run), "--to", "127.0.0.1:9876"]) == 2
    assert "rerun+http://HOST:PORT/proxy" in capsys.readouterr().err


@pytest.mark.parametrize("endpoint", ["127.0.0.1", "udpin:192.168.1.10"])
def test_the_end_of_an_address_is_not_taken_for_a_port(endpoint, tmp_path: Path, capsys):
    assert main(["live", endpoint, "--out", str(tmp_path)]) == 2
    assert "udpin:127.0.0.1:14560" in capsys.readouterr().err


@pytest.mark.parametrize(("simulated", "said"), [(-0.6, True), (39.0, True), (41.0, False)])
def test_orders_say_where_no_structure_tells_enough(simulated: float, said: bool) -> None:
    orders = {"na": 2, "nb": 2, "nc": 2, "nk": 1}
    report = {
        "log": "x.tlog",
        "recommended": orders,
        "candidates": [orders | {"simulation_pct": simulated}, orders],
    }
    page = io.StringIO()

    print_orders(report, page)

    assert ("no structure tells 40 % of the yaw rate" in page.getvalue()) == said
