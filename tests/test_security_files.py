"""Every point of the threat model, attacked: names from a log, reports, MCAP files (README.md)."""

from __future__ import annotations

from pathlib import Path

import pytest
from hostile import assert_harmless, bomb, hostile_log, rewritten, run_limited, with_bomb
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from yawid.cli.main import main
from yawid.errors import YawidError
from yawid.report.write import write_report
from yawid.runs.finished_run import FinishedRun
from yawid.sinks.mcap.reader import open_run


@pytest.fixture(scope="module")
def hostile_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile")
    log = folder / "a <img src=x onerror=alert(1)> & \"b\" 'c'.tlog"
    log.write_bytes(hostile_log())
    assert main(["replay", str(log), "--out", str(folder / "out"), "--rate", "10"]) in (0, 5)
    return folder


def test_names_in_a_log_make_no_file_anywhere(hostile_run: Path):
    stem = "a <img src=x onerror=alert(1)> & \"b\" 'c'"

    made = {path.relative_to(hostile_run).as_posix() for path in hostile_run.rglob("*")}
    assert made == {f"{stem}.tlog", "out", f"out/{stem}.mcap"}
    with next((hostile_run / "out").iterdir()).open("rb") as stream:
        names = [a.name for a in make_reader(stream).iter_attachments()]
    assert {Path(name).name for name in names} == set(names)


def test_a_report_runs_nothing_that_names_or_forged_messages_put_into_it(
    hostile_run: Path, tmp_path: Path
):
    mcap = next((hostile_run / "out").iterdir())
    forged = rewritten(mcap, tmp_path / "forged.mcap", poison_metadata=False)
    pages = [
        write_report(each, tmp_path / "r.html", force=True).read_text(encoding="utf-8")
        for each in (mcap, forged)
    ]
    for page in pages:
        assert_harmless(page)
    assert "&lt;img src=x onerror=alert(1)&gt;" in pages[0]

    refused = rewritten(mcap, tmp_path / "refused.mcap", poison_metadata=True)
    with pytest.raises(YawidError, match="not a file as yawid writes it"):
        write_report(refused, tmp_path / "refused.html")
    assert not list(tmp_path.glob("refused.html*"))


@pytest.fixture(scope="module")
def good_mcap(hostile_run: Path) -> bytes:
    return next((hostile_run / "out").iterdir()).read_bytes()


@given(data=st.data())
def test_a_damaged_mcap_is_read_to_there_or_refused_in_one_line(
    good_mcap: bytes, tmp_path_factory, data: st.DataObject
):
    folder = tmp_path_factory.mktemp("damaged")
    content = bytearray(good_mcap)
    for _ in range(data.draw(st.integers(0, 8))):
        at = data.draw(st.integers(0, len(content) - 1))
        width = data.draw(st.sampled_from([1, 1, 8]))
        content[at : at + width] = data.draw(st.binary(min_size=width, max_size=width))
    content = content[: data.draw(st.integers(1, len(content)))]
    (folder / "in.mcap").write_bytes(content)

    for act in (
        lambda: [*FinishedRun(folder / "in.mcap").read()],
        lambda: open_run(folder / "in.mcap"),
        lambda: write_report(folder / "in.mcap", folder / "r.html"),
    ):
        try:
            act()
        except YawidError as refusal:
            assert bytes(content) != good_mcap, refusal
            assert "\n" not in str(refusal)
    assert not list(folder.glob("*.part"))


def test_a_chunk_that_unpacks_to_gigabytes_is_not_unpacked(good_mcap: bytes, tmp_path: Path):
    (tmp_path / "bomb.mcap").write_bytes(bomb(1500))
    (tmp_path / "run.mcap").write_bytes(with_bomb(good_mcap, 1500))
    assert (tmp_path / "bomb.mcap").stat().st_size < 1_000_000

    run_limited(
        "from yawid.cli.main import main\n"
        "from yawid.sinks.mcap.records import intact\n"
        "alone, run, out = sys.argv[1:]\n"
        "assert main(['replay', alone, '--out', out]) == 6\n"
        "assert list(intact(open(alone, 'rb'))) == []\n"
        "assert main(['report', run, '-o', out + '/r.html']) == 6\n"
        "assert main(['view', run, '--out', out + '/v.rrd']) == 6",
        900,
        tmp_path / "bomb.mcap",
        tmp_path / "run.mcap",
        tmp_path / "out",
    )
