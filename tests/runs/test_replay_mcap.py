"""``yawid replay RUN.mcap``: what a replay of the log gives, from the samples alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from finished_runs import replayed
from places import C172P
from sinks.mcap.mcap_reading import raw

from yawid.cli.main import main
from yawid.sinks.mcap.reader import open_run

OTHER = ("--orders", "4,4,2,1", "--memory", "100")


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("first"), "--rate", 10)


@pytest.mark.parametrize(
    "options",
    [(), OTHER, ("--from", "50", "--to", "140"), ("--method", "rml", "--also", "none")],
    ids=lambda options: " ".join(options) or "as it was",
)
def test_a_replay_of_a_run_equals_a_replay_of_its_log_to_the_bit(
    first: Path, tmp_path: Path, options: tuple[str, ...]
) -> None:
    direct = replayed(C172P, tmp_path / "direct", "--rate", 10, *options)
    again = replayed(first, tmp_path / "again", *options)

    assert [(*each[:2], each[4]) for each in raw(again)] == [
        (*each[:2], each[4]) for each in raw(direct)
    ]
    ours, theirs = (open_run(each).summary.to_json() for each in (again, direct))
    for key in ("estimates", "verdict", "channels", "link", "vehicle", "duration_s", "flight"):
        assert ours[key] == theirs[key], key
    assert ours["manoeuvres"] == theirs["manoeuvres"] != []


def test_through_any_number_of_replays_the_log_is_named_and_an_option_takes_the_place_of_the_runs(
    first: Path, tmp_path: Path
) -> None:
    second = replayed(first, tmp_path / "second", "--memory", "10", "--manoeuvres", "off")
    third = replayed(second, tmp_path / "third")
    fourth = replayed(third, tmp_path / "fourth", "--memory", "60")
    one, two, three, four = (open_run(each).summary for each in (first, second, third, fourth))

    assert (three.source.log, three.source.sha256) == (one.log, one.sha256)
    assert three.log == str(second)
    assert three.estimates == two.estimates != one.estimates
    assert four.estimates == one.estimates


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        ("--rate 5", 2, "replay the log itself"),
        ("--rudder servo:2", 2, "replay the log itself"),
        ("--inputs rudder,aileron", 2, "replay the log itself"),
        (
            "--from 1e6 --to 2e6 --json", 2,
            "--from 1e+06 --to 2e+06 is outside {run}, which covers ",
        ),
        ("--force --out {run.parent}", 6, "choose another --out"),
    ],
)  # fmt: skip
def test_what_the_samples_cannot_give_is_refused_and_the_run_stays(
    options: str, code: int, said: str, first: Path, tmp_path: Path, capsys
) -> None:
    before, out = first.read_bytes(), tmp_path / "out"
    words = options.format(run=first).split()
    assert main(["replay", str(first), "--out", str(out), *words]) == code
    [line] = capsys.readouterr().err.splitlines()
    assert said.format(run=first) in line
    assert first.read_bytes() == before
    assert not [*out.glob("*")]
