"""Compiled or plain Python, kept or not, changing over at any sample: the same bits."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from checks.children import child
from finished_runs import messages
from hypothesis import example, given
from hypothesis import strategies as st
from places import ROOT

from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax
from yawid.errors import ConfigError
from yawid.estimation import armax
from yawid.estimation.machine import kept
from yawid.estimation.machine.object_code import RUN
from yawid.estimation.machine.runner import Runner

SOURCE = ROOT / "src"
LOG = ROOT / "replay_logs" / "c172p_3211" / "log.tlog"
CONFIGS = [
    EstimatorConfig(orders=ArmaxOrders(2, 2, 3, 1), sample_time_s=0.05, **options)
    for options in (
        {"method": "els", "forgetting_factor": 0.98},
        {"method": "rml", "start_buffer": 150, "forgetting_factor": 0.99},
        {"method": "rml", "residual_lags": 0},
    )
]
U, Y = np.random.default_rng(0).standard_normal((2, 420))
Y[[250, 300]] = np.nan
Y[380] = 1e200


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("yawid.estimation.machine.runner.LOOK_S", 0.0)


def interpreting(monkeypatch: pytest.MonkeyPatch, folder: Path) -> Runner:
    """Have the estimators taken on by one that finds nothing compiled in this folder."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder))
    runner = Runner()
    monkeypatch.setattr(armax, "RUNNER", runner)
    return runner


def code() -> bytes:
    """Return the compiled code that all tests run on."""
    return kept.find(RUN)


def run(config: EstimatorConfig, *cuts: int) -> bytes:
    """Return all that becomes of the samples, taken in pieces."""
    estimator, last = RecursiveArmax(config), RecursiveArmax(config)
    with pytest.raises(ConfigError, match="infinite"):
        last.run(U, np.append(Y[:-1], np.inf))
    told = last.run(U, Y, keep="last").rows.tobytes() + last.to_bytes()
    for u, y in zip(np.split(U, sorted(cuts)), np.split(Y, sorted(cuts)), strict=True):
        told += estimator.run(u, y, covariance=True).rows.tobytes()
    estimate = estimator.update(float(U[-1]), 0.1)
    told += estimate.theta_std.tobytes() + estimator.P.tobytes() + estimator.to_bytes()
    return told + np.float64(estimator.predict(0.1)).tobytes()


@given(config=st.sampled_from(CONFIGS), looks=st.integers(1, 90), cut=st.integers(0, 419))
@example(config=CONFIGS[0], looks=10**6, cut=0)
@example(config=CONFIGS[1], looks=10**6, cut=100)
@example(config=CONFIGS[2], looks=10**6, cut=0)
def test_it_changes_over_at_any_sample_with_the_same_bits(tmp_path_factory, config, looks, cut):
    """Or never: plain Python has the same bits."""
    expected, compiled_code, looked = run(config, cut), code(), [0]

    def find(_: str) -> bytes | None:
        looked[0] += 1
        return compiled_code if looked[0] > looks else None

    with pytest.MonkeyPatch.context() as monkeypatch:
        runner = interpreting(monkeypatch, tmp_path_factory.getbasetemp())
        monkeypatch.setattr("yawid.estimation.machine.runner.PIECE", 5)
        monkeypatch.setattr(kept, "find", find)
        assert run(config, cut) == expected
        assert runner.is_compiled() == (looked[0] > looks)


def without_patience(monkeypatch: pytest.MonkeyPatch, compiled: Callable[[], bytes]) -> None:
    """Have a process that interprets compile at its next block, by this."""
    monkeypatch.setattr("yawid.estimation.machine.runner.PATIENCE_S", 0.0)
    monkeypatch.setattr("yawid.estimation.machine.compiler.compiled", compiled)


@pytest.mark.parametrize("folder", ["cache", "a file/cache"])
def test_a_process_that_interprets_for_long_compiles_and_keeps_it_where_it_can(
    tmp_path, monkeypatch, folder
):
    (tmp_path / "a file").touch()
    expected, compiled_code = run(CONFIGS[0], 100), code()
    runner = interpreting(monkeypatch, tmp_path / folder)
    without_patience(monkeypatch, lambda: compiled_code)
    assert run(CONFIGS[0], 100) == expected
    assert runner.is_compiled()
    assert kept.find(RUN) == (compiled_code if folder == "cache" else None)


def test_a_numba_that_cannot_compile_is_told_once_and_leaves_plain_python_at_work(
    tmp_path, monkeypatch, caplog
):
    expected, tried = run(CONFIGS[0], 100), []
    runner = interpreting(monkeypatch, tmp_path)

    def fail() -> bytes:
        tried.append("again")
        raise RuntimeError("no such \x1b[31minstruction\nand much more")

    without_patience(monkeypatch, fail)
    assert run(CONFIGS[0], *range(20, 400, 20)) == run(CONFIGS[0], *range(20, 400, 20))
    assert run(CONFIGS[0], 100) == expected
    assert not runner.is_compiled()
    assert len(tried) == 1
    [line] = caplog.messages
    assert line.startswith("yawid: the estimators cannot be compiled (RuntimeError: no such ?[31m")
    assert "50 times slower" in line
    assert "\n" not in line


def test_a_process_whose_numba_is_broken_says_why_in_one_line(tmp_path):
    """The process behind it has failed as well, without a word."""
    broken = tmp_path / "numba"
    broken.mkdir()
    count = tmp_path / "imports"
    (broken / "__init__.py").write_text(
        f"open({str(count)!r}, 'a').write('x')\nraise ImportError('Numba needs an older NumPy')\n",
        encoding="utf-8",
    )
    program = (
        "import numpy as np\n"
        "from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax\n"
        "from yawid.estimation.machine import runner\n"
        "runner.LOOK_S = runner.PATIENCE_S = 0.0\n"
        "assert runner.RUNNER.compile_behind()\n"
        "runner.RUNNER._child.wait(30)\n"
        "config = EstimatorConfig(orders=ArmaxOrders(2, 2, 1, 1), sample_time_s=0.05)\n"
        "estimator = RecursiveArmax(config)\n"
        "for _ in range(5): estimator.run(*np.random.default_rng(0).standard_normal((2, 50)))"
    )
    paths = os.pathsep.join([str(tmp_path), str(SOURCE)])
    environment = {"PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(tmp_path / "none")}
    done = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | environment,
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    [line] = done.stderr.splitlines()
    assert "cannot be compiled (ImportError: Numba needs an older NumPy)" in line
    assert count.read_text(encoding="utf-8") == "xx"


def test_without_a_further_process_this_one_goes_on_by_itself(tmp_path, monkeypatch):
    runner = interpreting(monkeypatch, tmp_path)
    (tmp_path / "python").touch(0o644)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))

    assert not runner.compile_behind()


def replayed(folder: Path, cache: Path) -> str:
    """Run README's first command as somebody at a terminal; return what stands in it."""
    terminal, own = pty.openpty()
    with child(
        [sys.executable, "-m", "yawid", "replay", str(LOG), "--out", str(folder)],
        env={**os.environ, "PYTHONPATH": str(SOURCE), "NUMBA_CACHE_DIR": str(cache)},
        stdout=subprocess.DEVNULL, stderr=own,
    ) as process:  # fmt: skip
        os.close(own)
        said = b""
        with suppress(OSError):  # how a terminal ends
            while some := os.read(terminal, 4096):
                said += some
        assert process.wait(60.0) == 0
    os.close(terminal)
    return said.decode()


@pytest.mark.long
def test_a_first_run_answers_at_once_and_is_followed_by_compiled_ones(tmp_path):
    cache = tmp_path / "cache"
    assert "yawid: first run: " in replayed(tmp_path / "first", cache)
    assert not list(cache.glob(f"{RUN}*.code"))  # it did not wait
    end_s = time.monotonic() + 120.0
    while not list(cache.glob(f"{RUN}*.code")):
        assert time.monotonic() < end_s
        time.sleep(0.1)
    assert "first run" not in replayed(tmp_path / "second", cache)
    assert messages(tmp_path / "first" / "log.mcap") == messages(tmp_path / "second" / "log.mcap")
