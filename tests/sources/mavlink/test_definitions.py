"""The tables made from pymavlink's classes."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from sources.tlog_records import BY_NAME, CLASSES

from yawid.errors import ConfigError
from yawid.sources.mavlink.definitions import UNKNOWN, definitions, dtype_of


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.msgname)
def test_every_dtype_has_the_size_and_fields_of_the_message(cls: Any) -> None:
    dtype = dtype_of(cls.msgname)
    assert dtype.itemsize == cls.unpacker.size
    assert list(dtype.names or ()) == cls.ordered_fieldnames


def test_arrays_are_subarrays_and_text_is_bytes() -> None:
    assert dtype_of("ACTUATOR_CONTROL_TARGET")["controls"] == np.dtype(("<f4", (8,)))
    assert dtype_of("PARAM_VALUE")["param_id"] == np.dtype("S16")


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(ConfigError, match="NO_SUCH"):
        dtype_of("NO_SUCH")


def test_ids_lead_to_their_rows() -> None:
    known = definitions()
    for cls in CLASSES:
        assert known.crc_extra[known.row_of[cls.id]] == cls.crc_extra
        assert known.names[cls.msgname] == known.row_of[cls.id]
    assert np.count_nonzero(known.row_of != UNKNOWN) == len(CLASSES)


@pytest.mark.parametrize(
    ("name", "base"),
    [("ATTITUDE", 28), ("SERVO_OUTPUT_RAW", 21), ("SYS_STATUS", 31), ("STATUSTEXT", 51)],
)
def test_mavlink_1_has_the_base_payload_or_extensions_but_nothing_else(
    name: str, base: int
) -> None:
    known = definitions()
    fits = np.flatnonzero(known.fits_v1[known.names[name]])
    assert fits[0] == base
    assert fits[-1] == BY_NAME[name].unpacker.size


def test_importing_the_readers_does_not_import_pymavlink() -> None:
    modules = "sys, yawid.sources.logs.tlog, yawid.sources.link.udp"
    code = f"import {modules}; print('pymavlink' in sys.modules)"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "False"
