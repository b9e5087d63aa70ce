"""What a newcomer touches: one of each thing is added in a copy of the house, and works there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from places import C172P, SRC


@dataclass(frozen=True)
class Change:
    """Files below src/yawid with what is new in them, and a script that fails without it.

    A file that is there has pairs: a line that stands in it once, and what stands in its place.
    The script is run where the copy is what ``import yawid`` finds; ``LOG`` is a tlog.
    """

    new: Mapping[str, str]
    edited: Mapping[str, tuple[tuple[str, str], ...]]
    proof: str

    @property
    def touched(self) -> int:
        return len(self.new) + len(self.edited)


RUN = """
import json, subprocess, sys
def yawid(*arguments):
    run = [sys.executable, "-m", "yawid", *map(str, arguments)]
    done = subprocess.run(run, capture_output=True, text=True, timeout=120)
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout
"""
FORMAT = Change(
    {
        "sources/logs/hex_log.py": '''
"""A telemetry log as digits, after a line that says so."""

from collections.abc import Iterator
from pathlib import Path

from yawid.blocks import FrameBlock
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.tally import LinkStats


class HexLog:
    """Read once, as a whole."""

    vehicle_id = None

    def __init__(self, path: Path, decoder: Decoder) -> None:
        self._path, self._decoder = path, decoder

    @property
    def link(self) -> LinkStats:
        return self._decoder.link

    def read(self) -> Iterator[tuple[int, FrameBlock | None]]:
        data = self._path.read_bytes()
        yield len(data), self._decoder.feed(bytes.fromhex(data[4:].decode()))
        yield 0, self._decoder.finish()
'''
    },
    {
        "sources/formats.py": (
            (
                "def _record(path: Path",
                "def _hex(path: Path, decoder: "
                '"Callable[[], Decoder]") -> "Reader":\n'
                "    from yawid.sources.logs.hex_log import HexLog\n\n"
                "    return HexLog(path, decoder())\n\n\n"
                "def _record(path: Path",
            ),
            (
                "    RUN,\n)",
                '    RUN,\n    Format("hex", "hex", "a log of digits", _hex, b"HEX\\n"),\n)',
            ),
        )
    },
    RUN
    + """
from pathlib import Path
Path("logs").mkdir()
Path("logs/log.hex").write_bytes(b"HEX\\n" + Path(LOG).read_bytes().hex().encode())
ours, theirs = (json.loads(yawid("replay", log, "--out", "out", "--force", "--json"))
                for log in ("logs/log.hex", LOG))
assert ours["flight"] == theirs["flight"]
assert ours["flight"]["verdict"]["usable"]
assert "hex" in yawid("replay", "--help")
yawid("fleet", "logs", "--out", "data")
import pyarrow.parquet
rows = pyarrow.parquet.read_table("data/logs.parquet").to_pylist()
assert [row["kind"] for row in rows] == ["hex"], rows
""",
)
CHANNEL = Change(
    {},
    {
        "quantities/table.py": (
            (
                '    Quantity("altitude", "m", "above the sea", "held", True),\n',
                '    Quantity("altitude", "m", "above the sea", "held", True),\n'
                '    Quantity("climb", "m/s", "upward", "held", True),\n',
            ),
        ),
        "blocks.py": (
            (
                "    ground_speed: Floats\n    airspeed_kind: Floats\n\n    def epochs",
                "    ground_speed: Floats\n    airspeed_kind: Floats\n    climb: Floats\n\n"
                "    def epochs",
            ),
            (
                "    ground_speed: Floats\n    airspeed_kind: Floats\n\n\n@dataclass",
                "    ground_speed: Floats\n    airspeed_kind: Floats\n    climb: Floats\n\n\n"
                "@dataclass",
            ),
        ),
        "channels/flight_state.py": (
            ("Latest(5)", "Latest(6)"),
            (
                '            "airspeed_kind": hud[:, 3],\n',
                '            "airspeed_kind": hud[:, 3],\n            "climb": hud[:, 5],\n',
            ),
            (
                "        air, ground, altitude = _columns(*names)(fields).T\n",
                "        air, ground, altitude, climb = _columns(*names, 'climb')(fields).T\n",
            ),
            ("(fields), flies])", "(fields), flies, climb])"),
            ("float(kind)), flies])", "float(kind)), flies, climb])"),
        ),
        "sinks/mcap/schemas.py": (
            (
                '        ("ground_speed", "double"), ("airspeed_kind", "double"),\n',
                '        ("ground_speed", "double"), ("airspeed_kind", "double"),\n'
                '        ("climb", "double"),\n',
            ),
        ),
    },
    RUN
    + """
import numpy as np
from yawid import load, replay
first = replay(LOG).samples
assert np.isfinite(first["climb"]).sum() > 1000
assert {each.name: each.unit for each in first.each()}["climb"] == "m/s"
yawid("replay", LOG, "--out", "out")
assert np.array_equal(load("out/log.mcap").samples["climb"], first["climb"], equal_nan=True)
""",
)
SINK = Change(
    {
        "sinks/lines.py": '''
"""A line of text for each block of samples."""

from pathlib import Path

from yawid.sinks.base import Event, RunRows, Sink


class LinesSink(Sink):
    """Writes how many samples came, a block a line."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w")

    def take(self, event: Event) -> None:
        if isinstance(event, RunRows):
            print(len(event.samples), file=self._file, flush=True)
'''
    },
    {
        "runs/outputs.py": (
            (
                "    with whole_or_none(sinks):\n        sinks += open_rerun(outputs)\n",
                "    with whole_or_none(sinks):\n        sinks += open_rerun(outputs)\n"
                "        from yawid.sinks.lines import LinesSink\n\n"
                '        sinks.append(LinesSink(outputs.path(".txt")))\n',
            ),
        )
    },
    RUN
    + """
from pathlib import Path
found = json.loads(yawid("replay", LOG, "--out", "out", "--json"))
counts = [int(line) for line in Path("out/log.txt").read_text().split()]
stream = found["estimates"]["els"]
assert sum(counts) >= stream["updates"] + stream["held"] > 100
""",
)
REASON = Change(
    {},
    {
        "results/reasons.py": (
            (
                "_TABLE: Final = (\n",
                '_TABLE: Final = (\n    ReasonKind("too_calm", 5, "samples", "Fly in wind."),\n',
            ),
        ),
        "results/judge_samples.py": (
            (
                '    needed, held = f"at least {100 * LEAST_STROKE:.0f} % is needed", ""\n',
                '    needed, held = f"at least {100 * LEAST_STROKE:.0f} % is needed", ""\n'
                '    yield Reason("too_calm", "no gust was found")\n',
            ),
        ),
    },
    RUN
    + """
found = json.loads(yawid("replay", LOG, "--out", "out", "--json"))
assert "too_calm" in [reason["id"] for reason in found["verdict"]["reasons"]]
schema = json.loads(yawid("schema"))
assert schema["x-reasons"]["too_calm"]["what_to_do"] == "Fly in wind."
assert "too_calm" in yawid("inspect", LOG)
""",
)
COMMAND = Change(
    {
        "cli/greet.py": '''
"""The command line of ``yawid greet``."""

import argparse
from typing import Any

from yawid.cli.options import add_command
from yawid.sinks.door import print_line


def add_greet(commands: Any) -> None:
    """Add the command to the parser's."""
    greet = add_command(commands, "greet", "", "say hello", "yawid greet")
    greet.set_defaults(run=_greet)


def _greet(arguments: argparse.Namespace) -> int:
    print_line("hello")
    return 0
'''
    },
    {
        "cli/main.py": (
            (
                "from yawid.cli.live import add_live\n",
                "from yawid.cli.greet import add_greet\nfrom yawid.cli.live import add_live\n",
            ),
            ("    add_trend(commands)\n", "    add_trend(commands)\n    add_greet(commands)\n"),
            ('("fleet", "trend", ', '("fleet", "greet", "trend", '),
        )
    },
    RUN
    + """
assert yawid("greet").strip() == "hello", yawid("greet")
assert "greet" in yawid("--help")
assert "greet" in yawid("completion", "bash")
""",
)
CHANGES = [
    pytest.param(FORMAT, 2, id="a log format", marks=pytest.mark.long),
    pytest.param(CHANNEL, 4, id="a channel", marks=pytest.mark.long),
    pytest.param(SINK, 2, id="a sink", marks=pytest.mark.long),
    pytest.param(REASON, 2, id="a reason", marks=pytest.mark.long),
    pytest.param(COMMAND, 2, id="a command"),
]


@pytest.mark.parametrize(("change", "most"), CHANGES)
def test_a_newcomer_touches_few_files(change: Change, most: int, tmp_path: Path) -> None:
    house = tmp_path / "src" / "yawid"
    shutil.copytree(SRC, house)
    for name, text in change.new.items():
        assert not (house / name).exists()
        (house / name).write_text(text.lstrip(), encoding="utf-8")
    for name, pairs in change.edited.items():
        text = (house / name).read_text(encoding="utf-8")
        for before, after in pairs:
            assert text.count(before) == 1, f"{name}: {before}"
            text = text.replace(before, after)
        (house / name).write_text(text, encoding="utf-8")

    proof = f"LOG = {str(C172P)!r}\n{change.proof}"
    environment = os.environ | {"PYTHONPATH": str(house.parent)}
    done = subprocess.run(
        [sys.executable, "-c", proof],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert change.touched <= most


def test_the_proof_of_a_change_fails_without_it(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", f"LOG = {str(C172P)!r}\n{COMMAND.proof}"],
        cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert "AssertionError" in done.stderr
