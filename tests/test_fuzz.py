"""Hostile logs and command lines: one line and an exit code, whatever they hold.

No exception or warning may escape, no exit code be undocumented, no error be of more than one line.
The long list draws 20 times as many.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
from pathlib import Path

import psutil
from fuzz_inputs import FuzzFlight, command_lines, flights
from hypothesis import given
from hypothesis import strategies as st

from yawid.channels.stage import WANTED, Channels
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.sources.mavlink.decoder import Decoder

NOT_A_NUMBER = re.compile(r"\b(NaN|Infinity)\b")


def run(flight: FuzzFlight, arguments: list[str], folder: Path) -> None:
    """Run one command line on one flight, and look at its exit code and what it says."""
    files = {"LOG": folder / "log.tlog", "KEY": folder / "key", "TOML": folder / "run.toml"}
    files["LOG"].write_bytes(flight.tlog())
    files["KEY"].write_bytes(bytes(range(32)))
    files["TOML"].write_text('method = "rml"\nrate = 10.0\nmemory = 30\n', encoding="utf-8")
    files["OUT"] = folder / "out"
    pattern = re.compile(r"(^|=)(LOG|KEY|TOML|OUT)$")
    words = [pattern.sub(lambda m: m[1] + str(files[m[2]]), word) for word in arguments]
    out, err, code = io.StringIO(), io.StringIO(), None
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        contextlib.suppress(SystemExit),  # argparse exits so
    ):
        code = main(words)
    assert code in {None, 0, 2, 3, 4, 5, 6}
    if code in (2, 6) and words[:1] not in ([], ["live"]):  # alone it is a page of help
        assert err.getvalue().count("\n") <= arguments.count("LOG") + 2
    if code is not None and "--json" in words:
        assert not NOT_A_NUMBER.search(out.getvalue())
        _ = [json.loads(line) for line in out.getvalue().splitlines()]


@given(flight=flights(), arguments=command_lines())
def test_no_log_and_no_command_line_ends_in_a_traceback(
    flight: FuzzFlight, arguments: list[str], tmp_path_factory
) -> None:
    run(flight, arguments, tmp_path_factory.getbasetemp())


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


def test_many_runs_hold_no_more_memory_than_a_few(tmp_path: Path) -> None:
    flight, held = FuzzFlight(seconds=15.0, hz=(50.0, 50.0)), []
    for _ in range(21):
        run(flight, ["replay", "LOG", "--json", "--out=OUT", "--force"], tmp_path)
        memory = psutil.Process().memory_info()
        held.append(memory.rss - memory.shared)  # without pages that belong to files
    assert held[20] - held[5] < 5.0 * 1024.0**2
