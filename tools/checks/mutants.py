"""Mutants of src/yawid, drawn at random: what they change, and in which order they come.

A mutant changes one thing: a number (a float, or an integer from 20 on, times 1.1; a smaller
integer, which is an index or a size, by one), a sign, a comparison (its limit, or inverted), or it
drops a statement. Texts, annotations and assertions stay as they are, and so do the signs of a sum
in which a text is written. A statement that binds a name is not dropped (but one with += is), nor
one that returns or defines: any test that reaches what follows could end in a NameError, which
shows nothing.
"""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator
from itertools import accumulate, product, zip_longest
from pathlib import Path
from typing import Any, NamedTuple

GROUPS = (
    "estimation", "physics", "manoeuvre, results", "lateral", "channels", "sources",
    "models, damper", "sinks, report",
)  # fmt: skip
"""Rooms that share the mutants equally."""
KINDS = ("constant", "off by one", "sign", "comparison", "statement")
SMALL = 20
"""An integer from here on is a quantity; times 1.1 it is another integer."""
_OTHER: dict[type, tuple[Any, ...]] = {
    ast.Lt: (ast.GtE, ast.LtE), ast.LtE: (ast.Gt, ast.Lt), ast.Gt: (ast.LtE, ast.GtE),
    ast.GtE: (ast.Lt, ast.Gt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
    ast.USub: (ast.UAdd,), ast.Add: (ast.Sub,), ast.Sub: (ast.Add,),
}  # fmt: skip
"""What an operator becomes; a comparison the inverted one, and that with the other limit."""
_DROPPED = (
    ast.Expr, ast.AugAssign, ast.Raise, ast.Continue, ast.Break, ast.If, ast.Assign, ast.Delete,
)  # fmt: skip


class Mutant(NamedTuple):
    """The bytes ``where`` of ``file`` (below src/yawid) become ``new``."""

    group: str
    file: str
    kind: str
    lines: range
    """The lines of the statement, of a compound one those of its head."""
    where: slice
    new: str

    def seeded(self, source: bytes) -> bytes:
        """Return the file's source with the mutant."""
        return source[: self.where.start] + self.new.encode() + source[self.where.stop :]


def mutants(source: bytes, group: str = "", file: str = "") -> Iterator[Mutant]:
    """Yield every mutant of a module."""
    starts = [0, *accumulate(map(len, source.splitlines(keepends=True)))]
    for kind, node, new, lines in _below(ast.parse(source), range(0)):
        where = slice(
            starts[node.lineno - 1] + node.col_offset,
            starts[node.end_lineno - 1] + node.end_col_offset,
        )
        yield Mutant(group, file, kind, lines, where, ast.unparse(new))


def _below(node: Any, lines: range) -> Iterator[tuple[str, Any, ast.AST, range]]:
    """Yield kind, node, what it becomes, and lines of all changes from a node downwards."""
    match node:
        case (
            ast.JoinedStr()
            | ast.Assert()
            | ast.Expr(value=ast.Constant())
            | ast.Constant(value=bool())
        ):
            return
    if isinstance(node, ast.stmt):
        body = getattr(node, "body", None)
        lines = range(node.lineno, body[0].lineno if body else (node.end_lineno or 0) + 1)
    yield from ((kind, node, new, lines) for kind, new in _changes(node))
    stays = getattr(node, "annotation", None), getattr(node, "returns", None)
    for each in ast.iter_child_nodes(node):
        if each not in stays:
            yield from _below(each, lines)


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield the kind of each change of a node, and what the node becomes."""
    match node:
        case ast.Constant(value=float(x)) if x:
            yield "constant", ast.Constant(float(f"{1.1 * x:.12g}"))
        case ast.Constant(value=int(n)) if n >= SMALL:
            yield "constant", ast.Constant(round(1.1 * n))
        case ast.Constant(value=int(n)):
            yield from (("off by one", ast.Constant(other)) for other in (n - 1, n + 1))
        case ast.UnaryOp(op=op) | ast.BinOp(op=op) | ast.AugAssign(op=op):
            others = () if {"'", '"'} & {*ast.unparse(node)} else _OTHER.get(type(op), ())
            yield from (("sign", type(node)(**vars(node) | {"op": other()})) for other in others)
        case ast.Compare(left, ops, compared):
            yield from (
                ("comparison", ast.Compare(left, [*ops[:i], other(), *ops[i + 1 :]], compared))
                for i, limit in enumerate(ops)
                for other in _OTHER[type(limit)]
            )
    if isinstance(node, _DROPPED) and not getattr(node, "orelse", []):
        contexts = (
            getattr(each, "ctx", None) for each in ast.walk(node) if isinstance(each, ast.Name)
        )
        if isinstance(node, ast.AugAssign) or not any(
            isinstance(each, ast.Store) for each in contexts
        ):
            yield "statement", ast.Pass()


def drawn(package: Path, seed: int) -> Iterator[Mutant]:
    """Yield all mutants of a package in random order, one of each kind and group in turn."""
    every = [
        mutant
        for group in GROUPS
        for room in group.split(", ")
        for path in sorted((package / room).rglob("*.py"))
        for mutant in mutants(path.read_bytes(), group, path.relative_to(package).as_posix())
    ]
    random.Random(seed).shuffle(every)
    cells = [
        [each for each in every if (each.kind, each.group) == cell]
        for cell in product(KINDS, GROUPS)
    ]
    for row in zip_longest(*cells):
        yield from filter(None, row)
