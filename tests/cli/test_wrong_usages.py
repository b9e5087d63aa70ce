"""Every wrong command line of ``wrong_usages.txt`` gets the line that stands below it there."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from yawid.cli.main import main

LINES = (Path(__file__).parent / "wrong_usages.txt").read_text(encoding="utf-8").splitlines()
TABLE = list(zip(LINES[::2], LINES[1::2], strict=True))


def test_the_table_is_as_long_as_what_is_known():
    assert len({typed for typed, _ in TABLE}) == len(TABLE) >= 160


def test_a_wrong_command_line_is_one_line_with_what_to_do_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    for typed, expected in TABLE:
        try:
            code: object = main(shlex.split(typed.removeprefix("$ yawid")))
        except SystemExit as ended:
            code = ended.code
        said = capsys.readouterr()
        assert (code, said.out, said.err) == (2, "", f"yawid: {expected}\n"), typed
    assert list(tmp_path.iterdir()) == []
