"""``yawid explain``: every reason, exit code, command, option and quantity has its part."""

from __future__ import annotations

import re
from string import ascii_uppercase

import pytest

from yawid.answers.reasons import KINDS
from yawid.cli import main as command_line
from yawid.cli.explain import explained, parts_of
from yawid.config.run import settings_declared
from yawid.damper.refusals import OF_DAMPER
from yawid.errors import EXIT_CODES
from yawid.quantities.table import QUANTITIES

PARTS = parts_of(command_line.every())


def words_of(kind: str) -> set[str]:
    return {word for of, word in PARTS if of == kind}


def test_every_reason_says_what_it_means_and_what_to_do():
    assert words_of("reasons") == KINDS.keys()
    for kind in KINDS.values():
        weight, meaning, *_ = PARTS["reasons", kind.id].split("\n\n")
        text = " ".join(PARTS["reasons", kind.id].split())
        assert kind.weight in weight
        assert len(meaning) > 80, kind.id
        assert "src/yawid/" in text
        assert f"What to do: - {kind.now}" in text
        for line in (kind.record, *kind.record_on.values()):
            assert line in text, kind.id


def test_every_option_has_its_part_and_those_of_a_run_their_default():
    options = {o for each in command_line.every().values() for o in each.options} - {"--maneuvers"}
    assert words_of("options") == {option for option in options if option.startswith("--")}
    for field, _ in settings_declared():
        name = field.name.removesuffix("_s").replace("_", "-")
        text = PARTS["options", f"--{name}"]
        assert f"In a settings file: {name} = " in text
        _, comment, _ = text.split("\n\n")
        assert comment[0] in f'"{ascii_uppercase}', name
        assert comment.endswith("."), name


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ("not_excited", "10 % of half its travel"),
        ("--band", "vibration"),
        ("band", "vibration"),
        ("Dutch roll", "yaws and rolls"),
        ("dutch_roll", "yaws and rolls"),
        ("5", "not_excited"),
        ("loop_rate_unknown", "Exit code 2."),
        ("gain_changed", "A warning."),
        ("exit code 5", "not_excited"),
        ("replay", "yawid replay flight.tlog"),
        ("yawid replay", "yawid replay flight.tlog"),
        ("whiteness_p", "Ljung-Box"),
        ("kappa_rad_m", "unit: rad/m."),
        ("a_z_beta", "1 / T"),
        ("settings.md", "```toml"),
    ],
)
def test_a_word_is_found_however_it_is_written(asked: str, told: str, capsys):
    assert command_line.main(["explain", *asked.split()]) == 0
    assert told in capsys.readouterr().out


def test_every_reason_of_the_damper_exit_code_command_and_quantity_has_its_part():
    assert words_of("reasons of yawid damper") == set(OF_DAMPER)
    assert words_of("exit codes") == {f"exit code {code}" for code in EXIT_CODES}
    assert words_of("commands") == {f"yawid {name}" for name in command_line.COMMANDS}
    assert words_of("quantities") == QUANTITIES.keys()
    assert words_of("keys of --json") >= {"dutch_roll", "next", "weight"}
    for code in EXIT_CODES:
        text = " ".join(PARTS["exit codes", f"exit code {code}"].split())
        assert all(k.id in text for k in KINDS.values() if code and k.exit_code == code)
    for word in words_of("commands"):
        (block,) = re.findall(r"```sh\n(.*?)```", PARTS["commands", word], re.DOTALL)
        assert word in block


def test_without_a_word_all_words_are_listed_and_a_word_of_several_kinds_has_all_parts(capsys):
    assert command_line.main(["explain"]) == 0
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) <= 80
    assert all(word in " ".join(told.split()) for _, word in PARTS)
    for head in ("commands", "options", "keys of --json", "terms"):
        assert f"({head})\n" in explained(PARTS, "orders")
    assert command_line.main(["explain", "xyzzy"]) == 2
    assert "no word is similar" in capsys.readouterr().err
