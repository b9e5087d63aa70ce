"""The tables made from pymavlink's classes."""

from __future__ import annotations

import numpy as np
import pytest
from sources.tlog_records import BY_NAME, CLASSES

from yawid.errors import ConfigError
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.definitions import UNKNOWN, definitions, dtype_of


def test_every_message_has_its_fields_size_row_and_crc_extra() -> None:
    known = definitions()
    for cls in CLASSES:
        dtype, row = dtype_of(cls.msgname), known.row_of[cls.id]
        assert dtype.itemsize == cls.unpacker.size
        assert list(dtype.names or ()) == cls.ordered_fieldnames
        assert (known.crc_extra[row], known.names[cls.msgname]) == (cls.crc_extra, row)
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
    assert (fits[0], fits[-1]) == (base, BY_NAME[name].unpacker.size)


def test_a_name_that_the_dialect_does_not_know_is_refused() -> None:
    for ask in (dtype_of, lambda name: Decoder({name})):
        with pytest.raises(ConfigError, match="ATITUDE"):
            ask("ATITUDE")
