"""Hostile logs and command lines: one line and an exit code, whatever they hold."""

from __future__ import annotations

from pathlib import Path

import fuzz
import pytest
from checks.children import resident_mb
from fuzz_inputs import FuzzFlight, command_lines, flights
from hypothesis import given
from hypothesis import strategies as st

from yawid.channels.stage import WANTED, Channels
from yawid.config.run import RunConfig
from yawid.sources.mavlink.decoder import Decoder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fuzz")
    fuzz.warm_up(path)
    return path


@given(flight=flights(), arguments=command_lines())
def test_no_log_and_no_command_line_ends_in_a_traceback(
    flight: FuzzFlight, arguments: list[str], folder: Path
) -> None:
    fuzz.run(flight, arguments, folder)


@given(data=st.binary(max_size=4000) | flights().map(FuzzFlight.tlog), size=st.integers(300, 5000))
def test_any_bytes_are_decoded_and_every_byte_is_counted(data: bytes, size: int) -> None:
    decoder, channels = Decoder(WANTED), Channels(RunConfig())
    blocks = [decoder.feed(data[at : at + size]) for at in range(0, len(data), size)]
    for block in (*blocks, decoder.finish()):
        if block is not None:
            channels.feed_frames(block)
    channels.finish()
    assert decoder.link.skipped_bytes + 16 * decoder.link.frames <= len(data)
    assert decoder.link.skipped_bytes >= 0


def test_many_runs_hold_no_more_memory_than_a_few(folder: Path) -> None:
    flight = FuzzFlight(seconds=15.0, hz=(50.0, 50.0))
    arguments = ["replay", "LOG", "--json", "--out=OUT", "--force"]
    for _ in range(6):
        fuzz.run(flight, arguments, folder)
    before = resident_mb()
    for _ in range(15):
        fuzz.run(flight, arguments, folder)
    assert resident_mb() - before < 5.0


def test_a_run_that_does_not_end_is_a_finding(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(arguments: list[str]) -> int:
        while True:
            pass

    monkeypatch.setattr(fuzz, "yawid", never)
    monkeypatch.setattr(fuzz, "LONGEST_S", 1)
    with pytest.raises(fuzz.FindingError, match="not finished after 1 s"):
        fuzz.run(FuzzFlight(seconds=0.2), ["replay", "LOG"], folder)


@pytest.mark.parametrize(
    ("code", "out", "err", "finding"),
    [
        (7, "", "", "exit code 7"),
        (6, "", "a\nb\nc\nd\n", "more than one line"),
        (0, '{"wn": NaN}\n', "", "not JSON"),
    ],
)
def test_what_a_user_cannot_read_is_a_finding(code: int, out: str, err: str, finding: str) -> None:
    with pytest.raises(fuzz.FindingError, match=finding):
        fuzz._check(code, ["replay", "LOG", "--json"], out, err)
