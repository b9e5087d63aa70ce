"""A pytest plugin that records which lines each test reaches, and how long each test takes.

    REACH=folder python -m pytest -p mutants.reach -p no:xdist tests src

writes ``tests.jsonl`` into the folder, one row a test as it ends, and data of coverage.py whose
contexts are the numbers of these rows; child processes add files of their own. Times are a
processor's, with the children's: a busy machine changes them little. A test also reaches what
another test reached when it filled a cache or set up a fixture that both use: these tests are its
``leans``.
"""

from __future__ import annotations

import gc
import json
import os
from collections import defaultdict
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import coverage
import pytest

SETTINGS = """[run]
source_pkgs = yawid
core = ctrace
disable_warnings = no-data-collected,module-not-imported,module-not-measured
data_file = {folder}/coverage
context = ${{REACH_TEST}}
"""
FOLDER = Path(os.environ["REACH"])
_Cache = type(lru_cache(len))


class Recorder:
    """Writes one row after each test."""

    def __init__(self) -> None:
        settings = FOLDER / "coveragerc"
        settings.write_text(SETTINGS.format(folder=FOLDER), encoding="utf-8")
        os.environ["REACH_TEST"] = ""
        self.coverage = coverage.Coverage(data_file=f"{FOLDER}/coverage", config_file=str(settings))
        self.coverage.start()
        # Only now: coverage.py starts itself in each child that finds these settings.
        settings.write_text(settings.read_text("utf-8") + "parallel = true\n", encoding="utf-8")
        os.environ["COVERAGE_PROCESS_START"] = str(settings)
        self.rows = (FOLDER / "tests.jsonl").open("w", encoding="utf-8")
        self.number = 0
        self.caches: list[Any] = []
        self.filled: dict[int, set[int]] = defaultdict(set)
        """The tests that set up a fixture or filled a cache, by its id()."""
        self.passed = True

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Find the caches of the tests' own modules."""
        found = [each for each in gc.get_objects() if type(each) is _Cache]
        mine = (str(session.config.rootpath / "tests"), str(session.config.rootpath / "tools"))
        self.caches = [each for each in found if _file(each).startswith(mine)]

    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> None:
        """Note which test sets up a fixture that others use."""
        if fixturedef.scope != "function" and fixturedef.baseid:
            self.filled[id(fixturedef)] = {self.number}

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Run one test in a context of its own."""
        self.passed = True
        os.environ["REACH_TEST"] = str(self.number)
        self.coverage.switch_context(str(self.number))
        before = [each.cache_info() for each in self.caches]
        began = sum(os.times()[:4])
        result = yield
        seconds = sum(os.times()[:4]) - began
        row = {"test": item.nodeid, "s": round(seconds, 3), "passed": self.passed}
        print(json.dumps(row | {"leans": self.leans(item, before)}), file=self.rows, flush=True)
        self.number += 1
        self.coverage.switch_context("")
        return result

    def leans(self, item: pytest.Item, before: list[Any]) -> list[int]:
        """Return which tests made what this one found made."""
        found: set[int] = set()
        for cache, old in zip(self.caches, before, strict=True):
            now = cache.cache_info()
            if now.hits > old.hits:
                found |= self.filled[id(cache)]
            if now.misses > old.misses:
                self.filled[id(cache)].add(self.number)
        known = getattr(item, "_fixtureinfo", None)
        for fixtures in known.name2fixturedefs.values() if known else ():
            for each in fixtures:
                found |= self.filled[id(each)]
        return sorted(found - {self.number})

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a test that was skipped, or failed without any mutant: it cannot kill one."""
        self.passed &= report.passed

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        """Write what is left, and that all tests ran."""
        self.coverage.stop()
        self.coverage.save()
        if exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
            (FOLDER / "ended").touch()


def _file(cache: Any) -> str:
    code = getattr(cache.__wrapped__, "__code__", None)
    return code.co_filename if code else ""


def pytest_configure(config: pytest.Config) -> None:
    """Start with the session."""
    config.pluginmanager.register(Recorder(), "reach")
