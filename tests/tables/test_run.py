"""``yawid.load`` and ``yawid.replay``: a run in Python, and what other libraries make of it."""

from __future__ import annotations

import pickle
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pytest
from finished_runs import replayed
from forged_runs import forge
from hand_flights import manoeuvre, summary
from msgspec.structs import replace
from places import C172P, REPLAY_LOGS

import yawid
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Bare, DutchRoll, Value
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.sinks.base import Grid
from yawid.sinks.mcap import reader
from yawid.tables.columns import Units, manoeuvre_columns
from yawid.tables.run import Run
from yawid.tables.table import Column, Table


@pytest.fixture(scope="module")
def mcap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return replayed(C172P, tmp_path_factory.mktemp("run"), "--rate", 10)


@pytest.fixture(scope="module")
def run(mcap: Path) -> Run:
    return yawid.load(mcap)


def tables(run: Run) -> Iterator[Table]:
    yield from (run.samples, *run.estimates.values(), run.modes, run.manoeuvres, run.record)


def assert_same(ours: Run, theirs: Run) -> None:
    for one, other in zip(tables(ours), tables(theirs), strict=True):
        assert (one.units, one.says, repr(one)) == (other.units, other.says, repr(other))
        for name in one:
            exact = {"equal_nan": True} if one[name].dtype.kind in "fM" else {}
            assert np.array_equal(one[name], other[name], **exact), name
    ours_told, theirs_told = ours.summary.to_json(), theirs.summary.to_json()
    for key in ("estimates", "verdict", "channels", "link", "vehicle", "manoeuvres", "flight"):
        assert ours_told.get(key) == theirs_told.get(key), key


def test_a_replay_in_python_is_the_run_that_the_command_line_writes_to_the_bit_and_no_file(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    options = tmp_path / "options.toml"
    options.write_text('rate = 5\nout = "elsewhere"\n', encoding="utf-8")

    direct = yawid.replay(C172P, rate=10, config=options)

    assert_same(direct, run)
    assert direct.summary.files is None
    assert [*tmp_path.iterdir()] == [options]
    assert yawid.load(direct.mcap(str(tmp_path / "runs"))).usable is run.usable
    with pytest.raises(ConfigError, match="must be a run or a path, got int"):
        yawid.diff(run, 3)  # type: ignore[arg-type]  # the mistake


def test_of_an_mcap_too_even_where_its_own_name_would_be_written(
    mcap: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(mcap.parent)
    options: dict[str, Any] = {
        "orders": (2, 2, 1, 1),
        "from_s": 50,
        "to_s": 140,
        "manoeuvres": "off",
    }

    assert_same(yawid.replay("log.mcap", **options), yawid.replay(C172P, rate=10.0, **options))


def test_columns_bear_the_names_of_records_and_of_theta_with_their_units(
    mcap: Path, run: Run
) -> None:
    rows = next(reader.open_run(mcap).blocks())
    els = run.estimates["els"]

    assert run.samples.columns[:3] == ("t", "rudder", "r")
    assert run.samples.units["rudder"] == "half-travel"
    np.testing.assert_array_equal(run.samples.r, rows.samples.y)
    np.testing.assert_array_equal(els["b2_std"], rows.estimates["els"].theta_std[:, 4])
    assert [els.units[name] for name in ("a1", "b1", "bias", "innovation")] == [
        "1", "rad/s per half-travel", "rad/s", "rad/s",
    ]  # fmt: skip
    np.testing.assert_array_equal(run.modes.wn_std, rows.modes.dutch_roll[:, 1])
    [found] = run.summary.manoeuvres or ()
    assert run.manoeuvres.yaw_acceleration.tolist() == [found.answer.yaw_acceleration.value]
    assert run.manoeuvres.units["wn_std"] == "rad/s"


def test_rows_are_chosen_and_a_name_that_is_not_there_is_told(run: Run) -> None:
    late = run.samples[run.samples.t > 100.0]

    assert 0 < len(late) < len(run.samples)
    assert late.units == run.samples.units
    assert len(run.samples[5:9]) == len(pickle.loads(pickle.dumps(run.samples[5:9]))) == 4
    with pytest.raises(AttributeError, match="no column 'rate': t, rudder, r"):
        _ = run.samples.rate
    with pytest.raises(KeyError, match="no column 'rate': t, rudder, r"):
        _ = run.samples["rate"]


def test_a_long_run_is_read_a_block_at_a_time(mcap: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = mcap.open("rb")
    monkeypatch.setattr(reader, "BLOCK_ROWS", 100)
    found = reader.open_run(mcap)
    monkeypatch.setattr(reader, "opened", lambda path: stream)

    blocks = found.blocks()
    first = next(blocks)

    assert 0 < stream.tell() < mcap.stat().st_size / 2
    assert sum(len(block.samples) for block in blocks) == found.rows - len(first.samples)


def test_an_unusable_run_says_so_before_any_number_and_nothing_in_it_is_markup(
    tmp_path: Path,
) -> None:
    log = tmp_path / "<script>alert(1)<" / "log.tlog"
    log.parent.mkdir()
    log.write_bytes(C172P.read_bytes()[:30_000])

    run = yawid.replay(log)

    assert not run.summary.deciding.usable
    assert "NOT USABLE" in repr(run.modes)
    page = run._repr_html_() + run.samples._repr_html_() + run.manoeuvres._repr_html_()
    assert page.index("NOT USABLE, the numbers are for study only") < page.index("wn ")
    assert ": NOT USABLE" in repr(run).partition("\n")[0]
    tags = {each.tag for each in ElementTree.fromstring(f"<div>{page}</div>").iter()}
    assert tags == {"div", "p", "b", "table", "tr", "th", "td", "small"}

    log.write_bytes(C172P.read_bytes()[:500])  # without a rudder
    empty = yawid.replay(log)
    assert [len(each) for each in tables(empty)] == [0, 0, 0, 0]
    assert "held" in empty.record
    assert ": NOT USABLE\n" in repr(empty)


def test_an_output_that_is_no_yaw_rate_is_not_called_r() -> None:
    log, few = REPLAY_LOGS / "c172p_gaps" / "log.tlog", {"manoeuvres": "off", "also": "none"}

    record = yawid.replay(log, output="yaw", turn="remove", rudder_max_deg=25, **few).record

    assert "r" not in record
    assert record.units["mean_heading_rate_less_turn_hat"] == "rad/s"
    assert record.units["rudder"] == "rad"


def test_a_table_shows_its_first_and_last_rows() -> None:
    table = Table.of("rows", [Column("n", np.arange(40)), Column("x", np.full(40, np.nan), "m")])

    page = table._repr_html_()

    assert page.count("<tr>") == 1 + 10 + 1
    assert re.search("<td[^>]*>39</td><td[^>]*></td>", page)
    assert repr(table) == "rows, 40 rows: n, x [m]"


def test_a_table_is_one_of_arrow_and_one_of_pandas_and_a_library_that_is_missing_is_named(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, frame = pa.table(run.samples), run.record.to_pandas()

    assert found.equals(run.samples.arrow)
    assert found.schema.field("r").metadata[b"unit"] == b"rad/s"
    assert found["airspeed"].null_count == np.count_nonzero(np.isnan(run.samples.airspeed))
    np.testing.assert_array_equal(frame["wn"], run.modes.wn)
    assert frame.attrs["units"]["wn"] == "rad/s"
    monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(ConfigError, match="needs polars: pip install polars"):
        run.record.to_polars()


def test_xarray_has_the_units_over_the_time_and_polars_has_null_where_nothing_is_known(
    run: Run,
) -> None:
    found, rows = run.record.to_xarray(), run.manoeuvres.to_xarray()

    assert (found.sizes, rows.sizes) == ({"t": len(run.record)}, {"n": len(run.manoeuvres)})
    assert found["wn"].attrs["units"] == "rad/s"
    np.testing.assert_array_equal(found["wn"], run.modes.wn)
    pytest.importorskip("polars")
    unknown = run.record.to_polars()["airspeed"].is_null()
    np.testing.assert_array_equal(unknown, np.isnan(run.samples.airspeed))


@pytest.mark.skipif(sys.platform == "win32", reason="no file has such a name there")
def test_the_repr_of_a_forged_run_has_no_command_to_a_terminal(mcap: Path, tmp_path: Path) -> None:
    esc = "\x1b[31mUSABLE\x1b[0m\u202e"
    reason = {"id": "rate_low", "weight": "warning", "text": f"low {esc}"}

    def with_commands(summary: dict[str, Any]) -> dict[str, Any]:
        summary["verdict"]["reasons"] = summary["flight"]["verdict"]["reasons"] = [reason]
        return summary

    forged = yawid.load(forge(mcap, tmp_path / f"{esc}.mcap", summary=with_commands))
    for text in (repr(forged), forged._repr_html_()):
        assert r"low \x1b[31mUSABLE\x1b[0m\u202e" in text
        assert not set("\x1b\u202e") & set(text)


def test_the_bare_airframe_of_a_manoeuvre_has_columns_of_its_own() -> None:
    usable = Verdict(usable=True, reasons=[])
    roll = DutchRoll(wn_rad_s=10.3, wn_std=0.2, zeta=0.63, zeta_std=0.02)
    bare = Bare(dutch_roll=roll, derivatives={"N_r": Value(-0.7, 0.1)}, used=[1], verdict=usable)
    two = summary([replace(manoeuvre(1), lateral=bare), manoeuvre(2)], None)
    known = Units(Grid((), ("rudder",), (), 0.05, "half-travel"), RunConfig())
    found = Table.of("manoeuvres", [*manoeuvre_columns(two, known)])

    for name, value, unit in (("bare_wn_rad_s", 10.3, "rad/s"), ("N_r", -0.7, "1/s")):
        np.testing.assert_array_equal(found[name], [value, np.nan])
        assert found.units[name] == unit
    assert found.N_r_std[0] == 0.1
