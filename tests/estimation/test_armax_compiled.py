"""Compiled or plain Python, cached or not: the same bits."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

SOURCE = ROOT / "src"
PROGRAM = """
import hashlib, warnings
warnings.simplefilter("error")
import numpy as np
from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax
rng = np.random.default_rng(0)
u, y = rng.standard_normal((2, 420))
y[[250, 300]] = np.nan
y[380] = 1e200
digest = hashlib.sha256()
for options in (
    dict(method="els", forgetting_factor=0.98),
    dict(method="rml", start_buffer=150, forgetting_factor=0.99),
    dict(method="rml", drift=0.01),
):
    config = EstimatorConfig(orders=ArmaxOrders(2, 2, 3, 1), sample_time_s=0.05, **options)
    armax = RecursiveArmax(config)
    block = armax.run(u[:-2], y[:-2], covariance=True)
    e = armax.update(float(u[-1]), float(y[-1]))
    digest.update(block.theta.tobytes() + e.theta_std.tobytes() + armax.P.tobytes())
    digest.update(armax.to_bytes())
    digest.update(np.float64(armax.predict(0.1)).tobytes())
print(digest.hexdigest())
"""


def digest(**environment: str) -> str:
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "PYTHONPATH": str(SOURCE), **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.strip()


@pytest.fixture(scope="module")
def compiled() -> str:
    return digest()


def test_plain_python_gives_the_same_bits(compiled):
    assert len(compiled) == len(hashlib.sha256().hexdigest())
    assert digest(NUMBA_DISABLE_JIT="1") == compiled


@pytest.mark.slow
def test_without_a_writable_cache_it_compiles_anew(compiled, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("a file where a folder is wanted")
    program = PROGRAM.replace("import numpy", "import numba.core.caching as c\n"
        "def refuse(self): raise OSError('read-only')\n"
        "c._CacheLocator.ensure_cache_path = refuse\nimport numpy")  # fmt: skip
    program += "from yawid.cli.main import main\nprint(main(['warm']))"
    run = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(SOURCE), "NUMBA_CACHE_DIR": str(blocked)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert run.stdout.split() == [compiled, "6"]
    assert "set NUMBA_CACHE_DIR" in run.stderr


@pytest.mark.slow
def test_warm_compiles_all_that_an_estimator_needs_and_once(tmp_path):
    def warm() -> str:
        run = subprocess.run(
            [sys.executable, "-m", "yawid", "warm"],
            env={**os.environ, "PYTHONPATH": str(SOURCE), "NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        return run.stdout

    def code() -> set[Path]:
        return set(tmp_path.rglob("*.nbc"))

    assert warm().startswith("compiled 4 functions in ")
    first = code()
    digest(NUMBA_CACHE_DIR=str(tmp_path))
    assert code() == first
    assert warm().startswith("nothing to do: 4 compiled functions are in ")
