"""The log of the link bench is what it says: its counts and the truth of its damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench import link as bench_link
from pymavlink.dialects.v20 import ardupilotmega as dialect

from yawid.sources.mavlink.decoder import Decoder


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, int]:
    path = tmp_path_factory.mktemp("bench") / "log.tlog"
    return path, *bench_link.write_log(path, 1)


def test_the_log_has_the_records_and_the_wanted_messages_it_says(
    log: tuple[Path, int, int],
) -> None:
    path, records, wanted = log
    decoder = Decoder(cls.msgname for cls in dialect.mavlink_map.values())
    block, rest = decoder.feed(path.read_bytes()), decoder.finish()
    found = [m for b in (block, rest) if b is not None for m in b.messages.values()]
    assert decoder.link.frames == records == sum(map(len, found))
    assert (decoder.link.lost, decoder.link.duplicates, decoder.link.skipped_bytes) == (0, 0, 0)
    assert len({m.name for m in found}) == 32
    assert sum(len(m) for m in found if m.name in bench_link.WANTED) == wanted
    assert wanted == pytest.approx(bench_link.SHARE_WANTED * records, rel=0.02)
    assert sum(bench_link.read_yawid(path)) == wanted


def test_every_record_the_damage_spared_stands_where_the_truth_says(
    log: tuple[Path, int, int], tmp_path: Path
) -> None:
    path, records, _ = log
    truth, starts = bench_link.damage(path, tmp_path / "damaged.tlog")
    sound, damaged = path.read_bytes(), (tmp_path / "damaged.tlog").read_bytes()
    old = 0
    assert len(starts) == records > len(truth) > 0.9 * records
    spared = set(truth.tolist())
    for new in starts.tolist():
        size = 8 + 12 + sound[old + 9]
        assert (sound[old : old + size] == damaged[new : new + size]) == (new in spared)
        old += size
    assert old == len(sound)
    assert np.all(np.isin(truth, starts))
    assert len(damaged) > len(sound)
