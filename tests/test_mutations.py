"""The seeded defects (tools/checks/defects.toml), the test that must notice each, and the draw."""

from __future__ import annotations

import ast
from collections import Counter
from itertools import islice, product
from pathlib import Path

import mutate
import pytest
from mutate import DEFECTS, GROUPS, KINDS, ROOT, catches, copied, drawn, misplaced, mutants


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copied(tmp_path_factory.mktemp("mutations") / "tree")


def test_each_defect_stands_exactly_once_where_it_should():
    assert misplaced(DEFECTS) == []


@pytest.mark.long
@pytest.mark.parametrize("plain", [False, True])
def test_without_a_defect_every_test_that_hunts_one_passes(tree: Path, plain: bool):
    tests = {each["test"] for each in DEFECTS if each["file"].startswith(mutate.PLAIN) == plain}
    code, said = mutate.run(tree, *sorted(tests), plain=plain, within_s=300.0 * len(tests))
    assert code == 0, said


@pytest.mark.long
@pytest.mark.parametrize("defect", DEFECTS, ids=lambda defect: defect["what"])
def test_a_seeded_defect_is_caught(tree: Path, defect: dict[str, str]):
    assert catches(tree, defect)


SOURCE = '''"""Not 1 of these 2.5 numbers."""
__all__ = ["f"]
LIMIT: Annotated[float, 3, "µ"] = 2.5


def f(x: "Literal[3]", n: int = 1) -> float:
    """As 4.0 here."""
    assert n > 5
    y = x - 40
    if y > n:
        raise ValueError("a" + "b")
    y += len(__all__)
    return f"{y + 6}"
'''


def test_a_mutant_changes_a_number_a_sign_a_comparison_or_a_statement_and_no_text():
    lines, found = SOURCE.splitlines(), []
    for mutant in mutants(SOURCE.encode()):
        now = mutant.seeded(SOURCE.encode()).decode().splitlines()
        at = next(i for i, line in enumerate(now) if line != lines[i])
        assert now[:at] + now[at + 1 :] == lines[:at] + lines[len(lines) - len(now) + at + 1 :]
        assert at + 1 in mutant.lines
        found.append((mutant.kind, now[at].strip()))

    assert sorted(found) == sorted([
        ("constant", 'LIMIT: Annotated[float, 3, "µ"] = 2.75'),
        ("off by one", """def f(x: "Literal[3]", n: int = 0) -> float:"""),
        ("off by one", """def f(x: "Literal[3]", n: int = 2) -> float:"""),
        ("constant", "y = x - 44"),
        ("sign", "y = x + 40"),
        ("comparison", "if y <= n:"),
        ("comparison", "if y >= n:"),
        *[("statement", "pass")] * 3,
        ("sign", "y -= len(__all__)"),
    ])  # fmt: skip


def test_a_draw_is_the_same_for_a_seed_and_each_room_and_kind_has_its_share(
    monkeypatch: pytest.MonkeyPatch,
):
    package = ROOT / "src/yawid"
    assert all((package / room).is_dir() for group in GROUPS for room in group.split(", "))
    some = ("physics", "models, damper")
    monkeypatch.setattr(mutate, "GROUPS", some)
    found, same, other = (list(islice(drawn(package, seed), 100)) for seed in (1, 1, 2))

    assert found == same != other
    assert len({(each.file, each.start, each.new) for each in found}) == 100
    assert Counter((each.group, each.kind) for each in found) == dict.fromkeys(
        product(some, KINDS), 10
    )
    for each in found[:10]:
        source = (package / each.file).read_bytes()
        assert ast.dump(ast.parse(each.seeded(source))) != ast.dump(ast.parse(source)), each
