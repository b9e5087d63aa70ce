"""What ``yawid recover`` makes of a torn run: viewed, reported, replayed, and never usable."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from finished_runs import replayed
from hostile import FLIGHT
from mcap.reader import make_reader
from places import C172P
from printed import printed

from yawid.cli.main import main
from yawid.sinks.mcap.reader import open_run


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    (folder / "a.tlog").write_bytes(FLIGHT)
    return replayed(folder / "a.tlog", folder, "--rate", 10, "--forgetting", 1)


@pytest.fixture(scope="module")
def recovered(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two thirds of the run, as kill -9 leaves it."""
    folder = tmp_path_factory.mktemp("recovered")
    data = whole.read_bytes()
    (folder / "a.mcap.part").write_bytes(data[: 2 * len(data) // 3])
    assert main(["recover", str(folder / "a.mcap.part"), "-o", str(folder / "a.mcap")]) == 0
    return folder / "a.mcap"


def summary_of(mcap: Path) -> dict[str, Any]:
    with mcap.open("rb") as stream:
        [data] = [a.data for a in make_reader(stream).iter_attachments() if "summary" in a.name]
    summary: dict[str, Any] = printed("replay", data.decode())
    return summary


def test_its_summary_says_that_it_is_no_whole_run_and_what_there_is(
    whole: Path, recovered: Path
) -> None:
    run = open_run(recovered)
    assert run.config == open_run(whole).config
    assert run.summary.verdict.usable is False
    [reason] = run.summary.verdict.reasons
    assert reason.id == "interrupted"
    assert f"recovered from a.mcap.part, {run.rows} samples" in reason.text
    assert 100 < run.rows < open_run(whole).rows
    last = list(run.blocks())[-1]
    for method, estimate in run.summary.estimates.items():
        theta = last.estimates[method].theta[-1]
        assert list(estimate.theta.values()) == theta.tolist()
        assert estimate.updates + estimate.held == run.rows
    assert run.summary.estimates["els"].dutch_roll.wn_rad_s == last.modes.dutch_roll[-1, 0]


def test_it_is_viewed_and_reported(recovered: Path, tmp_path: Path) -> None:
    assert main(["view", str(recovered), "--save", str(tmp_path / "v.rrd")]) == 0
    assert main(["report", str(recovered), "--out", str(tmp_path / "r.html")]) == 0
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "recovered from a.mcap.part" in page
    shown = re.findall(r'<figure id="(\w+)">', page)
    assert shown == ["whole", "modes", "parameters", "link"]  # the flight's answer was not written


def test_it_is_replayed_as_the_same_stretch_of_the_whole_run_and_is_no_answer(
    whole: Path, recovered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = np.concatenate([samples.boot_us for samples in open_run(recovered).samples()]) / 1e6
    again = replayed(recovered, tmp_path / "again", "--orders", "2,2,2,1")
    direct = replayed(whole, tmp_path / "direct", "--orders", "2,2,2,1", "--to", times[-1])

    assert summary_of(again)["estimates"] == summary_of(direct)["estimates"]
    capsys.readouterr()
    assert main(["replay", str(recovered), "--out", str(tmp_path)]) == 130
    assert "NOT USABLE" in capsys.readouterr().out


def test_a_whole_run_that_lost_a_second_says_so(tmp_path: Path) -> None:
    whole = replayed(C172P, tmp_path / "whole", "--rate", 10)
    data = bytearray(whole.read_bytes())
    with whole.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[7]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(data)
    assert main(["recover", str(tmp_path / "bad.mcap"), "-o", str(tmp_path / "out.mcap")]) == 0

    before, after = summary_of(whole), summary_of(tmp_path / "out.mcap")
    assert not after["verdict"]["usable"]
    first, *others = after["verdict"]["reasons"]
    assert (first["id"], first["weight"]) == ("interrupted", "fatal")
    assert "without 1 x damaged chunk" in first["text"]
    assert others == before["verdict"]["reasons"]
    assert after["estimates"] == before["estimates"]
    assert after["channels"] == before["channels"]


def test_a_sound_run_is_recovered_as_it_is(whole: Path, tmp_path: Path) -> None:
    assert main(["recover", str(whole), "-o", str(tmp_path / "out.mcap")]) == 0
    assert summary_of(tmp_path / "out.mcap") == summary_of(whole)
    assert main(["replay", str(tmp_path / "out.mcap"), "--out", str(tmp_path / "x")]) in (0, 5)


def test_what_lost_its_estimates_is_replayed_and_the_others_say_how(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(whole.read_bytes())
    torn = data[: 2 * len(data) // 3]
    torn[torn.index(b"/yawid/estimate/rml")] ^= 1  # no channel that yawid writes
    (tmp_path / "bad.mcap").write_bytes(torn)
    out = tmp_path / "out.mcap"
    assert main(["recover", str(tmp_path / "bad.mcap"), "-o", str(out)]) == 0

    capsys.readouterr()
    assert main(["view", str(out), "--save", str(tmp_path / "v.rrd")]) == 6
    assert "yawid replay of this file estimates them again" in capsys.readouterr().err
    again = replayed(out, tmp_path / "again")
    assert set(summary_of(again)["estimates"]) == {"els", "rml"}
    assert main(["view", str(again), "--save", str(tmp_path / "v.rrd")]) == 0


def test_a_file_torn_before_it_says_so_sends_to_the_log(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = whole.read_bytes()
    at = data.index(b"configuration")
    (tmp_path / "bad.mcap").write_bytes(data[:at] + b"X" + data[at + 1 : 2 * len(data) // 3])
    out = tmp_path / "out.mcap"
    assert main(["recover", str(tmp_path / "bad.mcap"), "-o", str(out)]) == 0

    for command in (["replay", str(out), "--out", str(tmp_path)], ["report", str(out)]):
        capsys.readouterr()
        assert main(command) == 6
        assert capsys.readouterr().err.count("\n") == 1
