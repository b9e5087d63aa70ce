"""The manual: its commands run, its examples and settings hold, its limits are the code's."""

from __future__ import annotations

import doctest
import re
import shlex
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest
from places import C172P, ROOT, SRC

import yawid
from yawid.blocks import AIRSPEED_SHARE
from yawid.channels import command, surface_reader
from yawid.cli import main as command_line
from yawid.config.run import LEAST_STROKE_DEG, RunConfig, settings_declared
from yawid.config.settings import check_settings
from yawid.manoeuvre import answer, conditions, find, fit, flight, judge, signals
from yawid.results import excitation, judge_samples

MANUAL = SRC / "manual"
PAGES = {path.name: path.read_text(encoding="utf-8") for path in sorted(MANUAL.glob("*.md"))}
FIRST = "yawid replay flight.tlog --config settings.toml --force"
QUICK = (FIRST, "yawid simulate yaw --input 3211", "yawid replay own.csv", "yawid explain")
"""Beginnings of lines that always run here, the first of them before the others."""
ELSEWHERE = (
    "yawid live", "yawid view", "yawid serve", "s3://", "tcp://", "yawid damper", " --of ",
    "today/",
)  # fmt: skip
"""What needs a link, a viewer, a browser, a store, a cluster or another flight: only parsed."""


def command_lines() -> list[str]:
    """Return every line of a shell block, with comments and all."""
    blocks = [b for page in PAGES.values() for b in re.findall(r"```sh\n(.*?)```", page, re.DOTALL)]
    return [line for block in blocks for line in block.splitlines()]


def commands_of(line: str) -> list[list[str]]:
    """Return the arguments of each command of yawid in a line."""
    return [shlex.split(each, comments=True) for each in line.partition("  #")[0].split(" | ")]


def test_every_command_line_is_one_of_yawids():
    commands = [each for line in command_lines() for each in commands_of(line)]

    assert len(commands) > 40
    for program, *arguments in commands:
        assert program == "yawid", arguments
        if "--config" not in arguments:  # the file is looked at below
            assert command_line.parsed(arguments).run
    assert {name for _, name, *_ in commands} >= {
        "replay",
        "live",
        "inspect",
        "fleet",
        "trend",
        "diff",
        "report",
    }


@pytest.fixture
def reader(tmp_path: Path, monkeypatch) -> None:
    """A folder as a reader of the manual has it before the first line."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "replay_logs" / "c172p_gcs_rates" / "log.tlog", "flight.tlog")
    (toml,) = re.findall(r"```toml\n(.*?)```", PAGES["settings.md"], re.DOTALL)
    Path("settings.toml").write_text(toml, encoding="utf-8")


@pytest.mark.usefixtures("reader")
def test_quick_command_lines_run_as_they_stand(capsys):
    every = command_lines()
    for line in [line for begin in QUICK for line in every if line.startswith(begin)]:
        if "own.csv" in line:
            own_record(Path("record.csv"), Path("own.csv"))
        ((_, *arguments),) = commands_of(line)
        assert command_line.main(arguments) == 0, (line, capsys.readouterr().err)

    (block,) = re.findall(r"<!-- record -->\n```\n(.*?)```", PAGES["own_records.md"], re.DOTALL)
    assert block.splitlines() == Path("record.csv").read_text(encoding="utf-8").splitlines()[:2]


@pytest.mark.long
@pytest.mark.usefixtures("reader")
def test_every_command_line_runs_that_can_run_here(capfd):
    """Each with --force where it has that, as many write the same files."""
    Path("replay_logs").symlink_to(ROOT / "replay_logs")
    shutil.copy(C172P, "flight.tlog")
    Path("logs").mkdir()
    shutil.copy("flight.tlog", "logs")
    shutil.copy("flight.tlog", "after.tlog")
    lines = [line for line in command_lines() if not any(each in line for each in ELSEWHERE)]
    assert command_line.main(FIRST.split()[1:]) == 0
    for name in ("before.mcap", "after.mcap", "live.mcap.part"):
        shutil.copy("yawid-out/flight.mcap", f"yawid-out/{name}")
    for line in lines:
        if "own.csv" in line:
            own_record(Path("record.csv"), Path("own.csv"))
        elif " data-2026" in line:
            shutil.copytree("data", "data-2026")
        piped = commands_of(line)
        for i, (_, *arguments) in enumerate(piped):
            if len(piped) > 1:  # through a file in place of the pipe
                arguments = ["piped.csv" if word == "-" else word for word in arguments]
            options = command_line.command_of(arguments[0]).options
            force = ["--force"] * ("--force" in options)
            code = command_line.main([*arguments, *force])
            # One flight is too little for a trend, and to compare two data sets by.
            few = line.startswith("yawid trend") or " data-2026" in line
            assert code == 5 * few, (line, i, capfd.readouterr().err)


def own_record(record: Path, own: Path) -> None:
    """Write a record under other names for its columns."""
    names, rest = record.read_text(encoding="utf-8").split("\n", 1)
    own.write_text(f"{names.replace(',rudder,r,', ',delta_r,Rate,')}\n{rest}", encoding="utf-8")


@pytest.mark.parametrize("name", [name for name in PAGES if re.search("```py", PAGES[name])])
def test_python_on_a_page_runs_and_does_what_it_shows(name: str, tmp_path: Path, monkeypatch):
    """Each page from the top in a namespace of its own, with two runs in yawid-out."""
    monkeypatch.chdir(tmp_path)
    Path("replay_logs").symlink_to(ROOT / "replay_logs")
    run = yawid.replay(C172P)
    Path("yawid-out").mkdir()
    shutil.copy(run.mcap(Path("yawid-out")), "yawid-out/second.mcap")
    known: dict[str, Any] = {}
    blocks = re.findall(r"```(pycon|python)\n(.*?)```", PAGES[name], re.DOTALL)
    assert len(blocks) >= 4
    for kind, code in blocks:
        if kind == "python":
            exec(code, known)
            continue
        example = doctest.DocTestParser().get_doctest(code, known, name, name, 0)
        found = doctest.DocTestRunner().run(example, clear_globs=False)
        assert (found.attempted > 0, found.failed) == (True, 0)
        known = example.globs
    assert known["changed"] == []
    (dutch_roll,) = {each[1] for each in known["points"]}
    assert dutch_roll == run.flight.dutch_roll.zeta


def test_the_settings_file_has_every_option_with_its_default():
    (text,) = re.findall(r"```toml\n(.*?)```", PAGES["settings.md"], re.DOTALL)
    of_run = {field.name.removesuffix("_s"): field.default for field, _ in settings_declared()}
    of_commands = {}
    for line in ("replay x", "live x", "inspect x", "fleet x --out yawid-out"):
        for name, value in vars(command_line.parsed(line.split())).items():
            of_commands[name.removeprefix("as_").removesuffix("_s")] = value
    actions = {name for name in of_commands if name not in of_run} - {
        *("every", "run", "settings", "config", "logs", "log", "paths", "endpoint"),
    }
    live = tomllib.loads(text)
    example = tomllib.loads(re.sub(r"^# ([a-z-]+ = )", r"\1", text, flags=re.MULTILINE))

    told = {name.replace("-", "_") for name in example}
    assert told == {*of_run, *actions}
    mine = {name: value for name, value in live.items() if name.replace("-", "_") in of_run}
    assert RunConfig(**check_settings(mine, "the manual") | {"given": ()}) == RunConfig()
    open_ones = {name for name, value in of_run.items() if value in (None, ())}
    assert {name.replace("-", "_") for name in example.keys() - live.keys()} >= open_ones
    check_settings({n: example[n] for n in example if n.replace("-", "_") in of_run}, "the manual")
    for name in actions:
        default = of_commands[name]
        value = live.get(name.replace("_", "-"))
        shown = str(default) if isinstance(default, Path) else default
        assert value == (None if shown == [] else shown), name


KNOWN = (
    100 * judge.UNCERTAIN_WN, judge.UNCERTAIN_ZETA, judge.LEAST_UNCERTAIN_ZETA,
    100 * judge.ZETA_SHARE, judge.PERIODS,
)  # fmt: skip
"""How well the mode of a manoeuvre must be known."""
LIMITS = {
    "rate_too_low": (judge_samples.LEAST_RATE_HZ, judge.LEAST_RATIO),
    "rate_low": (judge_samples.LOW_RATE_HZ, judge.LOW_RATIO),
    "rate_changed": (judge_samples.RATE_CHANGED,),
    "not_in_command": (
        100 * command.MOVED, command.LEAST_ROWS, 100 * judge_samples.LEAST_RESPONSE,
    ),
    "not_excited": (100 * excitation.LEAST_STROKE, LEAST_STROKE_DEG),
    "mixed_rudder": (100 * excitation.LEAST_STROKE, excitation.REACH_S),
    "collinear_inputs": (judge_samples.COLLINEAR, judge_samples.LAGS_COMPARED),
    "mode_not_driven": (
        judge.LEAST_DRIVEN, *judge.NEAR_PERIODS, judge.FAR_PERIODS, judge.FAR,
        judge.CLEAR_PAIR,
    ),
    "not_converged": (
        *KNOWN, find.OTHER_SPEED,
    ),
    "poor_fit": (judge.LEAST_PCT,),
    "manoeuvres_disagree": (100 * flight.DISAGREE_WN, flight.SIGMAS),
    "rudder_assumed": (100 * surface_reader.TOLERANCE, 100 * surface_reader.LEAST_SHARE),
    "poorly_known": (100 * judge.ROUGH_WN, 100 * judge.UNCERTAIN_WN),
    "saturated": (100 * judge.SATURATED,),
    "airspeed_changed": (100 * AIRSPEED_SHARE,),
    "airspeed_implausible": (
        conditions.SIGMAS, 100 * conditions.SENSOR_SIGMA, 100 * conditions.SCATTER,
        conditions.SLIP, 100 * conditions.SLIP_SIGMA, conditions.WIND_SHARE, conditions.WIND_M_S,
    ),
    "wrong_sign": (judge.SIGMAS,),
    "closed_loop": (judge.SOME_FED_BACK,),
}  # fmt: skip
"""The numbers that each reason is judged by."""


OF_A_MANOEUVRE = {
    "Where a manoeuvre is": (
        100 * find.MOVES, 100 * excitation.LEAST_STROKE, excitation.REACH_S, find.REST,
        find.PERIODS, find.LONGEST_PERIOD_S, find.DECAY, find.LONGEST_S, find.LONGEST_GAP_S,
        find.LONGEST_STATED_S, 100 * AIRSPEED_SHARE,
    ),
    "Inputs and outputs": (signals.WORTH_BIC,),
    "The fit": (fit.PER_PERIOD,),
    "wn, zeta and their sigma": (
        answer.INFLATED, answer.INFLATED_ROLL, answer.FEW_PERIODS, 100 * answer.FLOOR_WN,
        answer.FLOOR_ZETA, 100 * answer.HIDDEN_ZETA, 100 * answer.FLOOR_GAIN,
    ),
    "K, T, and what a doublet shows": (answer.LOWEST, answer.HIGHEST),
    "What is judged": (
        judge.LEAST_DRIVEN, *judge.NEAR_PERIODS, judge.FAR, judge.FAR_PERIODS, *KNOWN,
        judge.LEAST_PCT,
    ),
    "The flight": (
        100 * flight.TAU_WN_SHARE, flight.TAU_ZETA, flight.SIGMAS, 100 * flight.DISAGREE_WN,
    ),
}  # fmt: skip
"""The numbers below each heading of the page on manoeuvres."""


@pytest.mark.parametrize(
    ("page", "heading"),
    [*(("reasons.md", f"### `{each}`") for each in LIMITS),
     *(("manoeuvre.md", f"## {each}") for each in OF_A_MANOEUVRE)],
)  # fmt: skip
def test_the_limits_on_a_page_are_those_of_the_code(page: str, heading: str):
    (part,) = re.findall(rf"{heading}\n(.*?)(?:\n##|\Z)", PAGES[page], re.DOTALL)
    limits = (LIMITS | OF_A_MANOEUVRE)[heading.strip("# `")]

    numbers = {float(number) for number in re.findall(r"\d+(?:\.\d+)?", part)}
    assert {round(limit, 6) for limit in limits} <= numbers


def test_what_the_manual_names_exists():
    for name, page in PAGES.items():
        for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page):
            assert (MANUAL / link).exists(), (name, link)
        for path in re.findall(r"`((?:src|tools|replay_logs)/[\w./]+)`", page):
            assert (ROOT / path).exists(), (name, path)
        for function, path in re.findall(r"`(\w+)`\s+in\s+`(src/[\w./]+\.py)`", page):
            code = (ROOT / path).read_text(encoding="utf-8")
            assert f"def {function}(" in code, (name, function, path)


def test_a_line_of_the_manual_fits_a_terminal():
    for name, page in PAGES.items():
        text = re.sub(r"(?s:```.*?```)|(?m:^(?:\||    ).*$)", "", page)
        assert max(map(len, text.splitlines())) <= 80, name
    index = PAGES["README.md"]
    assert set(re.findall(r"\]\((\w+\.md)\)", index)) == PAGES.keys() - {"README.md"}
