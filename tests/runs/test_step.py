"""The file of ``yawid step``: its columns by name, and the step that its u has."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yawid.errors import ConfigError, SourceError
from yawid.runs.step import read_step

STEP = "t,u,y\n0,0,0\n1,0,0\n2,0.1,0\n3,0.1,1\n"
T, Y = [0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        (STEP, {}, (T, Y, 0.1, 2.0)),
        (STEP, {"u0": 2.0}, (T, Y, 2.0, 2.0)),
        # By name, in any spelling, with a note, a byte order mark, an empty line and a gap.
        (
            "\ufeff y , note, T\r\n1.5,a,0\r\n\r\n,b,0.1\r\n-2e-3,c,0.2\r\n", {"u0": 1.0},
            ([0.0, 0.1, 0.2], [1.5, np.nan, -2e-3], 1.0),
        ),
        (
            "# flown today\nt;y\ns;rad/s\n0;0,5\n0,1;0,25\n", {"u0": 1.0},
            ([0.0, 0.1], [0.5, 0.25], 1.0),
        ),
    ],
)  # fmt: skip
def test_t_and_y_are_read_by_name_and_u_says_the_height_and_time_of_its_step(
    text: str, options: dict[str, float], expected: tuple[Any, ...], tmp_path: Path, monkeypatch
):
    (tmp_path / "step.csv").write_text(text, encoding="utf-8", newline="")
    stdin = io.TextIOWrapper(io.BytesIO(text.encode()), encoding="utf-8")
    monkeypatch.setattr("sys.stdin", stdin)
    for place in (tmp_path / "step.csv", Path("-")):  # a dash is standard input
        found = read_step(place, **options)
        for ours, theirs in zip(found, expected, strict=False):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no line of numbers below a line with names"),
        ("0,1\n0.1,2\n", "numbers below 0 lines of a header"),
        ("a,b\n0,1\n0.1,2\n", "name one column t and one y"),
        ("t,y,y\n0,1,2\n", "name one column t and one y"),
        ("t,y\n0,1\n0.1,two\n", "line 3, column 2 .y.: 'two' is not a number"),
        ("t,y,u\n0,1,0\n1,1\n", "line 3: 2 cells, the header has 3"),
        ("\0\1\2", "no line of numbers below a line with names"),
        ("t,u,y\n0,0,0\n1,0.1,0\n2,0,0\n", "changes 2 times"),
    ],
)
def test_a_file_that_is_no_step_response_is_refused_with_its_place(
    text: str, message: str, tmp_path: Path
):
    (tmp_path / "step.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_step(tmp_path / "step.csv")
    with pytest.raises(SourceError, match=r"cannot read .*absent\.csv"):
        read_step(tmp_path / "absent.csv")
