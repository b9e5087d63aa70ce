"""A golden test that cannot fail is worse than none: here it is made to fail."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from yawid.cli import main
from yawid.errors import ConfigError
from yawid.golden import compare_summaries, compare_tables, read_csv, tolerance_of
from yawid.regress import Case, check_case

CASES = Path(__file__).parents[1] / "replay_logs"
NAMES = sorted(path.parent.name for path in CASES.glob("*/case.toml"))


@pytest.mark.parametrize("name", NAMES)
def test_the_replay_matches_its_reference(name: str):
    assert check_case(Case.read(CASES / name)) == []


@pytest.mark.parametrize("name", NAMES)
def test_bending_any_column_by_ten_tolerances_is_noticed(name: str):
    columns, expected = read_csv(CASES / name / "expected.csv")
    row = len(expected) // 2
    for i, column in enumerate(columns):
        scale = np.sqrt(np.nanmean(expected[:, i] ** 2))
        tolerance = tolerance_of(column, {})
        step = 10.0 * tolerance * max(abs(expected[row, i]), scale) if tolerance else 1.0
        bent = expected.copy()
        bent[row, i] += step or 1.0
        if np.isnan(expected[row, i]):
            bent[row, i] = 0.0

        mismatches = compare_tables(columns, expected, columns, bent, {})

        assert [m.text.split(":")[0] for m in mismatches] == [column]


def test_equal_tables_match_and_nan_equals_nan():
    table = np.array([[1.0, 0.1, np.nan], [2.0, 0.2, 3.0]])

    assert compare_tables(["k", "t", "x"], table, ["k", "t", "x"], table.copy(), {}) == []


def test_a_missing_row_and_a_missing_column_are_mismatches():
    table = np.ones((3, 2))

    assert "rows" in compare_tables(["k", "t"], table, ["k", "t"], table[:2], {})[0].text
    assert "columns" in compare_tables(["k", "t"], table, ["k", "x"], table, {})[0].text


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


def test_counts_and_texts_of_the_summary_are_compared_exactly():
    reference = {"link": {"lost": 3}, "x": 1.0, "y_std": 1.0, "files": {"mcap": "a"}}
    close = {"link": {"lost": 3}, "x": 1.0 + 1e-8, "y_std": 1.0004, "files": {"mcap": "b"}}

    assert list(compare_summaries(reference, close)) == []
    assert list(compare_summaries(reference, close | {"link": {"lost": 4}}))
    assert list(compare_summaries(reference, close | {"x": 1.0001}))
    assert list(compare_summaries(reference, {"link": {"lost": 3}, "x": 1.0}))


@pytest.fixture
def case(tmp_path: Path) -> Path:
    folder = tmp_path / "cases" / "c172p"
    shutil.copytree(CASES / "c172p_gcs_rates", folder)
    return folder


def test_a_mismatch_is_exit_1_and_names_the_way_to_update(case: Path, capsys):
    lines = (case / "expected.csv").read_text().splitlines()
    lines[-1] = lines[-1].replace("0", "9", 1)
    (case / "expected.csv").write_text("\n".join(lines) + "\n")

    code = main(["regress", "--folder", str(case.parent)])

    said = capsys.readouterr().out
    assert code == 1
    assert "FAILED" in said
    assert "--update --why" in said
    assert (case / "actual.csv").exists()


def test_another_log_than_the_cases_own_is_noticed(case: Path):
    data = (case / "log.tlog").read_bytes()
    (case / "log.tlog").write_bytes(data + b"\0")

    assert any("sha256" in line for line in check_case(Case.read(case)))


def test_too_few_updates_are_a_failure(case: Path):
    text = (case / "case.toml").read_text()
    (case / "case.toml").write_text(text.replace("floor = 500", "floor = 50000"))

    assert any("floor" in line for line in check_case(Case.read(case)))


def test_an_update_wants_a_reason_and_records_it(case: Path, capsys):
    assert main(["regress", "--update", "--folder", str(case.parent)]) == 2
    (case / "expected.csv").unlink()
    assert main(["regress", "--folder", str(case.parent)]) == 1

    code = main(["regress", "--update", "--why", 'said "so"', "--folder", str(case.parent)])

    assert code == 0
    assert 'why = "said \\"so\\""' in (case / "case.toml").read_text()
    assert main(["regress", str(case)]) == 0
    json.loads((case / "expected.json").read_text())


def test_no_case_at_all_is_a_usage_error(tmp_path: Path):
    assert main(["regress", "--folder", str(tmp_path)]) == 2
    assert main(["regress", "nosuch", "--folder", str(tmp_path)]) == 2
