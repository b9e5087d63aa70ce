"""A fleet overwrites its own files and no others."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from data_sets import MAY, entry, merge
from places import REPLAY_LOGS

from yawid.cli.main import main
from yawid.dataset.files import read_table


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Logs with what else lies next to them."""
    (tmp_path / "logs" / "flights").mkdir(parents=True)
    shutil.copy(REPLAY_LOGS / "no_rudder" / "log.tlog", tmp_path / "logs" / "a.tlog")
    for name in ("my_flight.parquet", "live.tlog.part", "flights/part-000001-0.parquet"):
        (tmp_path / "logs" / name).write_text("mine", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
@pytest.mark.parametrize(
    ("logs", "out"),
    [
        ("logs", "."),
        ("logs", "logs"),
        ("logs/a.tlog", "."),
        ("*/*.tlog", "logs"),
        ("file://{place}/logs", "."),
        ("link", "."),
        ("logs", "logs/data"),
        (".", "data"),
        ("**/*.tlog", "data"),
    ],
)
def test_a_data_set_that_holds_the_logs_or_is_held_by_them_is_refused_and_nothing_is_touched(
    place: Path,
    logs: str,
    out: str,
    dry: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(place)
    (place / "link").symlink_to(place / "logs")
    before = contents(place)

    assert main(["fleet", logs.format(place=place), "--out", out, *dry]) == 2
    said = capsys.readouterr().err
    assert f"--out {out} " in said
    assert said.count("\n") == 1
    assert contents(place) == before


@pytest.mark.parametrize(
    "names",
    [
        ["logs.parquet", "flights/mine.parquet"],
        ["schema.json"],
        ["SCHEMA.md", "logs/readme"],
        ["fleet.sqlite"],
        ["fleet.sqlite-journal", "mine"],
    ],
)
@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
def test_a_folder_without_our_database_is_no_data_set_whatever_its_files_are_called(
    place: Path, names: list[str], dry: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = place / "theirs"
    for name in names:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text('{"format": 1, "files": ["a.js"]}\n', encoding="utf-8")
    before = contents(out)

    assert main(["fleet", str(place / "logs"), "--out", str(out), *dry]) == 6
    assert capsys.readouterr().err.count("\n") == 1
    assert contents(out) == before


def test_what_lies_in_a_data_set_and_is_not_its_own_stays(tmp_path: Path) -> None:
    merge(tmp_path, [entry("/a", "A", MAY)])
    names = ("mine.parquet", "flights.parquet.bak", "flights/part-000001-0.parquet", "run.part")
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("mine", encoding="utf-8")
    left = tmp_path / "flights.parquet.part"
    left.write_text("left by a run that was killed", encoding="utf-8")

    merge(tmp_path, [entry("/b", "B", MAY)])

    assert {(tmp_path / name).read_text(encoding="utf-8") for name in names} == {"mine"}
    assert not left.exists()
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A", "B"]
