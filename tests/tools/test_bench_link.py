"""The log of the link bench is what it says: its counts and the truth of its damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench import link as bench_link
from flights.long_log import MIXES, write_log
from pymavlink.dialects.v20 import ardupilotmega as dialect

from yawid.channels import stage
from yawid.sources.mavlink.decoder import Decoder


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    path = tmp_path_factory.mktemp("bench") / "log.tlog"
    return path, write_log(path, 1.0 / bench_link.MB_AN_HOUR, bench_link.MIX)


def test_the_log_has_the_size_and_the_wanted_messages_it_says(log: tuple[Path, int]) -> None:
    path, records = log
    decoder = Decoder(cls.msgname for cls in dialect.mavlink_map.values())
    block, rest = decoder.feed(path.read_bytes()), decoder.finish()
    found = [m for b in (block, rest) if b is not None for m in b.messages.values()]
    assert decoder.link.frames == records == sum(map(len, found))
    assert (decoder.link.lost, decoder.link.duplicates, decoder.link.skipped_bytes) == (0, 0, 0)
    assert {m.name for m in found} == {*MIXES[bench_link.MIX], "PARAM_VALUE"}
    assert path.stat().st_size == pytest.approx(1e6, rel=0.02)
    wanted = sum(len(m) for m in found if m.name in bench_link.WANTED)
    assert sum(bench_link.read_yawid(path)) == wanted
    assert set(bench_link.WANTED) == stage.WANTED & {m.name for m in found}
    assert wanted == pytest.approx(0.53 * records, rel=0.02)


def test_every_record_the_damage_spared_stands_where_the_truth_says(
    log: tuple[Path, int], tmp_path: Path
) -> None:
    path, records = log
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
