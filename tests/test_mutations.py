"""The seeded defects (tools/checks/defects.toml), the test that must notice each, and the draw."""

from __future__ import annotations

import ast
from collections import Counter
from itertools import islice

import pytest
from checks import mutants
from checks.mutants import GROUPS, KINDS, Mutant, drawn, sites
from mutate import DEFECTS, ROOT, Copy, Defect, misplaced


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    return Copy(tmp_path_factory.mktemp("mutations") / "tree")


def test_each_defect_stands_exactly_once_where_it_should():
    assert misplaced(DEFECTS) == []


@pytest.mark.long
@pytest.mark.parametrize("plain", [False, True])
def test_without_a_defect_every_test_that_hunts_one_passes(copy: Copy, plain: bool):
    tests = {defect.test for defect in DEFECTS if defect.plain == plain}
    code, told = copy.run(*sorted(tests), plain=plain)
    assert code == 0, told


@pytest.mark.long
@pytest.mark.parametrize("defect", DEFECTS, ids=lambda defect: defect.what)
def test_a_seeded_defect_is_caught(copy: Copy, defect: Defect):
    assert copy.catches(defect)


SOURCE = '''"""Not 1 of these 2.5 numbers."""
__all__ = ["f"]
LIMIT: Annotated[float, 3] = 2.5


def f(x: "Literal[3]", n: int = 1) -> float:
    """As 4.0 here."""
    assert n > 5
    y = x - 40
    if y > n:
        y = y + len("a" + "b")
    return f"{y + 6}"
'''


def test_a_mutant_changes_a_number_a_sign_a_comparison_or_a_statement_and_no_text():
    lines = ast.unparse(ast.parse(SOURCE)).splitlines()
    found = []
    for number, site in enumerate(sites(ast.parse(SOURCE))):
        for other in range(len(site.others)):
            mutant = Mutant("", site.kind, "", number, other, site.lines, site.on_import)
            now = mutant.seeded(SOURCE).splitlines()
            [at, *_] = [
                i for i, pair in enumerate(zip(lines, now, strict=False)) if len({*pair}) > 1
            ]
            found.append((site.kind, now[at].strip(), site.on_import))

    assert sorted(found) == sorted([
        ("constant", "LIMIT: Annotated[float, 3] = 2.75", True),
        ("off by one", "def f(x: 'Literal[3]', n: int=0) -> float:", True),
        ("off by one", "def f(x: 'Literal[3]', n: int=2) -> float:", True),
        ("constant", "y = x - 44", False),
        ("sign", "y = x + 40", False),
        ("comparison", "if y <= n:", False),
        ("comparison", "if y >= n:", False),
        *[("statement", "pass", False)] * 2,
        ("sign", "y = y - len('a' + 'b')", False),
    ])  # fmt: skip


def test_a_draw_is_the_same_for_a_seed_and_each_room_and_kind_has_its_share(
    monkeypatch: pytest.MonkeyPatch,
):
    package = ROOT / "src/yawid"
    assert all((package / room).is_dir() for rooms in GROUPS.values() for room in rooms)
    some = {name: GROUPS[name] for name in ("physics", "models, damper")}
    monkeypatch.setattr(mutants, "GROUPS", some)
    found, same, other = (list(islice(drawn(package, seed), 100)) for seed in (1, 1, 2))

    assert found == same != other
    assert len(set(found)) == 100
    assert Counter(each.group for each in found) == dict.fromkeys(some, 50)
    assert min(Counter(each.kind for each in found)[kind] for kind in KINDS) >= 10
    for each in found[:10]:
        source = (package / each.file).read_text(encoding="utf-8")
        changed = ast.dump(ast.parse(each.seeded(source)))
        assert changed != ast.dump(ast.parse(source)), each
