"""A configuration as TOML: any text in it comes back, and its lines stay as files have them."""

from __future__ import annotations

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from yawid.config.run import RunConfig
from yawid.config.settings import check_settings


@given(columns=st.lists(st.text(), max_size=3), rate=st.floats(0.1, 1000.0))
def test_whatever_a_column_is_called_its_configuration_comes_back(
    columns: list[str], rate: float
) -> None:
    config = RunConfig(columns=tuple(columns), rate=rate, band=(0.1, 3.0))
    read = tomllib.loads(config.to_toml())

    assert read["columns"] == columns
    assert "sysid" not in read  # which is not given
    assert RunConfig(**check_settings(read, "here")) == config
