"""The five READMEs, and what is made of the tree in them and the manual: short and true."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import check
import pytest
from bench.frame import BENCHES
from checks import readme_tables
from checks.children import free_udp_port
from places import C172P, ROOT, SRC, TOOLS

from yawid.answers.reasons import KINDS
from yawid.cli import main as command_line
from yawid.cli.fleet import CHANGED
from yawid.errors import EXIT_CODES, YawidError
from yawid.runs.stop import SIGNALS

LIMITS = {
    "README.md": (200, 100),
    "src/README.md": (180, 160),
    "tests/README.md": (130, 175),
    "tools/README.md": (360, 160),
    "replay_logs/README.md": (85, 160),
}
"""Lines, and characters of one line."""
TEXTS = {name: (ROOT / name).read_text(encoding="utf-8") for name in LIMITS}
FOR_USERS = TEXTS["README.md"]
SET_UP = re.findall(r"^python3 -m venv .*$", FOR_USERS, re.MULTILINE)
TYPED = {name: readme_tables.to_type(name) for name in ("gain", "mix", "after")} | {
    "refusal": ["yawid replay replay_logs/turns_calm/log.tlog"]
}
"""Outputs of lines that the README has, in it and on the page "What now", and these lines."""
FITTED = (*TYPED, "bare")
"""Outputs whose last digits differ between processors."""
NUMBER = re.compile(r"\d+(?:\.\d+)?")
OF_OTHERS = {"--quiet", "--editable"}
"""Options of pip in the commands that set up."""


@pytest.mark.parametrize("name", LIMITS)
def test_a_readme_is_short_enough_to_be_read(name: str):
    most_lines, most_characters = LIMITS[name]
    lines = TEXTS[name].splitlines()

    assert len(lines) <= most_lines
    assert [line for line in lines if len(line) > most_characters and line not in SET_UP] == []


def test_two_commands_set_up_by_copy_and_paste_one_to_run_and_one_to_test():
    install = 'python3 -m venv .venv && .venv/bin/python -m pip install --quiet --editable ".[dev]"'
    tests = " ".join(check.commands()[0][1:])

    run, test = SET_UP
    assert run.startswith(f"{install} && .venv/bin/yawid replay replay_logs/c172p_3211/log.tlog ")
    assert test == f"{install} && .venv/bin/python {tests}"


@pytest.mark.parametrize("name", LIMITS)
def test_files_named_exist(name: str):
    folder = (ROOT / name).parent
    named = set(re.findall(r"(?<![\w*/.])[\w./]+\.(?:py|png|md)\b", TEXTS[name]))
    named |= {link for link in re.findall(r"\]\(([^)]+)\)", TEXTS[name]) if "://" not in link}
    named |= set(re.findall(r"\breplay_logs/\w+(?![\w.])", TEXTS[name]))
    places = (folder, ROOT, SRC, TOOLS, ROOT / "tests")

    assert [each for each in named if not any((place / each).exists() for place in places)] == []


def test_every_room_of_the_house_is_named_and_no_other():
    rooms = {
        path.parent.relative_to(SRC).as_posix() + "/"
        for path in SRC.rglob("*.py")
        if path.parent != SRC
    }

    assert set(re.findall(r"^\| `([\w/]+/)` \|", TEXTS["src/README.md"], re.MULTILINE)) == rooms


@pytest.mark.parametrize("name", [name for name in readme_tables.TABLES if name not in FITTED])
def test_a_table_that_the_tree_gives_is_as_it_gives_it(name: str):
    """If not: python -m checks.readme_tables."""
    assert readme_tables.written(name) == readme_tables.TABLES[name]()


@pytest.mark.long
def test_the_line_for_the_bare_airframe_prints_what_is_shown_below_it():
    """If not: python -m checks.readme_tables."""
    shown, printed = readme_tables.written("bare"), readme_tables.TABLES["bare"]()
    assert in_words(shown) == in_words(printed)
    assert "usable" in shown.lower()
    check_numbers(shown, printed)


def check_numbers(shown: str, printed: str) -> None:
    """Check that numbers differ by one of the last digit, or by 2 %, at most."""
    for said, found in zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True):
        last_digit = 10.0 ** -len(said.partition(".")[2])
        off = abs(float(said) - float(found))
        assert off <= max(1.01 * last_digit, 0.02 * abs(float(found))), (said, found)


def in_words(output: str) -> str:
    """Return an output without its numbers, and without its layout, which follows from them."""
    return " ".join(NUMBER.sub("#", output).split())


def test_each_bench_has_its_place():
    for name in BENCHES:
        assert len(readme_tables.written(name).splitlines()) > 2, name
        assert TEXTS["tools/README.md"].count(f"<!-- {name} -->") == 1


def test_every_command_and_option_named_exists():
    commands = command_line.every()
    options = {option for command in commands.values() for option in command.options}
    blocks = "".join(re.findall(r"```(?:sh\n.*?)?```|`[^`\n]+`", FOR_USERS, re.DOTALL))
    named = set(re.findall(r"(?<![\w-])--[a-z][\w-]*", FOR_USERS)) - OF_OTHERS

    assert set(re.findall(r"(?:^|`|/)yawid ([a-z]+)", blocks, re.MULTILINE)) <= set(commands)
    assert named - options == set()


def test_every_line_to_type_is_one_that_the_parser_takes():
    text = "\n".join(TEXTS.values())
    blocks = re.findall(r"```sh\n((?s:.*?))```|((?:^    .*\n)+)", text, re.MULTILINE)
    lines = re.findall(r"^ *(?:.*/bin/)?yawid (.*)$", "".join(map("".join, blocks)), re.MULTILINE)

    assert len(lines) >= 9
    for line in lines:
        words = shlex.split(re.sub(r"\[(.*)\]", r"\1", line), comments=True)
        assert command_line.parsed(words).run, line


CODES = {"turns_calm": {5}, "yawid live": {3}, "yawid trend": {5}}
"""The exit codes of lines that do not end with 0: nobody sends anything, and one flight shows no
change."""


@pytest.mark.slow
def test_the_lines_of_the_readme_typed_in_order_work_and_print_what_is_shown(
    tmp_path: Path, monkeypatch, capfd
):
    """If they print something else: python -m checks.readme_tables."""
    monkeypatch.chdir(tmp_path)
    Path("replay_logs").symlink_to(ROOT / "replay_logs")
    Path("logs").mkdir()
    shutil.copy(C172P, "flight.tlog")
    shutil.copy(C172P, "logs")
    lines = re.findall(r"^(?:.*/bin/)?(yawid .*)$|`(yawid replay [^`]+)`", FOR_USERS, re.MULTILINE)
    typed = [line for line in map("".join, lines) if line.split()[1] in command_line.COMMANDS]
    port, printed = free_udp_port(), dict[str, str]()

    assert len(typed) >= 10
    for line in typed:
        bounded = line.replace(":14560", f":{port} --seconds 0.5")
        code = command_line.main(shlex.split(bounded, comments=True)[1:])
        said = capfd.readouterr()
        expected = next((each for words, each in CODES.items() if words in line), {0})
        assert code in expected, (line, said.err)
        printed[line.partition("  #")[0].rstrip()] = said.out
    for name, (*before, last) in TYPED.items():
        shown = readme_tables.written(name).strip("`\n")
        assert set(before) < printed.keys()
        head, words, _ = in_words(printed[last]).partition(in_words(shown))
        assert words, (name, printed[last])
        first, count = head.count("#"), words.count("#")
        found = NUMBER.findall(printed[last])[first : first + count]
        check_numbers(shown, " ".join(found))
    for name in ("flight.mcap", "flight.rrd", "flight.html", "log.mcap"):
        assert (tmp_path / "yawid-out" / name).stat().st_size > 10_000
    assert not list(tmp_path.rglob("*-2.*"))


def test_the_accuracy_is_that_of_the_table():
    short, whole = (
        [line for line in readme_tables.written(name).splitlines() if re.match(r"\| [af]", line)]
        for name in ("truth_short", "truth")
    )
    assert len(short) == 4
    assert short == whole
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in short]
    off, *weather = (row[3] for row in rows[:3])
    calm, turbulence = (f"{float(each):.1f} %" for each in weather)
    flights = re.search(r"--flights (\d+)", readme_tables.written("truth"))[1]
    kind, wrong = re.search(
        r"unexcited \| (\d+) \| (\d+) \|", readme_tables.written("verdict")
    ).groups()
    text = FOR_USERS + (SRC / "manual" / "accuracy.md").read_text(encoding="utf-8")
    said = (
        f"{flights} flights of JSBSim",
        f"right to {calm} of wn in calm air, and to {turbulence} in turbulence",
        f"of {kind} flights in which nothing moved the rudder on purpose none",
        f"In {flights} simulated flights",
        f"the median error of wn was {off} %",
        f"two of the reported sigma in {rows[0][9].split()[0]} % of the answers",
    )
    assert wrong == "0"
    assert [words for words in said if words not in " ".join(text.split())] == []


def test_the_first_answer_is_as_right_as_the_text_below_it_says():
    truth = json.loads((C172P.parent / "truth.json").read_text(encoding="utf-8"))["dutch_roll"]
    true = truth["wn_rad_s"], truth["zeta"]
    (found,) = re.findall(
        r"wn ([\d.]+) ± ([\d.]+) rad/s, zeta ([\d.]+) ± ([\d.]+)", readme_tables.written("answer")
    )
    wn, wn_std, zeta, zeta_std = map(float, found)

    said = " ".join(FOR_USERS.split())
    assert f"a natural frequency wn of {wn:.2f} rad/s and a damping ratio zeta of {zeta}" in said
    assert f"the truth, is {true[0]:.3f} rad/s and {true[1]:.3f}, which is within one sigma" in said
    assert abs(wn - true[0]) < wn_std
    assert abs(zeta - true[1]) < zeta_std
    page = " ".join((SRC / "manual" / "accuracy.md").read_text(encoding="utf-8").split())
    assert f"linearisation says {true[0]:.3f} rad/s and {true[1]:.3f}" in page


def test_the_next_gain_and_the_mix_are_those_of_the_simulators_own_linearisation():
    """It is closed with ArduPlane's damper by tools/bench/damper.py; rolls take 1 to 4 s."""
    page = " ".join((SRC / "manual" / "what_now.md").read_text(encoding="utf-8").split())
    ((true_wn, true_zeta),) = re.findall(
        r"linearisation, closed with that gain, is (\S+) rad/s and (\S+),", page
    )
    (row,) = re.findall(r".* low, next$", readme_tables.written("gain"), re.MULTILINE)
    gain, _, wn, wn_std, zeta, zeta_std, *_ = map(float, NUMBER.findall(row))

    assert gain == 0.2
    assert abs(wn - float(true_wn)) < wn_std
    assert abs(zeta - float(true_zeta)) < zeta_std
    true = re.findall(r"linearisation, is (\S+) to (\S+) for rolls of", page)
    mix, std = re.findall(r"found (\S+) ± (\S+)", readme_tables.written("mix"))[0]
    for each in map(float, true[0]):
        assert abs(float(mix) - each) < 1.5 * float(std)


def test_the_exit_codes_are_those_of_the_code():
    raised = {kind.exit_code for kind in (YawidError, *YawidError.__subclasses__())} | {0}
    raised |= {kind.exit_code for kind in KINDS.values()} | {128 + each for each in SIGNALS}
    raised |= {CHANGED, command_line.UNFORESEEN}

    assert raised == EXIT_CODES.keys()
