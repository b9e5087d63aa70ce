"""The flow goes one way: each room names the rooms that it may import, and they form no circle."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

from places import SRC

GROUND = ("version", "errors", "blocks", "system", "quantities", "answers")
"""What any room may import, each of the six only what stands before it: the version, errors, arrays
that travel, what differs between operating systems, names and units, answers that travel."""
WIRE, LOGS, LINK = "sources/mavlink", "sources/logs", "sources/link"
RECORDS = "sources/records"
SINKS = {"sinks", "sinks/mcap", "sinks/rerun", "sinks/terminal"}
MAY_IMPORT: dict[str, set[str]] = {
    "config": set(),
    "plant": set(),
    WIRE: set(),
    LOGS: {WIRE},
    RECORDS: {LOGS},
    "sources": {WIRE, LOGS, RECORDS},
    LINK: {WIRE, "sources"},
    "channels": {"config"},
    "estimation": {"config"},
    "physics": {"config"},
    "lateral": {"estimation"},
    "offline": {"config", "estimation", "physics"},
    "models": {"config", "lateral", "manoeuvre", "physics"},
    "damper": {"config", "models", "physics"},
    "results": {"config", "estimation", "physics"},
    "manoeuvre": {"config", "estimation", "lateral", "physics", "results"},
    "ordinary": {"lateral"},
    "sinks": {"estimation"},
    "sinks/mcap": {"config", "estimation", "sinks"},
    "sinks/rerun": {"physics", "sinks"},
    "sinks/terminal": {"results", "sinks"},
    "report": {"damper", "lateral", "manoeuvre", "models", "physics", "sinks", "sinks/mcap"},
    "pipeline": {"config", "channels", "estimation", "physics", "manoeuvre", "ordinary", "results"}
    | {"sinks"},
    "runs": {"config", "channels", "damper", "lateral", "offline", "pipeline", "plant", "results"}
    | {"sources", RECORDS, *SINKS},
    "runs/live": {"config", "estimation", "pipeline", "results", "runs", "sources", WIRE, LINK}
    | {"sinks", "sinks/rerun", "sinks/terminal"},
    "dataset": set(),
    "fleet": {"config", "dataset", "runs", "sinks"} | {"sources"},
    "trend": {"damper", "dataset", "ordinary", "report", "sinks", "sinks/mcap"},
    "tables": {"config", "damper", "models", "report", "runs", "sources", "sinks", "sinks/mcap"},
    "serve": {"config", "dataset", "fleet", "report", "runs", "sinks", "sinks/terminal", "sources"}
    | {"tables"},
    "cli": {"config", "damper", "dataset", "estimation", "fleet", "report"}
    | {"runs", "runs/live", "serve", "sinks", "sinks/terminal", "sources"}
    | {"tables", "trend"},
    "__main__": {"cli"},
}
"""Room -> the other rooms of which it may import something. Rooms within estimation are its own."""
MOST_FLOORS, MOST_ARROWS = 11, 121  # serve/ stands on fleet/ and tables/, cli/ on it
MOST_LINES, MOST_IN_FUNCTION = 450, 60
MOST_FILES = {"answers": 14, "channels": 18, "cli": 15, "lateral": 14, "manoeuvre": 16}
"""A room holds about ten files; channels and cli, a file for each kind of command, have more, and
manoeuvre while it is being built."""
ONLY_IN = {
    "yawid.estimation.kernel": {"estimation"},
    "pyulog": {"sources/logs/ulog.py"},
    "pymavlink": {"sources", "quantities/vehicles.py"},
    "mcap": {
        "sinks/mcap/chunks.py",
        "sinks/mcap/reader.py",
        "sinks/mcap/records.py",
    },
    "rerun": {
        "sinks/rerun/recording.py",
        "sinks/rerun/blueprint.py",
        "sinks/rerun/panels.py",
    },
    "filterpy": {"estimation/reference.py"},
    "numba": {"estimation/machine/compiler.py"},
    "llvmlite": {"estimation/machine"},
    "distributed": {"fleet/pools.py", "fleet/worker.py"},
    "fsspec": {"system/stores.py"},
    "starlette": {"serve/app.py"},
    "uvicorn": {"serve/server.py"},
}
MODULES = sorted(SRC.rglob("*.py"))
NAMES = {
    ".".join(("yawid", *path.relative_to(SRC).with_suffix("").parts)).removesuffix(".__init__")
    for path in MODULES
}


@cache
def room(module: str) -> str:
    """Return the room of a module by its dotted name; a module of the package's root is its own."""
    parts = module.split(".")[1:]
    if not parts:
        return "__init__"
    is_package = (SRC / Path(*parts) / "__init__.py").exists()
    folder = parts if is_package else parts[:-1]
    return "/".join(folder[:1] if folder[:1] == ["estimation"] else folder) or parts[0]


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path) -> frozenset[str]:
    """Every module named in an import statement, wherever it stands; of yawid's its own modules."""
    found = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in NAMES else node.module)
    return frozenset(found)


def own_name(path: Path) -> str:
    parts = path.relative_to(SRC).with_suffix("").parts
    return ".".join(("yawid", *parts)).removesuffix(".__init__")


def arrows() -> set[tuple[str, str]]:
    """Return every pair of rooms of which the first imports something of the second."""
    found = set()
    for path in MODULES:
        own = room(own_name(path))
        others = {room(name) for name in imports(path) if name.split(".")[0] == "yawid"}
        found |= {(own, other) for other in others - {own} - set(GROUND)}
    return {(a, b) for a, b in found if a not in (*GROUND, "__init__")}


def test_a_room_imports_only_what_it_may() -> None:
    wrong = []
    for path in MODULES:
        own = room(own_name(path))
        ground = GROUND[: GROUND.index(own)] if own in GROUND else GROUND
        allowed = {own, *ground, *MAY_IMPORT.get(own, set())}
        named = {name for name in imports(path) if name.split(".")[0] == "yawid"}
        if own != "__init__":
            wrong += [f"{path} imports {name}" for name in named if room(name) not in allowed]
    assert wrong == []


def test_the_table_allows_nothing_that_nobody_needs() -> None:
    allowed = {(own, other) for own, others in MAY_IMPORT.items() for other in others}

    assert allowed - arrows() == set()
    assert len(allowed) <= MOST_ARROWS


def test_there_is_no_circle_and_the_house_has_few_floors() -> None:
    floor: dict[str, int] = {}
    waiting = dict(MAY_IMPORT)
    while waiting:
        ready = [own for own, others in waiting.items() if others <= floor.keys()]
        assert ready, f"a circle among {sorted(waiting)}"
        for own in ready:
            floor[own] = 1 + max((floor[other] for other in waiting.pop(own)), default=0)

    assert max(floor.values()) <= MOST_FLOORS


def test_nothing_stands_loose_in_the_root() -> None:
    loose = {path.stem for path in SRC.glob("*.py")}

    assert loose == {*GROUND[:3], "__init__", "__main__", "pipeline"}


def test_no_file_imports_from_the_root_what_the_root_hands_on() -> None:
    for path in MODULES:
        nodes = ast.walk(tree(path))
        named = {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
        assert "yawid" not in named | imports(path), path


def test_a_room_holds_about_ten_files() -> None:
    for folder in {path.parent for path in MODULES} - {SRC}:
        name = folder.relative_to(SRC).as_posix()
        count = len([path for path in folder.glob("*.py") if path.stem != "__init__"])
        assert count <= MOST_FILES.get(name, 13), f"{name} holds {count} files"


def test_a_library_is_imported_only_where_its_job_is_and_the_kernel_by_the_estimators() -> None:
    wrong = []
    for path in MODULES:
        places = {path.relative_to(SRC).as_posix()}
        places |= {
            folder.relative_to(SRC).as_posix() for folder in path.parents if SRC in folder.parents
        }
        for each in imports(path):
            homes = [ONLY_IN[name] for name in ONLY_IN if f"{each}.".startswith(f"{name}.")]
            wrong += [f"{path} imports {each}" for home in homes if not home & places]
    assert wrong == []


def test_files_and_functions_stay_small() -> None:
    for path in MODULES:
        assert path.read_text(encoding="utf-8").count("\n") <= MOST_LINES, path
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.FunctionDef):
                lines = node.end_lineno - node.lineno
                assert lines < MOST_IN_FUNCTION, f"{node.name} in {path} is too long"
