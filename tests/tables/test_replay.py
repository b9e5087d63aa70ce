"""``yawid.replay`` of what a notebook has: tables in memory, keywords, and answers as values."""

from __future__ import annotations

import inspect
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from damper.test_study import doublets

import yawid
from yawid.config.run import settings_declared
from yawid.errors import ConfigError
from yawid.tables.run import Run

SAID: dict[str, Any] = {"rudder_unit": "half-travel", "rudder_is": "commanded", "also": "none"}


def record() -> dict[str, Any]:
    u, r = doublets()
    t = 10.0 + 0.05 * np.arange(len(u))
    return {"t": t, "rudder": u, "r [rad/s]": r, "airspeed [m/s EAS]": np.full(len(t), 20.0)}


def shapes(tmp_path: Path) -> dict[str, Any]:
    import pandas as pd

    data = record()
    indexed = pd.DataFrame(data).set_index("t")
    by_units = pd.DataFrame({"t": data["t"], "rudder": data["rudder"], "r": data["r [rad/s]"],
                             "airspeed": 20.0})  # fmt: skip
    by_units.attrs["units"] = {"r": "rad/s", "airspeed": "m/s EAS"}
    pq.write_table(pa.table(data), tmp_path / "record.parquet")
    return {
        "path": tmp_path / "record.parquet", "dict": data, "Table": pa.table(data),
        "index": indexed, "attrs": by_units,
    }  # fmt: skip


@pytest.fixture(scope="module")
def run() -> Run:
    return yawid.replay(record(), **SAID, manoeuvres="auto")


def test_every_table_in_memory_gives_what_its_file_gives(tmp_path: Path) -> None:
    data = shapes(tmp_path)
    hidden = np.arange(len(data["dict"]["t"])) % 300 // 3 == 13
    r = data["dict"]["r [rad/s]"]
    below = np.where(hidden, 9.0, r)  # which means nothing
    data["masked"] = data["dict"] | {"r [rad/s]": np.ma.masked_array(below, hidden)}
    data["missing"] = data["dict"] | {"r [rad/s]": np.where(hidden, np.nan, r)}
    degrees = {"t": data["dict"]["t"], "rudder": data["dict"]["rudder"], "gyro": np.degrees(r)}
    runs = {name: yawid.replay(each, **SAID, manoeuvres="off") for name, each in data.items()}
    named = yawid.replay(degrees, columns={"r": "gyro[deg/s]"}, **SAID, manoeuvres="off")

    whole, masked, missing = (runs.pop(name) for name in ("path", "masked", "missing"))
    np.testing.assert_array_equal(masked.samples.r, missing.samples.r)
    assert np.isnan(masked.samples.r).sum() > np.isnan(whole.samples.r).sum()
    assert masked.summary.estimates == missing.summary.estimates
    np.testing.assert_allclose(named.samples.r, whole.samples.r, atol=1e-12)
    assert whole.samples.r.std() > 0.05
    for name, each in runs.items():
        np.testing.assert_array_equal(each.samples.r, whole.samples.r, name)
        assert each.summary.estimates == whole.summary.estimates, name
    assert [runs[name].summary.log for name in ("dict", "Table")] == ["dict", "Table"]
    assert runs["index"].path == Path("DataFrame")


def test_the_samples_of_a_run_are_a_record_and_its_file_is_the_same_run(
    run: Run, tmp_path: Path
) -> None:
    again = yawid.replay(run.samples, also="none")
    compared = yawid.diff(run, run.mcap(tmp_path))

    np.testing.assert_allclose(again.samples.r, run.samples.r, atol=1e-12)
    assert again.flight.dutch_roll == run.flight.dutch_roll
    assert compared.judged > 0
    assert compared.a.endswith("/dict")
    assert {each.difference for each in compared.numbers} == {0.0}


def test_a_ground_speed_is_not_called_an_airspeed() -> None:
    data = record()
    data["ground_speed"] = data.pop("airspeed [m/s EAS]")
    found = yawid.replay(data, **SAID, manoeuvres="off").samples

    assert np.isnan(found.airspeed).all()
    assert {*found.ground_speed} == {20.0}
    assert {*found.airspeed_kind} == {"ground"}


def test_each_option_is_a_keyword_with_a_type() -> None:
    keywords = inspect.signature(yawid.replay).parameters
    options = {field.name for field, _ in settings_declared()}

    assert options | {"log", "config", "signing_key_file"} == keywords.keys()
    for name in options:
        assert keywords[name].kind is inspect.Parameter.KEYWORD_ONLY
        assert keywords[name].annotation not in (Any, inspect.Parameter.empty), name
    with pytest.raises(TypeError, match="keyword argument 'rates'"):
        yawid.replay(record(), rates=10)  # type: ignore[call-arg]  # the mistake


@pytest.mark.parametrize(
    ("left_out", "given", "said", "but_not"),
    [
        ("", {"rudder_is": "held"}, "rudder_is must be one of", "--"),
        ("", {"rate": "10"}, "yawid.replay: rate must lie in 0.1 to 1000 Hz, got '10'", "--"),
        ("", {"from_s": 5, "to_s": 3}, "from_s 5.0 must lie before to_s 3.0", "--from"),
        ("", {"columns": {"p": "P"}}, "columns p=P: no column is called P in the dict", "/tmp"),
        ("r [rad/s]", {}, "the dict: no column is r .*: name it by columns .r=COLUMN.", "--"),
    ],
)
def test_a_mistake_is_named_as_python_names_it(
    left_out: str, given: dict[str, Any], said: str, but_not: str
) -> None:
    data = {name: column for name, column in record().items() if name != left_out}

    with pytest.raises(yawid.YawidError, match=said) as caught:
        yawid.replay(data, **SAID | given)
    assert but_not not in str(caught.value)


@pytest.mark.parametrize("wrong", [5, {"t": np.zeros((3, 2))}, {"t": [1.0], "r": [1.0, 2.0]}])
def test_what_is_no_table_is_refused(wrong: object) -> None:
    with pytest.raises(ConfigError, match=r"takes a path|is no table"):
        yawid.replay(wrong)


def test_an_answer_is_a_value_that_says_whether_it_is_one(run: Run) -> None:
    quiet = record()
    quiet["rudder"] = np.zeros(2400)
    still = yawid.replay(quiet, **SAID)

    assert run.usable
    assert run.flight
    assert run.flight.used == [1, 2]
    assert not still.usable
    assert not still.flight
    assert still.flight.dutch_roll is None
    assert still.flight.verdict.why == "not_excited"
    assert not run.bare
    assert run.bare.verdict.next == 'Replay the log with lateral="auto".'


def test_where_no_manoeuvre_was_looked_for_there_are_numbers_of_the_stream_and_no_answer() -> None:
    stream = yawid.replay(record(), **SAID, manoeuvres="off", memory=math.inf)

    assert not stream.usable
    assert not stream.flight
    assert stream.summary.verdict is None
    assert stream.summary.dutch_roll is not None
    assert "not judged" in repr(stream)
    assert "NOT USABLE" not in repr(stream)


def test_the_manoeuvres_have_every_derivative_with_its_sigma(run: Run) -> None:
    answers = [each.answer for each in run.summary.manoeuvres or ()]
    assert len(run.manoeuvres) == len(answers) == 2

    for name, unit in (("a_my_beta", "1/s^2"), ("a_my_delta_h", "1/s^2 per half-travel")):
        values = [answer.physics[name] for answer in answers]
        assert run.manoeuvres[name].tolist() == [each.value for each in values]
        assert run.manoeuvres[f"{name}_std"].tolist() == [each.std for each in values]
        assert run.manoeuvres.units[name] == unit
