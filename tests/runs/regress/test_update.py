"""``yawid regress --update --why``: any reason can be read again, and nothing is half written."""

from __future__ import annotations

import errno
import os
import shutil
import tomllib
from pathlib import Path
from typing import Any, BinaryIO

import pytest
from flightlog import fly
from places import REPLAY_LOGS as CASES

from yawid.cli.main import main
from yawid.runs.regress.case import Case

NAMES = ("case.toml", "expected.csv", "expected.json", "flight.json")


@pytest.fixture
def case(tmp_path: Path) -> Path:
    shutil.copytree(CASES / "no_rudder", tmp_path / "cases" / "no_rudder")
    return tmp_path / "cases" / "no_rudder"


def contents(case: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in case.iterdir()}


@pytest.mark.parametrize(
    "why",
    [
        "rudder \U0001f6e9\ufe0f",
        'he said "no"',
        "two\nlines\r\n",
        "\x01\x1b[2J\x7f\t",
        "'''\\",
        "ß",
    ],
)
def test_any_reason_can_be_read_again(case: Path, why: str) -> None:
    assert main(["regress", str(case), "--update", "--why", why]) == 0

    updates = tomllib.loads((case / "case.toml").read_text(encoding="utf-8"))["updates"]
    assert updates[-1]["why"] == why
    assert main(["regress", str(case)]) == 0


@pytest.mark.parametrize("why", ["caf\udce9", " \n"])
def test_a_reason_that_is_none_changes_nothing(
    case: Path, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(case)

    assert main(["regress", str(case), "--update", "--why", why]) == 2
    assert "--why" in capsys.readouterr().err
    assert contents(case) == before


def test_a_case_that_cannot_record_an_update_keeps_its_references(
    case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (case / "case.toml").read_text(encoding="utf-8")
    head, _, options = text.partition("[options]")
    options = options.partition("[[updates]]")[0]
    (case / "case.toml").write_text(f"{head}updates = []\n[options]{options}", encoding="utf-8")
    before = contents(case)

    assert main(["regress", str(case), "--update", "--why", "x"]) == 2
    assert "cannot take another" in capsys.readouterr().err
    assert contents(case) == before


@pytest.mark.parametrize("name", NAMES)
def test_a_disk_that_is_full_at_any_of_the_files_changes_none(
    case: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(case)

    def full(stream: BinaryIO) -> None:
        part = case / f"{name}.part"
        if part.exists() and os.path.samestat(os.fstat(stream.fileno()), part.stat()):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("yawid.system.part_file.sync", full)
    assert main(["regress", str(case), "--update", "--why", "x"]) == 6
    assert capsys.readouterr().err.endswith(f"{name}: No space left on device\n")
    assert contents(case) == before


def test_the_references_get_their_names_last(case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    named: list[str] = []
    replace = Path.replace

    def noted(self: Path, target: Any) -> Path:
        assert all(Path(f"{case / name}.part").exists() for name in NAMES[len(named) :])
        named.append(Path(target).name)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", noted)
    assert main(["regress", str(case), "--update", "--why", "x"]) == 0
    assert tuple(named) == NAMES


@pytest.mark.parametrize("stem", ["Flug \U0001f6e9\ufe0f", 'a "b"', "caf\udce9", "a\nb"])
def test_a_new_case_of_a_log_of_any_name_can_be_read(tmp_path: Path, stem: str) -> None:
    log = tmp_path / f"{stem}.tlog"
    log.write_bytes(fly(lambda t: 0.2 * (t % 3 > 1), lambda t: 1500 + 150 * (t % 3 > 1), 20.0).data)
    made = ["regress", "--new", str(log), "--name", "first", "--folder", str(tmp_path / "mine")]

    assert main([*made, "--orders", "2,2,1,1"]) == 0
    case = Case.read(tmp_path / "mine" / "first")
    assert case.config.orders == (2, 2, 1, 1)
    assert main(["regress", str(case.folder), "--update", "--why", "first"]) == 0
    assert main(["regress", str(case.folder)]) == 0
