"""The tests run compiled, as all runs of an installation but its first."""

import gc
import os
import shutil
import signal
import tempfile

import pytest
from drawn import settings
from places import REPLAY_LOGS

# As the command line does, before NumPy is there: two workers of two threads each wait in turns.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from yawid.estimation.machine.runner import RUNNER, is_plain

settings.load_profile("gate")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of test_replay_logs.py."""
    cases = parser.getgroup("cases of yawid")
    text = "folder of the cases that are replayed (default: replay_logs)"
    cases.addoption("--cases", metavar="DIR", default=str(REPLAY_LOGS), help=text)
    text = "write the references of the cases again, with this reason"
    cases.addoption("--update-cases", metavar="WHY", help=text)


def pytest_configure(config: pytest.Config) -> None:
    """Compile before the workers start: each would interpret for seconds, then compile as well.

    A shell starts a job in the background with SIGINT ignored, which its children would inherit:
    here tests send SIGINT.
    """
    if not hasattr(config, "workerinput"):
        # Before the workers start: they make each run once, and share it (finished_runs.replayed).
        folder = os.environ["YAWID_TEST_RUNS"] = tempfile.mkdtemp(prefix="yawid-runs-")
        config.add_cleanup(lambda: shutil.rmtree(folder))
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not (hasattr(config, "workerinput") or is_plain() or RUNNER.is_compiled()):
        RUNNER.compile()


def pytest_collection() -> None:
    """Collect no garbage among five thousand tests that stay: it takes a sixth of the time."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()
