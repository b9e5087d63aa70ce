"""A golden test that cannot fail is worse than none: here it is made to fail."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from case_compare import (
    NOT_COMPARED,
    SPREAD_TOLERANCE,
    TOTAL_TOLERANCE,
    VALUE_TOLERANCE,
    compare_summaries,
    compare_tables,
    split_tolerances,
    tolerance_of,
)
from case_table import read_csv
from gate import one_in
from places import REPLAY_LOGS as CASES

from yawid.errors import ConfigError

NAMES = sorted(path.parent.name for path in CASES.glob("*/case.toml"))
TEN = 10.0


def test_there_are_cases_of_every_kind_and_none_is_large():
    sizes = [(CASES / name / "log.tlog").stat().st_size for name in NAMES]

    assert len(NAMES) >= 21
    assert max(sizes) < 1_000_000
    assert sum(sizes) < 10_000_000


@pytest.mark.parametrize("name", NAMES)
def test_bending_any_column_by_ten_tolerances_is_noticed(name: str):
    columns, expected = read_csv(CASES / name / "expected.csv")
    row = len(expected) // 2
    for i, column in enumerate(columns):
        known = expected[np.isfinite(expected[:, i]), i]  # none where nothing was estimated
        scale = np.sqrt(np.mean(known**2)) if len(known) else 0.0
        step = TEN * tolerance_of(column, {}) * max(abs(expected[row, i]), scale)
        bent = expected.copy()
        bent[row, i] += step or 1.0
        if np.isnan(expected[row, i]):
            bent[row, i] = 0.0

        mismatches = compare_tables(columns, expected, columns, bent, {})

        assert [m.column for m in mismatches] == [column]


@pytest.mark.parametrize("name", one_in(3, NAMES))
def test_bending_any_value_of_the_summary_by_ten_tolerances_is_noticed(name: str):
    reference = json.loads((CASES / name / "expected.json").read_text(encoding="utf-8"))
    assert list(compare_summaries(reference, reference)) == []

    count = 0
    for path, bent in bent_summaries(reference):
        differing = list(compare_summaries(reference, bent))
        assert len(differing) == 1, path
        assert path in differing[0]
        count += 1

    assert count > 10


@pytest.mark.parametrize("name", ["c172p_gcs_rates", "sitl_fbwa_50hz"])
def test_bending_any_value_of_the_flight_is_noticed(name: str):
    flown = json.loads((CASES / name / "flight.json").read_text(encoding="utf-8"))
    assert list(compare_summaries({"flown": flown}, {"flown": flown})) == []

    for path, bent in bent_summaries(flown):
        assert len(list(compare_summaries({"flown": flown}, {"flown": bent}))) == 1, path


def bent_summaries(reference: Any) -> Iterator[tuple[str, Any]]:
    """Yield the reference with one leaf bent, by ten of its tolerances where it is a float.

    Of a list's elements a key is bent in the last that has it.
    """
    bent = copy.deepcopy(reference)
    by_key = {tuple(k for k in keys if isinstance(k, str)): keys for keys in leaves(reference)}
    for keys in by_key.values():
        holder = bent
        for key in keys[:-1]:
            holder = holder[key]
        straight = holder[keys[-1]]
        holder[keys[-1]] = bend(straight, keys)
        yield str(keys[-1]), bent
        holder[keys[-1]] = straight


def leaves(value: Any, keys: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    for key, entry in pairs:
        if key in NOT_COMPARED:
            continue
        if isinstance(entry, dict | list):
            yield from leaves(entry, (*keys, key))
        else:
            yield (*keys, key)


def bend(value: Any, keys: tuple[Any, ...]) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + "?"
    if isinstance(value, int):
        return value + 1
    if {"bare", "lateral"} & set(keys):
        return value + abs(value) + 1.0
    spread = any("std" in str(key) for key in keys) or keys[-1] == "whiteness_p"
    tolerance = SPREAD_TOLERANCE if spread else VALUE_TOLERANCE
    tolerance = TOTAL_TOLERANCE if keys[-1] in ("wn_std", "zeta_std", "std") else tolerance
    return value + TEN * tolerance * (1.0 if keys[-1] == "whiteness_p" else abs(value) or 1.0)


def test_equal_tables_match_and_nan_equals_nan():
    table = np.array([[1.0, 0.1, np.nan], [2.0, 0.2, 3.0]])

    assert compare_tables(["k", "t", "x"], table, ["k", "t", "x"], table.copy(), {}) == []


def test_a_value_that_became_nan_and_one_that_became_infinite_differ():
    columns, table = ["k", "t", "x"], np.array([[1.0, 0.1, 3.0], [2.0, 0.2, 3.0]])
    for value in (np.nan, np.inf):
        changed = table.copy()
        changed[1, 2] = value

        assert compare_tables(columns, table, columns, changed, {"x": 1.0})
        assert compare_tables(columns, changed, columns, table, {"x": 1.0})


def test_a_missing_row_and_a_missing_column_are_mismatches():
    table = np.ones((3, 2))

    assert "rows" in compare_tables(["k", "t"], table, ["k", "t"], table[:2], {})[0].text
    assert "columns" in compare_tables(["k", "t"], table, ["k", "x"], table, {})[0].text


def test_counts_times_and_status_are_compared_exactly_whatever_their_size():
    for column in ("k", "t", "held", "els.status"):
        table = np.full((2, 3), 1e9)
        changed = table.copy()
        changed[1, 2] += 1e-3

        assert compare_tables(["k", "t", column], table, ["k", "t", column], changed, {})


def test_the_worst_column_comes_first_with_its_first_k_and_t():
    columns = ["k", "t", "els.a1", "els.b1"]
    expected = np.array([[1.0, 0.1, 1.0, 1.0], [2.0, 0.2, 1.0, 1.0]])
    actual = expected + np.array([[0, 0, 1e-5, 0], [0, 0, 0, 1e-3]])

    first, second = compare_tables(columns, expected, columns, actual, {})

    assert first.text.startswith("els.b1: 1 of 2 rows differ")
    assert "k=2 t=0.200" in first.text
    assert second.text.startswith("els.a1")


def test_a_tolerance_for_no_such_column_is_an_error():
    with pytest.raises(ConfigError, match=r"els\.a9"):
        compare_tables(["k"], np.ones((1, 1)), ["k"], np.ones((1, 1)), {"els.a9": 1.0})
    with pytest.raises(ConfigError, match=r"els\.a9"):
        split_tolerances({"els.a9": 1.0}, ["els.a1"], {"link": {"lost": 3}})


def test_a_tolerance_widens_its_column_or_its_key_and_all_below_and_nothing_else():
    reference = {"fit": {"x": 1.0, "y": 1.0}, "fitness": 1.0, "list": [{"z": 1.0}]}
    given = {"els.a1": 0.1, "fit": 0.1, "list[0].z": 0.1}

    by_column, by_key = split_tolerances(given, ["k", "els.a1"], reference)

    assert by_column == {"els.a1": 0.1}
    close = {"fit": {"x": 1.05, "y": 1.0}, "fitness": 1.0, "list": [{"z": 0.95}]}
    assert list(compare_summaries(reference, close, by_key)) == []
    assert list(compare_summaries(reference, close | {"fitness": 1.05}, by_key))
    assert list(compare_summaries(reference, close | {"fit": {"x": 1.2, "y": 1.0}}, by_key))


def test_counts_and_texts_of_the_summary_are_compared_exactly():
    reference = {"link": {"lost": 3}, "x": 1.0, "y_std": 1.0, "files": {"mcap": "a"}}
    close = {"link": {"lost": 3}, "x": 1.0 + 1e-8, "y_std": 1.0004, "files": {"mcap": "b"}}
    reference["K"], close["K"] = {"std": 1.0, "std_noise": 1.0}, {"std": 1.004, "std_noise": 1.0004}

    assert list(compare_summaries(reference, close)) == []
    assert list(compare_summaries(reference, close | {"link": {"lost": 4}}))
    assert list(compare_summaries(reference, close | {"x": 1.0001}))
    assert list(compare_summaries(reference, {"link": {"lost": 3}, "x": 1.0}))
    for sigmas in ({"std": 1.02}, {"std_noise": 1.004}):
        assert list(compare_summaries(reference, close | {"K": close["K"] | sigmas}))
    assert list(compare_summaries(reference, close, {"K": 1e-3})) == []
    assert list(compare_summaries(reference, close, {"K": 1e-3, "K.std": 1e-3}))
    assert list(compare_summaries({"usable": True}, {"usable": 1}))


def test_another_number_of_manoeuvres_is_told_in_a_line():
    reference = json.loads(
        (CASES / "c172p_three_speeds" / "expected.json").read_text(encoding="utf-8")
    )
    fewer = reference | {"manoeuvres": reference["manoeuvres"][:-1]}

    (text,) = compare_summaries(reference, fewer)
    assert text.startswith("summary.manoeuvres: expected 12 in [{'n': 1, ")
    assert "got 11 in [" in text
    assert len(text) < 800


def test_a_flight_that_is_no_longer_there_is_told():
    reference = json.loads(
        (CASES / "sitl_fbwa_manoeuvres" / "expected.json").read_text(encoding="utf-8")
    )
    without = {key: value for key, value in reference.items() if key != "flight"}

    assert list(compare_summaries(reference, without)) == ["summary.flight: only in the reference"]
