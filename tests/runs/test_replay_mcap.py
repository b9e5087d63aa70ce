"""``yawid replay RUN.mcap``: what a replay of the log gives, from the samples alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from finished_runs import replayed
from mcap.reader import make_reader
from places import C172P
from printed import printed

from yawid.cli.main import main

OTHER = ("--orders", "4,4,2,1", "--memory", "100")
STREAM = ("--manoeuvres", "off")


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("first"), "--rate", 10)


def summary_of(mcap: Path) -> dict[str, Any]:
    with mcap.open("rb") as stream:
        for attachment in make_reader(stream).iter_attachments():
            if attachment.name == "summary.json":
                summary: dict[str, Any] = printed("replay", attachment.data.decode())
                return summary
    raise AssertionError(f"no summary in {mcap}")


def messages(mcap: Path) -> list[tuple[str, int, bytes]]:
    with mcap.open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]


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

    assert messages(again) == messages(direct)
    ours, theirs = summary_of(again), summary_of(direct)
    for key in ("estimates", "verdict", "channels", "link", "vehicle", "duration_s", "manoeuvres"):
        assert ours[key] == theirs[key], key
    assert ours["manoeuvres"]
    assert ours["flight"] == theirs["flight"]


def test_the_log_behind_the_samples_is_named_through_any_number_of_replays(
    first: Path, tmp_path: Path
) -> None:
    second = replayed(first, tmp_path / "second", *OTHER, *STREAM)
    third = replayed(second, tmp_path / "third")

    origin = {name: summary_of(first)[name] for name in ("log", "sha256")}
    assert summary_of(third)["source"] == origin
    assert summary_of(third)["log"] == str(second)
    assert summary_of(third)["estimates"] == summary_of(second)["estimates"]


def test_memory_takes_the_place_of_that_of_the_run(first: Path, tmp_path: Path) -> None:
    second = replayed(first, tmp_path / "second", "--memory", "10", *STREAM)
    third = replayed(second, tmp_path / "third", "--memory", "60")

    assert summary_of(third)["estimates"] == summary_of(first)["estimates"]


@pytest.mark.parametrize(
    "option", [("--rate", "5"), ("--rudder", "servo:2"), ("--inputs", "rudder,aileron")]
)
def test_other_samples_than_the_file_holds_are_refused(
    first: Path, tmp_path: Path, option: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(first), "--out", str(tmp_path), *option]) == 2
    assert "replay the log itself" in capsys.readouterr().err


def test_a_run_is_not_overwritten_by_its_own_replay(
    first: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = first.read_bytes()
    assert main(["replay", str(first), "--out", str(first.parent), "--force"]) == 6
    assert "choose another --out" in capsys.readouterr().err
    assert first.read_bytes() == before


def test_a_stretch_without_samples_is_a_usage_error_that_says_what_there_is(
    first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["replay", str(first), "--out", str(tmp_path), "--from", "1e6", "--to", "2e6"]
    assert main([*arguments, "--json"]) == 2
    said = capsys.readouterr().err
    assert f"--from 1e+06 --to 2e+06 is outside {first}, which covers " in said
    assert not [*tmp_path.iterdir()]


def test_a_run_cut_off_before_its_first_sample_is_one_line(
    first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(first.read_bytes()[:2000])
    assert main(["replay", str(torn), "--out", str(tmp_path)]) == 6
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "replay its log again" in error
