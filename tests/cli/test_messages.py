"""What the command line says to who asks wrongly or for too much: one line, and the right code."""

from __future__ import annotations

import io
import json
import re
from argparse import SUPPRESS
from pathlib import Path

import msgspec
import pytest
from finished_runs import replayed
from places import REPLAY_LOGS

from yawid.answers.reports import OrdersReport
from yawid.cli.main import COMMANDS, command_of, every, main, overview, parsed
from yawid.config.settings import check_settings
from yawid.errors import ConfigError
from yawid.sinks.run_page import print_orders

QUIET = str(REPLAY_LOGS / "sitl_auto" / "log.tlog")
C172P = str(REPLAY_LOGS / "c172p_3211" / "log.tlog")
REBOOT = str(REPLAY_LOGS / "c172p_reboot" / "log.tlog")
NO_RUDDER = str(REPLAY_LOGS / "no_rudder" / "log.tlog")


def code_of(*words: object) -> object:
    """Return the exit code of a command line, also where its parser ends it."""
    try:
        return main([str(each) for each in words])
    except SystemExit as ended:
        return ended.code


def test_help_names_every_channel_that_can_be_the_rudder(capsys):
    assert main(["replay", "--help"]) == 0

    assert "vtail:L,R" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--orders", "3,3"], "nk at least 1 (yawid orders compares them), got '3,3'"),
        (["--orders", "a,b,c,d"], "--orders must be na,nb,nc,nk, whole numbers"),
        (["--band", "3,1"], "got 3,1"),
        (["--band", "low,high"], "--band must be LO,HI in Hz"),
        (["--rudder-max-deg", "1e9"], "at most 90"),
        (["--memory", "1e-9"], "--memory"),
        (["--sysid", "all"], "--sysid all is for yawid live: give the number of one vehicle"),
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
    [
        ("orders = [3.5, 2, 2, 1]", "whole numbers"),
        ("force = 'yes'", "run.toml: argument --force: ignored explicit argument 'yes'"),
        ("out = true", "run.toml: argument --out: expected one argument"),
    ],
)
def test_a_toml_file_s_mistake_is_named_with_what_was_needed(text, said, tmp_path: Path, capsys):
    settings = tmp_path / "run.toml"
    settings.write_text(text, encoding="utf-8")

    assert code_of("replay", C172P, "--config", settings, "--rate", 10) == 2
    assert said in capsys.readouterr().err


def test_a_toml_file_holds_what_is_written_where(tmp_path: Path, capsys):
    settings = tmp_path / "run.toml"
    out = tmp_path / "there"
    settings.write_text(
        f"orders = '2,2,1,1'\nrate = 10\nmanoeuvres = 'off'\nout = '{out}'\njson = true\n"
        "rerun = 'off'\nforce = true\nseconds = 5.5\n",
        encoding="utf-8",
    )
    arguments = ["replay", C172P, "--config", str(settings)]

    assert main(arguments) == 0
    orders = json.loads(capsys.readouterr().out)["estimates"]["els"]["orders"]
    assert main(arguments) == 0  # force

    assert orders == {"na": 2, "nb": 2, "nc": 1, "nk": 1}
    assert (out / "log.mcap").exists()


@pytest.mark.parametrize("command", [["replay", C172P], ["live", "udpin:127.0.0.1:0"]])
def test_orders_that_are_none_are_refused_with_who_compares_them(command, tmp_path: Path, capsys):
    settings = tmp_path / "run.toml"
    settings.write_text("orders = 'auto'\n", encoding="utf-8")

    assert main([*command, "--config", str(settings)]) == 2
    assert "yawid orders" in capsys.readouterr().err


def test_an_unknown_setting_is_answered_with_the_options_as_they_are_written(tmp_path, capsys):
    settings = tmp_path / "run.toml"
    settings.write_text("start = 3", encoding="utf-8")

    assert main(["replay", C172P, "--config", str(settings)]) == 2
    said = capsys.readouterr().err
    assert " from," in said
    assert " rudder-max-deg," in said
    assert "_" not in said.replace(str(settings), "")


def test_the_memory_on_the_command_line_overrules_that_of_the_file(tmp_path: Path, capsys):
    settings = tmp_path / "run.toml"
    settings.write_text("memory = 30\nrate = 10\n", encoding="utf-8")
    arguments = ["--config", str(settings), "--memory", "inf", "--out", str(tmp_path), "--json"]

    assert main(["replay", C172P, *arguments]) == 0
    assert '"forgetting_factor": 1.0' in capsys.readouterr().out


def test_orders_says_that_a_log_has_no_rudder_with_the_code_for_it(capsys):
    assert main(["orders", NO_RUDDER]) == 3

    said = capsys.readouterr().err
    assert "no_rudder" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("option", ["--orders", "--method", "--memory", "--also"])
def test_orders_takes_no_option_that_it_would_not_use(option: str, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["orders", C172P, option, "2"])
    said = capsys.readouterr().err
    assert f"yawid orders has no option {option}: it belongs to replay, live, " in said
    assert "yawid orders --help" in said


@pytest.mark.parametrize("seconds", ["1e12", "nan", "0.001", "inf"])
def test_a_simulation_too_long_or_too_short_is_refused_at_once(seconds, tmp_path: Path, capsys):
    out = str(tmp_path / "x.csv")

    assert main(["simulate", "yaw", "--out", out, "--seconds", seconds]) == 2
    assert "--seconds must lie in 0.02 to 100000 at 50 Hz" in capsys.readouterr().err


def test_a_viewer_s_address_without_its_scheme_is_a_usage_error(tmp_path: Path, capsys):
    run = replayed(Path(C172P), tmp_path, "--rate", 10)

    assert code_of("view", run, "--to", "127.0.0.1:9876") == 2
    assert "rerun+http://HOST:PORT/proxy" in capsys.readouterr().err


@pytest.mark.parametrize("endpoint", ["127.0.0.1", "udpin:192.168.1.10"])
def test_the_end_of_an_address_is_not_taken_for_a_port(endpoint, tmp_path: Path, capsys):
    assert main(["live", endpoint, "--out", str(tmp_path)]) == 2
    assert "udpin:127.0.0.1:14560" in capsys.readouterr().err


def test_orders_recommends_nothing_for_a_log_that_cannot_answer(capsys):
    assert main(["orders", QUIET, "--json"]) == 5

    told = json.loads(capsys.readouterr().out)
    assert "recommended" not in told
    assert told["candidates"]
    page = io.StringIO()
    print_orders(msgspec.convert(told, OrdersReport), page)
    assert "no orders are recommended" in page.getvalue()
    assert told["verdict"]["reasons"][0]["id"] in page.getvalue()


def test_every_command_stands_in_the_overview_and_has_two_examples(capsys):
    assert main(["--help"]) == 0
    assert capsys.readouterr().out == overview()
    for name, command in every().items():
        assert f"\n    {name}" in overview()
        examples = command.format_help().split("examples:")[1]
        assert examples.count(f"yawid {name}") >= 2, name
        for action in command.arguments:
            assert action.help, f"{name}: {action.dest}"
            assert (action.help == SUPPRESS) == action.dest.startswith("help")


def shown(words: list[str], capsys) -> set[str]:
    """Return the options on a page of help."""
    assert main(words) == 0
    return set(re.findall(r"^ +(?:-o \S+, )?(--[\w-]+)", capsys.readouterr().out, re.MULTILINE))


def test_help_shows_the_ten_options_of_a_normal_flight_and_help_all_the_others(capsys):
    usual = shown(["replay", "--help"], capsys)
    assert usual == {
        *("--out", "--force", "--json", "--report", "--rerun", "--config"),
        *("--from", "--to", "--rate", "--rudder"),
    }
    assert {"--band", "--orders", *usual} <= shown(["replay", "--help-all"], capsys)
    for name in COMMANDS:
        options = {each for each in command_of(name).options if each[2:]} - {"--maneuvers"}
        assert shown([name, "--help-all"], capsys) == options - {"--help", "--help-all"}, name
        assert len(shown([name, "--help"], capsys)) <= 14, name


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["replay", C172P, "--boot", "7"], "the log, which holds 1 boot: 30.0 to 150.0 s"),
        (["inspect", REBOOT, "--boot", "7"], "the log, which holds 2 boots: boot 1 from "),
        (["view", "x.mcap", "--out", "x.txt"], "-o/--out: must end with .rrd, got 'x.txt'"),
        (
            ["damper", "x.mcap", "-o", "x.pdf"],
            "--out: must end with .html, got 'x.pdf'",
        ),
        (
            ["report", "x.mcap", "-o", "x.pdf"],
            "--out: must end with .html, got 'x.pdf'",
        ),
        (["replay", C172P, "--config", "no.toml"], "not a readable TOML file: No such file or"),
        (["live", C172P], "is a file, not a live link: use yawid replay for a log"),
    ],
)
def test_a_name_that_is_not_there_is_answered_with_those_that_are(arguments, said, capsys):
    assert code_of(*arguments) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def test_a_setting_of_toml_is_answered_with_the_nearest_one():
    with pytest.raises(ConfigError, match="unknown setting 'memry'; did you mean memory\\?"):
        check_settings({"memry": 3}, "x.toml")


def test_the_american_spelling_is_the_same_option():
    for spelt in ("--manoeuvres", "--maneuvers"):
        assert parsed(["inspect", "x", spelt, "off"]).manoeuvres == "off"
    assert check_settings({"maneuvers": "off"}, "x.toml")["manoeuvres"] == "off"


def test_the_endpoints_to_publish_to_are_a_list_and_the_command_line_overrules_the_file_s(tmp_path):
    settings = tmp_path / "live.toml"
    live = ["live", "udpin:127.0.0.1:14560", "--config", str(settings)]
    for text, found in (('"tap"', ["tap"]), ('["udpout:a:1", "tap"]', ["udpout:a:1", "tap"])):
        settings.write_text(f"publish = {text}", encoding="utf-8")
        assert parsed(live).publish == found
    given = ["--publish", "udpout:b:2", "--publish", "udpout:c:3"]
    assert parsed([*live, *given]).publish == ["udpout:b:2", "udpout:c:3"]
    settings.write_text("publish = [3]", encoding="utf-8")
    assert main([*live, "--out", str(tmp_path)]) == 2


def test_a_channel_without_a_value_is_said_to_be_the_wrong_one(tmp_path, capsys):
    """Servo 15 is in the log, and 0 throughout."""
    assert main(["replay", C172P, "--rudder", "servo:15", "--json", "--out", str(tmp_path)]) == 5

    [first, *_] = json.loads(capsys.readouterr().out)["verdict"]["reasons"]
    assert first["text"].startswith("every sample is held: rudder invalid; the rudder's channel ")
    assert "by --rudder servo:N" in first["text"]
