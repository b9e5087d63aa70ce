"""The limits of the room, counted from its code.

A limit is a number of a module against which something is compared. A constant that is only
calculated with is none; bounds of memory and of a search are.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from places import SRC

TREES = {
    path.stem: ast.parse(path.read_text(encoding="utf-8")) for path in SRC.glob("manoeuvre/*.py")
}
MOST_LIMITS = 40


def constants(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """The names of the numbers of a module, and the text below each"""
    for node, after in zip(tree.body, [*tree.body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        numbers = [each.value for each in ast.walk(node.value) if isinstance(each, ast.Constant)]
        if not any(isinstance(each, int | float) for each in numbers):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = {x.id for each in targets for x in ast.walk(each) if isinstance(x, ast.Name)}
        is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        text = str(after.value.value) if is_text else ""
        yield from ((each, text) for each in names if re.fullmatch("[A-Z][A-Z0-9_]*", each))


def limits() -> dict[tuple[str, str], str]:
    """The text of each limit by its module and name"""
    own = {(module, name): text for module, tree in TREES.items() for name, text in constants(tree)}
    compared = {
        name.id
        for tree in TREES.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.Compare)
        for name in ast.walk(node)
        if isinstance(name, ast.Name)
    }
    return {place: text for place, text in own.items() if place[1] in compared}


def test_the_limits_of_the_room_do_not_grow_and_each_says_what_it_is_for() -> None:
    found = limits()
    assert len(found) <= MOST_LIMITS
    assert [place for place, text in found.items() if not text] == []
