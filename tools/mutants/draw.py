"""Draws small mutants of src/yawid by its syntax trees.

A mutant changes one thing: a number (a float, or an integer from 20 on, times 1.1; a smaller
integer, which is an index or a size, by one), a sign, a comparison (its limit, or inverted), or it
drops a statement. Texts, docstrings, annotations, assertions and ``__all__`` stay as they are. A
statement that binds a new name is not dropped, nor one that returns or defines: any test that
reaches what follows would end in a NameError, which shows nothing.
"""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

GROUPS = {
    "estimation": ("estimation",),
    "physics": ("physics",),
    "manoeuvre, results": ("manoeuvre", "results"),
    "lateral": ("lateral",),
    "channels": ("channels",),
    "sources": ("sources",),
    "models, damper": ("models", "damper"),
    "sinks, report": ("sinks", "report"),
}
"""Rooms that share the mutants equally, by their name in the table."""
KINDS = ("constant", "off by one", "sign", "comparison", "statement")
SMALL = 20
"""An integer from here on is a quantity; times 1.1 it is another integer."""
_LIMIT = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
_INVERTED = {
    ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
_TEXTS = (ast.JoinedStr, ast.List, ast.Tuple, ast.Set, ast.Dict)
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


@dataclass(frozen=True, slots=True)
class Mutant:
    """The text from ``start`` to ``end`` (bytes of ``file``, below src/yawid) becomes ``new``."""

    group: str
    kind: str
    file: str
    start: int
    end: int
    new: str
    lines: tuple[int, int]
    """First and last line of the statement, of a compound one of its head."""
    name: str
    """What runs on import gives this name a value; "" in a function."""

    def seeded(self, source: bytes) -> bytes:
        """Return the file's text with the mutant."""
        return source[: self.start] + self.new.encode() + source[self.end :]

    def __str__(self) -> str:
        return f"{self.kind}: {self.file}:{self.lines[0]}"


class _Sites:
    """Finds what can be changed in one file, as (kind, start, end, texts to choose from)."""

    def __init__(self, source: bytes) -> None:
        self.source = source
        self.tree = ast.parse(source)
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))

    def at(self, line: int, column: int) -> int:
        return self.starts[line - 1] + column

    def span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        end = self.at(node.end_lineno, node.end_col_offset)
        return self.at(node.lineno, node.col_offset), end

    def between(self, left: ast.expr, right: ast.expr, old: str) -> tuple[int, int] | None:
        """Return where an operator stands; None where a bracket or a comment is in the way."""
        start, end = self.span(left)[1], self.span(right)[0]
        text = self.source[start:end]
        at = text.find(old.encode())
        is_sound = text.count(old.encode()) == 1 and b"#" not in text
        return (start + at, start + at + len(old)) if is_sound else None

    def of(self, node: ast.AST, bound: set[str]) -> Iterator[tuple[str, int, int, list[str]]]:
        """Yield the sites of one node itself; ``bound`` has the names that its function knows."""
        if isinstance(node, ast.Constant):
            if other := _other(node.value):
                yield other[0], *self.span(node), other[1]
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            start, _ = self.span(node)
            yield "sign", start, start + 1, [" "]
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            old, new = ("+", "-") if isinstance(node.op, ast.Add) else ("-", "+")
            where = self.between(node.left, node.right, old)
            if where and not any(_is_text(each) for each in (node.left, node.right)):
                yield "sign", *where, [new]
        elif isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add | ast.Sub):
            old, new = ("+", "-") if isinstance(node.op, ast.Add) else ("-", "+")
            where = self.between(node.target, node.value, old)
            if where and not _is_text(node.value):
                yield "sign", *where, [new]
        elif isinstance(node, ast.Compare):
            operands = [node.left, *node.comparators]
            for left, op, right in zip(operands, node.ops, node.comparators, strict=False):
                start, end = self.span(left)[1], self.span(right)[0]
                text = self.source[start:end]
                if not text.strip(b" \nisnotin<>=!"):
                    signs = {_INVERTED[type(op)], _LIMIT.get(type(op), _INVERTED[type(op)])}
                    yield "comparison", start, end, [f" {each} " for each in sorted(signs)]
        if isinstance(node, ast.stmt) and _can_go(node, bound):
            start, end = self.span(node)
            yield "statement", start, end, ["pass"]


def _other(value: object) -> tuple[str, list[str]] | None:
    """Return the kind of change of a number and what it may become; None of another constant."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if isinstance(value, float):
        return ("constant", [repr(float(f"{value * 1.1:.12g}"))]) if value else None
    if value < SMALL:
        return "off by one", [f"({value - 1})", str(value + 1)]
    return "constant", [str(round(value * 1.1))]


def _is_text(node: ast.expr) -> bool:
    """Return whether an operand of + is a text or a list, which has no other sign."""
    if isinstance(node, ast.BinOp):
        return _is_text(node.left) or _is_text(node.right)
    is_text = isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    return is_text or isinstance(node, _TEXTS)


def _can_go(node: ast.stmt, bound: set[str]) -> bool:
    """Return whether a statement can be dropped and what follows still knows its names."""
    match node:
        case ast.Expr(value=ast.Constant()):
            return False
        case ast.Expr() | ast.AugAssign() | ast.Raise() | ast.Continue() | ast.Break():
            return True
        case ast.If(orelse=[]):
            return not _stored(node) - bound
        case ast.Assign() | ast.Delete():
            return not _stored(node) - bound
    return False


def _stored(node: ast.AST) -> set[str]:
    return {
        each.id
        for each in ast.walk(node)
        if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
    }


def _kept(node: ast.AST) -> list[ast.AST]:
    """Return the parts of a node that may be changed."""
    parts = list(ast.iter_child_nodes(node))
    match node:
        case ast.AnnAssign():
            parts.remove(node.annotation)
        case ast.arg():
            parts = []
        case ast.FunctionDef() if node.returns:
            parts.remove(node.returns)
        case ast.JoinedStr() | ast.Assert() | ast.Import() | ast.ImportFrom():
            parts = []
        case ast.If(test=ast.Compare(left=ast.Name(id="__name__"))):
            parts = []
        case ast.Assign(targets=[ast.Name(id="__all__")]):
            parts = []
    return parts


def names(node: ast.stmt) -> list[str]:
    """Return the names that a statement of a module gives a value."""
    match node:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return [name]
        case ast.Assign() | ast.AnnAssign():
            return sorted(_stored(node))
    return []


def of_file(group: str, root: Path, path: Path) -> list[tuple[Mutant, list[str]]]:
    """Return every site of a file, as a mutant without its new text and the texts it may get."""
    sites = _Sites(path.read_bytes())
    found: list[tuple[Mutant, list[str]]] = []
    file = path.relative_to(root).as_posix()

    def visit(node: ast.AST, statement: ast.stmt, name: str, bound: set[str]) -> None:
        for each in _kept(node):
            inner, own, known = statement, name, bound
            if isinstance(each, ast.stmt):
                inner = each
                head = isinstance(node, _FUNCTIONS)
                own = "" if head or not name else name
            if isinstance(node, ast.Lambda):
                own = ""
            if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef):
                known = {part.arg for part in ast.walk(each.args) if isinstance(part, ast.arg)}
            body = getattr(inner, "body", None)
            last = body[0].lineno - 1 if isinstance(body, list) else inner.end_lineno
            lines = inner.lineno, max(last or 0, inner.lineno)
            for kind, start, end, new in sites.of(each, known):
                found.append((Mutant(group, kind, file, start, end, "", lines, own), new))
            visit(each, inner, own, known)
            if isinstance(each, ast.stmt) and not isinstance(each, ast.FunctionDef | ast.ClassDef):
                bound |= _stored(each)

    for each in sites.tree.body:
        target = (names(each) or ["?"])[0]
        if not (isinstance(each, ast.Assign) and target == "__all__"):
            module = ast.Module(body=[each], type_ignores=[])
            visit(module, each, target, set())
    return found


def drawn(root: Path, seed: int) -> Iterator[Mutant]:
    """Yield mutants of the package ``root`` in random order, one of each group in turn.

    Of a group's mutants, each kind is drawn as often as the others.
    """
    chance = random.Random(seed)
    left: dict[str, dict[str, list[tuple[Mutant, list[str]]]]] = {}
    for group, rooms in GROUPS.items():
        paths = [path for room in rooms for path in sorted((root / room).rglob("*.py"))]
        sites = [site for path in paths for site in of_file(group, root, path)]
        left[group] = {kind: [each for each in sites if each[0].kind == kind] for kind in KINDS}
    while True:
        for group in GROUPS:
            kinds = [kind for kind in KINDS if left[group][kind]]
            if not kinds:
                return
            sites = left[group][chance.choice(kinds)]
            mutant, new = sites.pop(chance.randrange(len(sites)))
            fields = {each: getattr(mutant, each) for each in Mutant.__slots__}
            yield Mutant(**fields | {"new": chance.choice(new)})
