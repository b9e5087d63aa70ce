"""Nothing here can stand for ever: every wait of tests and tools has a limit, every test too."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from checks.children import child
from places import ROOT, TESTS, TOOLS

FOR_EVER = {"wait", "communicate", "join", "result", "acquire"}
"""Without an argument each of them waits as long as it takes."""
RUNS = {"run", "call", "check_call", "check_output"}
PYTEST = [sys.executable, "-m", "pytest", "-p", "no:hypothesispytest"]  # it takes a second to load
READS = {"recv", "recvfrom", "accept"}
HAS_A_LIMIT = {
    # It is yawid's own call: its socket has a timeout.
    ("tests/support/other_system.py", "super().recvfrom(size, flags)"),
    ("tools/checks/children.py", "subprocess.Popen(command, **options)"),
}


def endless(source: str, *, of_tests: bool = True) -> Iterator[str]:
    """Name every call that could wait without a limit.

    A tool may run a command for as long as that takes: a person stands by.
    """
    tree = ast.parse(source)
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    limited = {_owner(call) for call in calls if _name(call) in ("settimeout", "setblocking")}
    for call in calls:
        name, keywords = _name(call), {keyword.arg for keyword in call.keywords}
        if (
            (name in FOR_EVER and not call.args and not keywords)
            or (name in READS and _owner(call) not in limited)
            or name == "Popen"
            or (name == "Thread" and "daemon" not in keywords)
            or (
                of_tests
                and name in RUNS
                and _owner(call) == "subprocess"
                and "timeout" not in keywords
            )
        ):
            yield ast.unparse(call)
    for loop in ast.walk(tree):
        if isinstance(loop, ast.While) and of_tests:
            names = {_name(node) for node in ast.walk(loop) if isinstance(node, ast.Call)}
            if "sleep" in names and not names & {"monotonic", "poll"}:
                yield ast.unparse(loop)


def _name(call: ast.Call) -> str:
    named = call.func
    return named.attr if isinstance(named, ast.Attribute) else getattr(named, "id", "")


def _owner(call: ast.Call) -> str:
    """Return what the call belongs to: ``vehicle`` of ``link.vehicle.recv(9)``."""
    owner = call.func.value if isinstance(call.func, ast.Attribute) else call.func
    return ast.unparse(owner).rpartition(".")[2]


@pytest.mark.parametrize("folder", [TESTS, TOOLS], ids=lambda folder: folder.name)
def test_every_wait_has_a_limit(folder: Path) -> None:
    found = {
        (path.relative_to(ROOT).as_posix(), call)
        for path in folder.rglob("*.py")
        for call in endless(path.read_text(encoding="utf-8"), of_tests=folder == TESTS)
    }

    assert found - HAS_A_LIMIT == set()


@pytest.mark.parametrize(
    "line",
    [
        "process.wait()",
        "process.communicate()",
        "thread.join()",
        "future.result()",
        "lock.acquire()",
        "vehicle.recv(9)",
        "peer, _ = server.accept()",
        "subprocess.Popen(command)",
        "subprocess.run(command, check=True)",
        "threading.Thread(target=work)",
        "while not path.exists(): time.sleep(0.1)",
    ],
)
def test_a_wait_without_a_limit_is_found(line: str) -> None:
    assert [*endless(line)]


def test_a_test_that_stands_is_ended_and_named_and_the_others_run(tmp_path: Path) -> None:
    (tmp_path / "test_one.py").write_text(
        "import threading\n"
        "def test_that_stands(): threading.Event().wait()\n"
        "def test_that_is_next(): pass\n",
        encoding="utf-8",
    )
    own = ["-c", ROOT / "pyproject.toml", "-n", "1", "-o", "faulthandler_timeout=1"]
    done = subprocess.run(
        [*PYTEST, *own, "--rootdir", tmp_path, tmp_path],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip

    assert done.returncode == 1, done.stdout + done.stderr
    assert "1 failed, 1 passed" in done.stdout
    assert "crashed while running 'test_one.py::test_that_stands'" in done.stdout
    assert 'test_one.py", line 2 in test_that_stands' in done.stderr


@pytest.mark.parametrize(
    ("command", "most_s"),
    [(["bash", "-c", "trap '' TERM; echo ready; exec sleep 60"], 60.0), (["sleep", "60"], 0.2)],
)
def test_a_child_that_heeds_no_sigterm_or_says_nothing_in_its_time_is_killed(
    command: list[str], most_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("checks.children.LEAVE_S", 0.2)
    with child(command, most_s, stdout=subprocess.PIPE) as process:
        process.stdout.readline()

    assert process.returncode == -signal.SIGKILL


def test_tests_run_with_sigint_even_where_a_shell_ignores_it() -> None:
    """As those that send it need: a job in the background of a script is started ignoring it."""
    done = subprocess.run(
        ["bash", "-c", """trap '' INT; exec "$@" -k sigint_of_a_test""", "bash", *PYTEST, __file__],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert "1 passed" in done.stdout, done.stdout + done.stderr


def test_the_sigint_of_a_test_raises_and_its_children_heed_it() -> None:
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
    with child(["sleep", "60"]) as process:
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == -signal.SIGINT
