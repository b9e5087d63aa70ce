"""The flow goes one way: a module imports only what lies upstream of it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

SRC = Path(__file__).parents[1] / "src" / "yawid"
STAGES = [
    ("__init__", "errors", "stop", "standard_streams", "blocks", "config", "run_config"),
    ("plant",),
    ("sources",),
    ("channels",),
    ("estimation",),
    ("physics",),
    ("offline",),
    ("results", "verdict", "verdict_estimate"),
    ("sinks",),
    ("pipeline",),
    ("summary", "model_summary"),
    ("outputs", "golden", "collect", "advice"),
    ("session", "regress", "inspect"),
    ("again",),
    ("live", "simulation"),
    ("cli_paper", "cli_options", "cli_live", "cli_view"),
    ("cli",),
    ("__main__",),
]
ONLY_IN = {
    "pyulog": {"sources/logs/ulog_file.py"},
    "pymavlink": {"sources"},
    "mcap": {
        "sinks/mcap/chunks.py",
        "sinks/mcap/reader.py",
        "sinks/mcap/trusted.py",
        "sinks/mcap/recover.py",
    },
    "rerun": {"sinks/rerun/recording.py", "sinks/rerun/blueprint.py"},
    "filterpy": {"estimation/reference/estimator.py", "channels/heading_filter.py"},
    "numba": {"estimation/kernel/linear_algebra.py"},
}
MODULES = sorted(SRC.rglob("*.py"))


def rank(name: str) -> int:
    return next(i for i, stage in enumerate(STAGES) if name in stage)


def imports(path: Path) -> set[str]:
    """Every module named in an import statement, wherever it stands."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda p: p.relative_to(SRC).as_posix())
def test_imports_only_point_upstream(path: Path) -> None:
    own = rank(path.relative_to(SRC).with_suffix("").parts[0])
    for module in imports(path):
        if module.startswith("yawid."):
            assert rank(module.split(".")[1]) <= own, f"{path.name} imports {module}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: p.relative_to(SRC).as_posix())
def test_a_library_is_imported_only_where_its_job_is(path: Path) -> None:
    place = path.relative_to(SRC).as_posix()
    for module in imports(path):
        homes = ONLY_IN.get(module.split(".")[0])
        if homes is not None:
            assert place in homes or place.split("/")[0] in homes, f"{place} imports {module}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: p.relative_to(SRC).as_posix())
def test_files_and_functions_stay_small(path: Path) -> None:
    text = path.read_text()
    assert text.count("\n") <= 450
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            assert node.end_lineno is not None
            assert node.end_lineno - node.lineno < 60, f"{node.name} is too long"
