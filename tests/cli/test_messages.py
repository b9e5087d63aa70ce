"""What the command line says to who asks wrongly or for too much: one line, and the right code."""

from __future__ import annotations

import json
import re
from argparse import SUPPRESS
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest
from places import REPLAY_LOGS

from yawid.answers.reports import OrdersReport
from yawid.cli.main import COMMANDS, command_of, every, main, overview, parsed
from yawid.config.settings import check_settings
from yawid.sinks.pages import to_text
from yawid.sinks.run_page import orders_page

QUIET = str(REPLAY_LOGS / "sitl_auto" / "log.tlog")
C172P = str(REPLAY_LOGS / "c172p_3211" / "log.tlog")


def test_every_option_can_stand_in_a_toml_file_and_the_command_line_wins(tmp_path: Path, capsys):
    settings = tmp_path / "run.toml"
    out = tmp_path / "there"
    settings.write_text(
        f"orders = '2,2,1,1'\nrate = 10\nmanoeuvres = 'off'\nout = '{out}'\njson = true\n"
        "rerun = 'off'\nforce = true\nseconds = 5.5\nmemory = 30\nalso = 'none'\n",
        encoding="utf-8",
    )
    arguments = ["replay", C172P, "--config", str(settings), "--rate", "5", "--memory", "inf"]

    assert main(arguments) == 0
    [found] = json.loads(capsys.readouterr().out)["estimates"].values()
    assert main(arguments) == 0  # force

    assert found["orders"] == {"na": 2, "nb": 2, "nc": 1, "nk": 1}
    assert (found["sample_time_s"], found["forgetting_factor"]) == (0.2, 1.0)
    assert (out / "log.mcap").exists()


def test_orders_recommends_nothing_for_a_log_that_cannot_answer(capsys):
    assert main(["orders", QUIET, "--json", "--to", "120"]) == 5

    told = json.loads(capsys.readouterr().out)
    assert "recommended" not in told
    assert told["candidates"]
    page = to_text(orders_page(msgspec.convert(told, OrdersReport)))
    assert "no orders are recommended" in page
    assert told["verdict"]["reasons"][0]["id"] in page


def test_every_command_stands_in_the_overview_and_has_two_examples(capsys):
    assert main(["--help"]) == 0
    assert (page := capsys.readouterr().out) == overview()
    assert max(map(len, page.splitlines())) <= 80
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


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("orders = [3.5, 2, 2, 1]", "whole numbers"),
        ("orders = 'auto'", "(yawid orders compares them), got 'auto'"),
        ("rate = 'fast'", "run.toml: rate must lie in 0.1 to 1000 Hz, got 'fast'"),
        ("rate = [", "not a readable TOML file"),
        pytest.param(f"rate = {'[' * 100_000}", "run.toml: not a readable TOML file", id="deep"),
        ("memry = 3", "unknown setting 'memry'; did you mean memory?"),
        ("start = 3", " from, inputs, lateral, manoeuvres, "),
        ("force = 'yes'", "run.toml: argument --force: ignored explicit argument 'yes'"),
        ("out = true", "run.toml: argument --out: expected one argument"),
    ],
)
@pytest.mark.parametrize("command", [["replay", C172P], ["live", "udpin:127.0.0.1:0"]])
def test_a_toml_file_s_mistake_is_named_with_what_was_needed(command, text, said, tmp_path, capsys):
    settings = tmp_path / "run.toml"
    settings.write_text(text, encoding="utf-8")

    with suppress(SystemExit):
        assert main([*command, "--config", str(settings)]) == 2
    assert said in capsys.readouterr().err
