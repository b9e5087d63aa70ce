from __future__ import annotations

import numpy as np
import pytest

from yawid.errors import ConfigError, SourceError
from yawid.offline.step_file import step_from_csv


def test_t_and_y_are_read_by_name(tmp_path):
    path = tmp_path / "step.csv"
    path.write_text("﻿ y , note, T\r\n1.5,a,0\r\n\r\n,b,0.1\r\n-2e-3,c,0.2\r\n", encoding="utf-8")
    t, y = step_from_csv(path)
    np.testing.assert_array_equal(t, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(y, [1.5, np.nan, -2e-3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "name one column t and one y"),
        ("0,1\n0.1,2\n", "name one column t and one y"),
        ("t,y,y\n0,1,2\n", "name one column t and one y"),
        ("t,y\n0,1\n0.1,two\n", "line 3"),
        ("t,y\n0,1\n,2\n", "line 3"),
    ],
)
def test_a_file_that_is_no_step_response_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "step.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        step_from_csv(path)


def test_a_file_that_cannot_be_read_is_a_source_error(tmp_path):
    with pytest.raises(SourceError, match="cannot be read"):
        step_from_csv(tmp_path / "absent.csv")
    (tmp_path / "log.bin").write_bytes(b"\xfe\x00\xff\xfe")
    with pytest.raises(SourceError, match="cannot be read"):
        step_from_csv(tmp_path / "log.bin")
