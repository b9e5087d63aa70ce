"""The file of ``yawid step``: its columns by name, and the step that its u has."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from yawid.errors import ConfigError, SourceError
from yawid.runs.step import read_step


def test_a_step_in_column_u_says_its_height_and_time(tmp_path):
    file = tmp_path / "step.csv"
    file.write_text("t,u,y\n0,0,0\n1,0,0\n2,0.1,0\n3,0.1,1\n", encoding="utf-8")

    assert read_step(file)[2:] == (0.1, 2.0)
    assert read_step(file, u0=2.0)[2:] == (2.0, 2.0)
    file.write_text("t,u,y\n0,0,0\n1,0.1,0\n2,0,0\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="changes 2 times"):
        read_step(file)


def test_t_and_y_are_read_by_name(tmp_path):
    path = tmp_path / "step.csv"
    path.write_text("﻿ y , note, T\r\n1.5,a,0\r\n\r\n,b,0.1\r\n-2e-3,c,0.2\r\n", encoding="utf-8")
    t, y, *_ = read_step(path)
    np.testing.assert_array_equal(t, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(y, [1.5, np.nan, -2e-3])


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
    ],
)
def test_a_file_that_is_no_step_response_is_refused_with_its_place(tmp_path, text, message):
    path = tmp_path / "step.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_step(path)


def test_a_file_that_cannot_be_read_is_a_source_error(tmp_path):
    with pytest.raises(SourceError, match=r"cannot read .*absent\.csv"):
        read_step(tmp_path / "absent.csv")


def test_a_table_of_any_spelling_is_read(tmp_path):
    path = tmp_path / "step.csv"
    path.write_text("# flown today\nt;y\ns;rad/s\n0;0,5\n0,1;0,25\n", encoding="utf-8")
    t, y, *_ = read_step(path)
    np.testing.assert_array_equal(t, [0.0, 0.1])
    np.testing.assert_array_equal(y, [0.5, 0.25])


def test_a_dash_reads_standard_input(monkeypatch):
    text = io.TextIOWrapper(io.BytesIO(b"t,u,y\n0,0,0\n1,2,0.5\n"), encoding="utf-8")
    monkeypatch.setattr("sys.stdin", text)
    t, y, height, time_s = read_step(Path("-"))
    assert (t.tolist(), y.tolist(), height, time_s) == ([0.0, 1.0], [0.0, 0.5], 2.0, 1.0)
