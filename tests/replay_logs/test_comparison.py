"""A golden test that cannot fail is worse than none: here it is made to fail."""

from __future__ import annotations

import json
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
    read_csv,
    split_tolerances,
    tolerance_of,
)
from places import REPLAY_LOGS as CASES

from yawid.errors import ConfigError

TEN = 10.0


KINDS = ("c172p_3211", "sitl_fbwa_50hz", "turns_calm", "no_rudder")
"""A stream, a flight with its bare airframe, ordinary flight, and a refusal."""


@pytest.mark.parametrize("name", KINDS)
def test_bending_any_column_by_ten_tolerances_is_noticed(name: str):
    columns, expected = read_csv(CASES / name / "expected.csv")
    row = len(expected) // 2
    for i, column in enumerate(columns):
        known = expected[np.isfinite(expected[:, i]), i]  # none where nothing was estimated
        scale = np.sqrt(np.mean(known**2)) if len(known) else 0.0
        step = TEN * tolerance_of(column, {}) * max(abs(expected[row, i]), scale)
        bent = expected.copy()
        bent[row, i] = np.nan_to_num(expected[row, i] + (step or 1.0))

        assert [m.column for m in compare_tables(columns, expected, columns, bent, {})] == [column]


@pytest.mark.parametrize("name", KINDS)
def test_bending_any_value_of_the_summary_or_the_flight_is_noticed(name: str):
    reference = {
        of: json.loads((CASES / name / f"{file}.json").read_text(encoding="utf-8"))
        for of, file in (("stream", "expected"), ("flown", "flight"))
    }
    assert list(compare_summaries(reference, reference)) == []

    names: list[str] = []
    differing = list(compare_summaries(reference, bent(reference, (), names)))
    assert len(names) > 10
    assert sorted(each.partition(":")[0] for each in differing) == sorted(names)


def bent(value: Any, keys: tuple[str, ...], names: list[str]) -> Any:
    """The value with each of its leaves bent, by ten tolerances where it is a float.

    Their names are appended to ``names``.
    """
    if isinstance(value, list):
        return [bent(each, (*keys[:-1], f"{keys[-1]}[{i}]"), names) for i, each in enumerate(value)]
    if isinstance(value, dict):
        kept = {key: each for key, each in value.items() if key in NOT_COMPARED}
        return {key: bent(value[key], (*keys, key), names) for key in value.keys() - kept} | kept
    names.append(".".join(["summary", *keys]))
    return bend(value, keys)


def bend(value: Any, keys: tuple[str, ...]) -> Any:
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


KTX, TWO = ["k", "t", "x"], np.array([[1.0, 0.1, 3.0], [2.0, 0.2, 3.0]])
NANS, INFS = (np.array([[1.0, 0.1, value], [2.0, 0.2, 3.0]]) for value in (np.nan, np.inf))
BIG, ONES, WIDE = np.full((2, 3), 1e9), np.ones((2, 4)), {"x": 1.0}
MIDDLE, LAST = (1e-3 * np.array([[0, 0, 0], row]) for row in ([0, 1, 0], [0, 0, 1]))
EXACT = ("k", "t", "held", "els.status")
WORST = ONES + np.array([[0, 0, 1e-5, 0], [0, 0, 0, 1e-3]])


@pytest.mark.parametrize(
    ("columns", "expected", "actual", "tolerances", "said"),
    [
        (KTX, NANS, NANS.copy(), {}, []),
        *((KTX, TWO, bad, WIDE, ["x: 1 of 2 rows differ"]) for bad in (NANS, INFS)),
        *((KTX, bad, TWO, WIDE, ["x: 1 of 2 rows differ"]) for bad in (NANS, INFS)),
        (KTX, TWO, TWO[:1], {}, ["rows: expected 2, got 1"]),
        # Counts, times and status exactly, whatever their size.
        *((["k", "t", name], BIG, BIG + LAST, {}, [f"{name}: 1 of 2"]) for name in EXACT[2:]),
        (["t", "k", "x"], BIG, BIG + MIDDLE, {}, ["k: 1 of 2"]),
        (KTX, BIG, BIG + MIDDLE, {}, ["t: 1 of 2"]),
        # The worst column first, with its first k and t.
        (
            ["k", "t", "els.a1", "els.b1"], ONES, WORST, {},
            ["els.b1: 1 of 2 rows differ, by up to 1e+03 tolerances; first at k=1 t=1.000:",
             "els.a1: 1 of 2"],
        ),
    ],
)  # fmt: skip
def test_what_differs_in_a_table_is_said_the_worst_first(
    columns: list[str], expected: Any, actual: Any, tolerances: dict[str, float], said: list[str]
):
    found = [each.text for each in compare_tables(columns, expected, columns, actual, tolerances)]
    assert [text[: len(begin)] for text, begin in zip(found, said, strict=True)] == said


def test_other_columns_and_a_tolerance_for_none_are_noticed():
    [other] = compare_tables(["k", "t"], ONES, ["k", "x"], ONES, {})
    assert other.text.startswith("columns: expected ['k', 't'], got ['k', 'x']")
    with pytest.raises(ConfigError, match=r"els\.a9"):
        compare_tables(["k"], ONES[:, :1], ["k"], ONES[:, :1], {"els.a9": 1.0})
    with pytest.raises(ConfigError, match=r"els\.a9"):
        split_tolerances({"els.a9": 1.0}, ["els.a1"], {"link": {"lost": 3}})


REFERENCE = {
    "fit": {"x": 1.0, "y": 1.0}, "fitness": 1.0, "list": [{"z": 1.0}], "link": {"lost": 3},
    "y_std": 1.0, "files": {"mcap": "a"}, "K": {"std": 1.0, "std_noise": 1.0}, "usable": True,
}  # fmt: skip
CLOSE = REFERENCE | {
    "fitness": 1.0 + 1e-8, "y_std": 1.0004, "files": {"mcap": "b"},
    "K": {"std": 1.004, "std_noise": 1.0004},
}  # fmt: skip
BY_KEY = {"fit": 0.1, "list[0].z": 0.1}


@pytest.mark.parametrize(
    ("changes", "tolerances", "differing"),
    [
        ({}, {}, []),
        ({"link": {"lost": 4}}, {}, ["link.lost"]),
        ({"fitness": 1.0001}, {}, ["fitness"]),
        ({"K": None}, {}, ["K"]),
        ({"usable": 1}, {}, ["usable"]),
        ({"K": {"std": 1.02, "std_noise": 1.0}}, {}, ["K.std"]),
        ({"K": {"std": 1.0, "std_noise": 1.004}}, {}, ["K.std_noise"]),
        # A tolerance widens its key and all below, and nothing else.
        ({}, {"K": 1e-3}, []),
        ({}, {"K": 1e-3, "K.std": 1e-3}, ["K.std"]),
        ({"fit": {"x": 1.05, "y": 1.0}, "list": [{"z": 0.95}]}, BY_KEY, []),
        ({"fitness": 1.05}, BY_KEY, ["fitness"]),
        ({"fit": {"x": 1.2, "y": 1.0}}, BY_KEY, ["fit.x"]),
    ],
)
def test_counts_and_texts_of_the_summary_are_compared_exactly_and_numbers_by_their_tolerance(
    changes: dict[str, Any], tolerances: dict[str, float], differing: list[str]
):
    by_column, by_key = split_tolerances(tolerances | {"els.a1": 0.1}, ["k", "els.a1"], REFERENCE)
    assert by_column == {"els.a1": 0.1}
    found = compare_summaries(REFERENCE, CLOSE | changes, by_key)
    assert [text.partition(":")[0] for text in found] == [f"summary.{name}" for name in differing]
