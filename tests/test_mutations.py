"""The seeded defects (tools/checks/defects.toml), and the test that must notice each."""

from __future__ import annotations

import pytest
from mutate import DEFECTS, Copy, Defect, misplaced


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    return Copy(tmp_path_factory.mktemp("mutations") / "tree")


def test_each_defect_stands_exactly_once_where_it_should():
    assert misplaced(DEFECTS) == []


@pytest.mark.long
def test_without_a_defect_every_test_that_hunts_one_passes(copy: Copy):
    code, told = copy.run_all(DEFECTS)
    assert code == 0, told


@pytest.mark.long
@pytest.mark.parametrize("defect", DEFECTS, ids=lambda defect: defect.what)
def test_a_seeded_defect_is_caught(copy: Copy, defect: Defect):
    assert copy.catches(defect)
