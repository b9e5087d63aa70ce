"""What a file's header, units, separators and times say: understood, or refused in one line."""

from __future__ import annotations

import contextlib
import csv
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawid.blocks import RecordBlock
from yawid.channels.stage import Channels
from yawid.config.run import RunConfig
from yawid.errors import ChannelError, ConfigError, SourceError, YawidError
from yawid.sources.open_log import Log
from yawid.sources.records.find_columns import Asked
from yawid.sources.records.record import Record

RUDDER_DEG, R_DEG_S = [1.0, -2.0, 3.0, 4.0], [10.0, 20.5, -30.0, 5.0]
HEAD = "t,rudder_deg,r_deg_s\n"
BODY = "0,1,10\n0.02,-2,20.5\n0.04,3,-30\n0.06,4,5\n"
RIGHT = Asked(rudder_sign="nose-right")
IN_RAD = Asked(rudder_unit="rad", rudder_sign="nose-left")
UNIX = 1_700_000_000
DATES = "".join(
    f"2023-11-14T22:13:20.{ms:02d}Z,{u},{r}\n"
    for ms, u, r in zip((0, 2, 4, 6), RUDDER_DEG, R_DEG_S, strict=True)
)
UNDERSTOOD = {
    "suffixes": HEAD + BODY,
    "a unit row": "t,rudder,r\ns,deg,deg/s\n" + BODY,
    "a unit row without the time's": "t,rudder,r\n,deg,deg/s\n" + BODY,
    "brackets": "t [s], rudder [deg], r (°/s)\n" + BODY,
    "a title, comments, empty lines": "Flight 12, of May\n# by hand\n\nt,rudder_deg,r_dps\n\n"
    + BODY,
    "a header in a comment": "# t rudder_deg r_deg_s\n" + BODY.replace(",", " "),
    "more columns than are known": "t,rudder_deg,fuel,r_deg_s\n"
    + BODY.replace(",10", ",x,10")
    .replace(",20", ",y,20")
    .replace("3,", "3,z,")
    .replace("4,5", "4,,5"),
    "a decimal comma": "t;rudder_deg;r_deg_s\n" + BODY.replace(",", ";").replace(".", ","),
    "tabs and CRLF": "t\trudder_deg\tr_deg_s\r\n" + BODY.replace(",", "\t").replace("\n", "\r\n"),
    "Excel's separator": "sep=;\nt;rudder_deg;r_deg_s\n" + BODY.replace(",", ";"),
    "milliseconds": "t_ms,rudder_deg,r_deg_s\n0,1,10\n20,-2,20.5\n40,3,-30\n60,4,5\n",
    "cells of one channel at a time": HEAD
    + "0,1,10\n0.02,-2,\n0.02,,20.5\n0.04,3,-30\n0.06,4,\n0.06,,5\n",
    "NaN in place of nothing": HEAD + "0,1,10\n0.01,NaN,nan\n" + BODY[7:],
    "capitals and quotes": '"t","Rudder [deg]","r [DEG/S]"\n' + BODY,
    "a separator at the end of each line": "t,rudder_deg,r_deg_s,\n" + BODY.replace("\n", ",\n"),
    "comments and empty lines between its rows": HEAD + BODY.replace("0.04", "# gust\n\n0.04"),
    "single blanks": "t rudder_deg r_deg_s\n" + BODY.replace(",", " "),
    "Unix time": HEAD
    + "".join(f"{UNIX + float(r[0]):.2f},{r[1]},{r[2]}\n" for r in csv.reader(BODY.split())),
    "dates": HEAD + DATES,
    "dates under another name": HEAD.replace("t,", "time,") + DATES,
}


def settled(path: Path, text: str | bytes, asked: Asked = RIGHT) -> Record:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    record = Log(path, ()).record
    record.settle(asked)
    return record


def check(record: Record) -> None:
    whole = RecordBlock.joined([rows for _, rows in record.read() if rows])
    rows = whole.select(whole.has_yaw)
    np.testing.assert_array_equal(rows.t_us, [0, 20_000, 40_000, 60_000])
    np.testing.assert_allclose(np.rad2deg(rows.r), R_DEG_S, rtol=1e-12)
    surfaces = whole.select(whole.has_surfaces)
    # The last row holds for one interval.
    np.testing.assert_array_equal(surfaces.t_us, [0, 20_000, 40_000, 60_000, 80_000])
    np.testing.assert_allclose(np.rad2deg(surfaces.rudder), [*RUDDER_DEG, 4.0], rtol=1e-12)


@pytest.mark.parametrize("name", UNDERSTOOD)
def test_a_table_of_texts_is_understood_however_it_is_written(tmp_path: Path, name: str) -> None:
    check(settled(tmp_path / "flight", UNDERSTOOD[name]))  # known by its bytes, not by its name


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_its_text_may_be_encoded_as_spreadsheets_do(tmp_path: Path, encoding: str) -> None:
    check(settled(tmp_path / "a.csv", UNDERSTOOD["brackets"].encode(encoding)))


OTHER_NAMES = "Time,delta_r,Yaw Rate\n" + BODY


def test_options_say_what_a_file_does_not(tmp_path: Path) -> None:
    columns = ("t=Time", "rudder=delta_r", "r=Yaw Rate")
    asked = Asked(columns, units="deg", rudder_unit="deg", rudder_sign="nose-left")

    check(settled(tmp_path / "a.csv", OTHER_NAMES, asked))
    asked = Asked((*columns[:2], "r=Yaw Rate[deg/s]"), rudder_unit="deg", rudder_sign="nose-left")
    check(settled(tmp_path / "a.csv", OTHER_NAMES, asked))
    # Of a row below the names one unit is known, two are not: it is a row of units all the same.
    spelt = OTHER_NAMES.replace("\n", "\ns,Grad,rad/s\n", 1)
    asked = Asked(("t=Time", "rudder=delta_r[deg]", "r=Yaw Rate[deg/s]"), rudder_sign="nose-left")
    check(settled(tmp_path / "a.csv", spelt, asked))


@pytest.mark.parametrize("column", ["airspeed", "on_ground", "unknown"])
def test_full_rudder_on_the_ground_is_no_scale_of_a_flight(tmp_path: Path, column: str) -> None:
    """25 deg either way in a control check and in the landing roll, 2 deg in between"""
    t = np.arange(1200) / 20.0
    ground = (t < 15) | (t >= 45)
    rudder = np.where(ground, 25.0, 2.0) * np.sign(np.sin(2 * t))
    other = {"airspeed": np.where(ground, 12.0, 80.0), "on_ground": ground, "unknown": t}[column]
    rows = zip(t, rudder, np.sin(t), other, strict=True)
    text = f"t,rudder_deg,r_deg_s,{column}\n" + "".join(
        f"{a:.2f},{b:.3f},{c:.4f},{float(d):g}\n" for a, b, c, d in rows
    )
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    found = Log(tmp_path / "a.csv", ()).record.settle(RIGHT).stroke_rad
    assert found == pytest.approx(np.deg2rad(50.0 if column == "unknown" else 4.0))


def test_parquet_says_its_units_with_its_fields_and_its_dates_by_their_type(tmp_path: Path) -> None:
    t = pa.array([UNIX * 1000 + ms for ms in (0, 20, 40, 60)], pa.timestamp("ms", "UTC"))
    units = ("rudder", RUDDER_DEG, "deg"), ("r", R_DEG_S, "deg/s")
    fields = [pa.field(name, pa.float32(), metadata={"unit": unit}) for name, _, unit in units]
    schema = pa.schema([pa.field("t", t.type), *fields])
    arrays = [t, *(pa.array(values, pa.float32()) for _, values, _ in units)]
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), tmp_path / "flight")
    record = Log(tmp_path / "flight", ()).record
    settled = record.settle(RIGHT)

    check(record)
    assert settled.rudder_unit == "deg"
    assert settled.stroke_rad == pytest.approx(np.deg2rad(6.0))
    assert record.link.first_us == UNIX * 1_000_000


REFUSED: dict[str, tuple[str, Asked, type[YawidError], str]] = {
    "no yaw rate": (
        "t,rudder_deg,YawRate\n" + BODY,
        RIGHT,
        ChannelError,
        "no column is r .*--columns 'r=YawRate' --units deg/rad, .* are t, rudder_deg, YawRate",
    ),
    "no time and no rate": (
        "Time,rudder_deg,Yaw Rate\n" + BODY,
        RIGHT,
        ChannelError,
        "no column is t .*, r .*--columns 't=Time,r=Yaw Rate'",
    ),
    "no unit of the rudder": (
        "t,rudder,r_deg_s\n" + BODY,
        RIGHT,
        ConfigError,
        "column rudder: .*--rudder-unit half-travel, rad or deg",
    ),
    "no sign": (HEAD + BODY, Asked(), ConfigError, "column rudder_deg: .*--rudder-sign"),
    "all three names, both units and the sign": (
        "Time,DeltaR,YawRate\n" + BODY,
        Asked(),
        ChannelError,
        "--columns 't=Time,rudder=DeltaR,r=YawRate' --rudder-unit half-travel/rad/deg "
        "--rudder-sign nose-right/nose-left --units deg/rad, with one of the values at each /",
    ),
    "names, but neither units nor a sign": (
        "t,rudder,gyro,V\n" + BODY.replace("\n", ",20\n"),
        Asked(("r=gyro", "airspeed=V")),
        ConfigError,
        r"not given are the unit of rudder, .*; the unit of gyro \(up to 30\); the unit of V .*: "
        r"add --columns 'r=gyro,airspeed=V\[UNIT\]' --rudder-unit half-travel/rad/deg "
        "--rudder-sign nose-right/nose-left --units deg/rad",
    ),
    "rows that were shuffled": (
        HEAD + "".join(f"{i * 37 % 100},1,1\n" for i in range(100)),
        RIGHT,
        SourceError,
        "the rows are not in the order of time: it falls back at 36 of 100 rows, first in line 5",
    ),
    "two units of the rudder": (
        HEAD + BODY,
        IN_RAD,
        ConfigError,
        "it is in deg, but --rudder-unit is rad",
    ),
    "a rudder of 40 rad": (
        "t,rudder,r_deg_s\n" + BODY.replace(",4,", ",40,"),
        IN_RAD,
        ConfigError,
        "up to 40, which is too much in rad",
    ),
    "a yaw rate of 30 without a unit": (
        "t,rudder_deg,r\n" + BODY,
        RIGHT,
        ConfigError,
        r"column r: it goes up to 30, which may be rad/s or deg/s.*--columns 'r=r\[deg/s\]'",
    ),
    "a yaw rate of 300 without a unit": (
        "t,rudder_deg,r\n" + BODY.replace("-30", "-300"),
        RIGHT,
        ConfigError,
        "column r: it goes up to 300, which is too much in rad/s,.*--units deg",
    ),
    "a yaw rate of .5, a fast one in rad/s and a slow one in deg/s": (
        "t,rudder_deg,r\n0,1,.1\n.02,-2,.5\n.04,3,-.3\n.06,4,0\n",
        RIGHT,
        ConfigError,
        r"up to 0.5, which may be rad/s or deg/s.*'r=r\[deg/s\]' or 'r=r\[rad/s\]'",
    ),
    "another name without a unit": (
        "t,rudder_deg,gyro\n" + BODY,
        Asked(("r=gyro",), rudder_sign="nose-left"),
        ConfigError,
        "column gyro: the unit of this r is not given: .*--units deg",
    ),
    "another unit than can be": (
        "t,rudder_deg,r [m]\n" + BODY,
        RIGHT,
        SourceError,
        "its unit is 'm', and r needs one of rad/s",
    ),
    "a unit nobody knows": (
        "t,rudder [clicks],r_deg_s\n" + BODY,
        RIGHT,
        SourceError,
        "'clicks', and rudder needs one of half-travel, rad, deg",
    ),
    "a column that is not there": (
        HEAD + BODY,
        Asked(("r=gyro",)),
        ConfigError,
        "no column is called gyro in .*, which has t, ",
    ),
    "a name that is no column's": (
        HEAD + BODY,
        Asked(("beta=gyro",)),
        ConfigError,
        "NAME one of t, rudder, r, .*got 'beta=gyro'",
    ),
    "two columns of one name": (
        "t,rudder_deg,r_deg_s,r\n" + BODY.replace("\n", ",0\n"),
        RIGHT,
        SourceError,
        "two columns are r",
    ),
    "a text where a number is": (
        HEAD + BODY.replace("-30", "fast"),
        RIGHT,
        SourceError,
        r"line 4, column 3 \(r_deg_s\): 'fast' is not a number",
    ),
    "a line that was cut short": (
        HEAD + BODY.removesuffix(",5\n"),
        RIGHT,
        SourceError,
        "read as CSV, line 5: 2 cells, the header has 3",
    ),
    "a row without a time": (
        HEAD + BODY.replace("0.04,", ","),
        RIGHT,
        SourceError,
        "line 4: a row without a time",
    ),
    "a clock that stands": (HEAD + "1,1,1\n" * 4, RIGHT, SourceError, "time does not advance"),
    "a clock in other units": (
        HEAD + "0,1,10\n20,-2,20\n40,3,-30\n60,4,5\n",
        RIGHT,
        ConfigError,
        r"median step is 20 s; .*'t=t\[ms\]'",
    ),
    "a time of day": (
        HEAD + "12:00:01.5,1,10\n12:00:02,1,10\n12:00:03,1,10\n",
        RIGHT,
        SourceError,
        r"line 2, column 1 \(t\): '12:00:01.5' is not a time",
    ),
    "points and commas": (
        "t;rudder_deg;r_deg_s\n0,5;1;1\n0,6;1.5;1\n0,7;1,5;1\n",
        RIGHT,
        SourceError,
        r"line 3, column 2 \(rudder_deg\): '1.5' is not a number: the decimal sign is ','",
    ),
    "exponents of Fortran": (
        HEAD + BODY.replace("0.02", "2D-2"),
        RIGHT,
        SourceError,
        r"line 3, column 1 \(t\): '2D-2' is not a number: .*an exponent has an E",
    ),
    "columns of one width": (
        HEAD.replace(",", "   ") + BODY.replace(",", "   "),
        RIGHT,
        SourceError,
        "line 2: 7 cells, the header has 3: .*one separator, such as a comma",
    ),
    "dates of two zones and of none": (
        HEAD + DATES.replace("Z", "+02:00", 1).replace("Z", "", 1),
        RIGHT,
        SourceError,
        r"column 1 \(t\): .*all its times need one spelling, such as 2024-05-01T12:00:00.5Z",
    ),
    "a reason nobody gives": (
        "t,rudder_deg,r_deg_s,held\n" + BODY.replace("\n", ",tired\n"),
        RIGHT,
        SourceError,
        "line 2: 'tired' is not a reason",
    ),
    "a channel that is empty": (
        HEAD + "0,1,\n0.1,1,\n0.2,2,\n",
        RIGHT,
        ChannelError,
        "column r_deg_s: it holds no value",
    ),
    "an aileron that is asked for": (
        HEAD + BODY,
        Asked(needs=("aileron",)),
        ChannelError,
        "no column is aileron",
    ),
    "no header": (BODY, RIGHT, SourceError, "line 1: numbers below 0 lines of a header"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_known_is_refused_with_what_to_say(tmp_path: Path, name: str) -> None:
    text, asked, kind, said = REFUSED[name]
    with pytest.raises(kind, match=said) as refusal:
        settled(tmp_path / "flight.csv", text, asked)

    assert "\n" not in str(refusal.value)
    assert "flight.csv" in str(refusal.value) or name.startswith("a name")


def test_texts_that_are_no_table_are_no_records(tmp_path: Path) -> None:
    for text in (
        "Dear all, here is what we flew,\nand it was fine, too.\n",
        "# notes\n1 2 3\n",
        "",
    ):
        (tmp_path / "notes.txt").write_text(text, encoding="utf-8")
        with pytest.raises(SourceError):
            _ = Log(tmp_path / "notes.txt", ()).record


@given(
    data=st.one_of(st.binary(max_size=200), st.text(',;\t"#.-0123456789etrudn[]\n', max_size=200)),
    name=st.sampled_from(sorted(UNDERSTOOD)),
    where=st.integers(0, 400),
    instead=st.integers(0, 20),
)
def test_damaged_bytes_are_understood_or_refused_and_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, data: bytes | str, name: str, where: int, instead: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.csv"
    whole = UNDERSTOOD[name].encode()
    bits = data if isinstance(data, bytes) else data.encode()
    path.write_bytes(whole[:where] + bits + whole[where + instead :])
    with contextlib.suppress(YawidError):
        record = Record(path)
        record.settle(RIGHT)
        channels = Channels(RunConfig())
        for _, rows in record.read():
            if rows is not None:
                channels.feed_rows(rows)
        channels.finish()
