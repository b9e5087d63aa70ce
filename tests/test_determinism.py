"""The same log gives the same contents: on every run and under any cut.

Between machines the last bits may differ: NumPy, BLAS and the compiler choose their instructions by
the processor (fused multiply-add, width of vectors), so that sums round otherwise. The recursion
carries such differences on; the tolerances of support/case_compare.py are wide enough for them,
as the last test here shows on instructions of another machine.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from drawn import examples
from hypothesis import given
from hypothesis import strategies as st
from log_cases import Case, update
from mcap.reader import make_reader
from places import REPLAY_LOGS as CASES
from places import ROOT

from yawid.channels.stage import WANTED
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.estimation.machine.runner import BEHIND
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.runs.job import feed_all
from yawid.runs.outputs import Outputs, finish, open_mcap, parameters_of
from yawid.sources.logs.tlog import TlogReader
from yawid.sources.mavlink.decoder import Decoder

GAPS = CASES / "c172p_gaps" / "log.tlog"
SHORT = GAPS.read_bytes()[:60_000]
CHECK = ("-q", "-p", "no:cacheprovider", ROOT / "tests" / "test_replay_logs.py")


def contents(path: Path) -> dict[str, Any]:
    """Return all that an MCAP holds, but for the paths of this run in its summary."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        messages = [
            (channel.topic, m.log_time, m.publish_time, m.sequence, m.data)
            for _, channel, m in reader.iter_messages(log_time_order=False)
        ]
        # Only the order on each topic is kept: a manoeuvre ends a chunk when its fit is ready.
        messages.sort(key=lambda message: message[0])
        metadata = {record.name: dict(record.metadata) for record in reader.iter_metadata()}
        attachments = {record.name: record.data for record in reader.iter_attachments()}
        schemas = [(s.name, s.encoding, s.data) for s in reader.get_summary().schemas.values()]
    metadata["source"].pop("log")
    summary = json.loads(attachments.pop("summary.json"))
    for name in ("log", "files"):
        summary.pop(name)
    return {
        "messages": messages,
        "metadata": metadata,
        "attachments": attachments,
        "schemas": schemas,
        "summary": summary,
    }


def run_python(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a process of its own."""
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")} | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def test_two_runs_in_different_surroundings_give_the_same_contents(tmp_path: Path):
    options = ["--rate", "10", "--json"]
    assert main(["replay", str(GAPS), "--out", str(tmp_path / "a"), *options]) == 0
    surroundings = {"PYTHONHASHSEED": "77", "TZ": "Pacific/Kiritimati", "LC_ALL": "C"}
    shutil.copy(GAPS, tmp_path / "log.tlog")
    command = "-W", "error", "-m", "yawid", "replay", tmp_path / "log.tlog", "--out", tmp_path / "b"
    other = run_python(*command, *options, **surroundings)
    assert other.returncode == 0, other.stderr

    one, two = (contents(tmp_path / name / "log.mcap") for name in "ab")

    assert len(one["messages"]) > 1000
    for part, expected in one.items():
        assert two[part] == expected, part


def written(path: Path, data: bytes, edges: list[int]) -> dict[str, Any]:
    """Run the pipeline on a log cut at ``edges`` and return what its MCAP holds."""
    config = RunConfig(rate=10.0)
    outputs = Outputs(path.parent, path.stem, force=True)
    pipeline = Pipeline(config, [open_mcap(config, outputs)])
    pieces = [data[low:high] for low, high in zip([0, *edges], [*edges, len(data)], strict=True)]
    source = TlogReader(pieces, Decoder(WANTED))
    feed_all(source, pipeline)
    summary = summarise(pipeline, source.link, "log.tlog", "")
    finish(pipeline, summary, outputs.files(), parameters_of(pipeline))
    return contents(path)


@cache
def written_whole(folder: Path) -> dict[str, Any]:
    return written(folder / "whole.mcap", SHORT, [])


@examples(6)
@given(
    edges=st.lists(st.integers(1, len(SHORT) - 1), max_size=12, unique=True).map(sorted)
    | st.sampled_from([[*range(size, len(SHORT), size)] for size in (137, 4096)])
)
def test_the_contents_do_not_depend_on_any_cut(tmp_path_factory, edges: list[int]):
    folder = tmp_path_factory.mktemp("cut")
    whole = written_whole(tmp_path_factory.getbasetemp())

    assert written(folder / "cut.mcap", SHORT, edges) == whole


def other_instructions(scratch: Path) -> dict[str, str]:
    """Return an environment in which NumPy, BLAS and numba use only the oldest instructions."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    dispatched = [name for name in __cpu_dispatch__ if __cpu_features__.get(name)]
    return {
        "NPY_DISABLE_CPU_FEATURES": " ".join(dispatched),
        "OPENBLAS_CORETYPE": "Prescott",
        "OPENBLAS_NUM_THREADS": "1",
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
        "NUMBA_CACHE_DIR": str(scratch),
    }


@pytest.mark.long
def test_references_of_this_machine_hold_on_instructions_of_another(tmp_path: Path):
    folder = tmp_path / "cases"
    for path in CASES.glob("*/case.toml"):
        shutil.copytree(path.parent, folder / path.parent.name)
        lowered = path.read_text(encoding="utf-8").replace("floor = ", "floor = 0 # ", 1)
        (folder / path.parent.name / "case.toml").write_text(lowered, encoding="utf-8")
        update(Case.read(folder / path.parent.name), "here and now")

    environment = other_instructions(tmp_path / "cache")
    run_python("-c", BEHIND, **environment).check_returncode()
    other = run_python("-m", "pytest", *CHECK, "--cases", folder, **environment)

    assert other.returncode == 0, other.stdout


@pytest.mark.slow
def test_without_compilation_the_numbers_are_the_same_to_rounding(tmp_path: Path):
    """NUMBA_DISABLE_JIT=1: the same functions as plain Python, for those who cannot compile."""
    folder = tmp_path / "cases"
    shutil.copytree(CASES / "c172p_gcs_rates", folder / "c172p_gcs_rates")
    update(Case.read(folder / "c172p_gcs_rates"), "here and now")

    other = run_python("-m", "pytest", *CHECK, "--cases", folder, NUMBA_DISABLE_JIT="1")

    assert other.returncode == 0, other.stdout
