"""The cases of replay_logs/, or of ``--cases DIR``, give the answers that they must give.

``--update-cases WHY`` writes the references again, and the reason into each case.toml.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from log_cases import Case, check, update


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    folder = Path(metafunc.config.getoption("--cases"))
    found = sorted(path.parent for path in folder.glob("*/case.toml"))
    assert found, f"{folder} holds no case: a case is a folder with a log and a case.toml"
    metafunc.parametrize("folder", found, ids=[path.name for path in found])


def test_the_replay_matches_its_references(folder: Path, request: pytest.FixtureRequest) -> None:
    case = Case.read(folder)
    if (why := request.config.getoption("--update-cases")) is not None:
        update(case, why)
        return
    wrong = check(case)
    where = f"\nexpected and actual are in {folder}/actual.svg, the rows in actual.csv"
    assert not wrong, "\n".join(wrong) + where
