"""What cannot be done is one line that says why, and a code; no file is written or changed.

Command lines that the parser refuses stand in ``wrong_usages.txt``, each above its line.
"""

from __future__ import annotations

import os
import shlex
import shutil
import socket
from pathlib import Path

import pytest
from checks.children import free_udp_port
from finished_runs import replayed
from places import C172P, REPLAY_LOGS
from printed import ended

LINES = (Path(__file__).parent / "wrong_usages.txt").read_text(encoding="utf-8").splitlines()
TABLE = list(zip(LINES[::2], LINES[1::2], strict=True))


def test_a_wrong_command_line_is_one_line_with_what_to_do_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    assert len({typed for typed, _ in TABLE}) == len(TABLE) >= 180
    for typed, expected in TABLE:
        code = ended(shlex.split(typed.removeprefix("$ yawid")))
        said = capsys.readouterr()
        assert (code, said.out, said.err) == (2, "", f"yawid: {expected}\n"), typed
    assert list(tmp_path.iterdir()) == []


FILES = {
    "empty.tlog": "", "text.tlog": "Build started.\nBuild succeeded.\n" * 40, "text.mcap": "hello",
    "mine.rrd": "mine", "mine.csv": "mine", "a.csv": "a,b\n1,2\n", "word.csv": "t,y\n1,x\n",
    "logs/my_flight.parquet": "mine", "logs/live.tlog.part": "mine",
    "logs/flights/part-000001-0.parquet": "mine", "theirs/notes.txt": "mine",
    "theirs1/logs.parquet": "mine", "theirs1/flights/mine.parquet": "mine",
    "theirs2/schema.json": "{}",
    "theirs3/SCHEMA.md": "mine", "theirs3/logs/readme": "mine", "theirs4/fleet.sqlite": "mine",
    "theirs5/fleet.sqlite-journal": "mine", "theirs5/mine": "mine",
    "file.toml": 'vehicle-from = "file"\n',
    "url.toml": 'out = "file:///tmp/day"\n',
    "two.toml": 'vehicle = "a"\nvehicle-from = "folder"\n',
}  # fmt: skip
"""What is no log, no run and no data set, next to some that are, and what a user has of his own."""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("place")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    replayed(C172P, folder, "--rate", 10)
    shutil.copy(C172P, folder)
    for name in ("no_rudder.tlog", "logs/a.tlog"):
        shutil.copy(REPLAY_LOGS / "no_rudder" / "log.tlog", folder / name)
    shutil.copy(REPLAY_LOGS / "c172p_reboot" / "log.tlog", folder / "reboot.tlog")
    os.mkfifo(folder / "fifo.tlog")
    (folder / "dangling.tlog").symlink_to("nowhere")
    (folder / "link").symlink_to(folder / "logs")
    return folder


def contents(folder: Path) -> dict[Path, bytes]:
    return {each: each.read_bytes() if each.is_file() else b"" for each in folder.rglob("*")}


UNREADABLE = ("empty.tlog", "text.tlog", ".", "missing.tlog", "fifo.tlog", "/dev/zero",
              "dangling.tlog")  # fmt: skip
OF_RUNS = ("--rate 5", "--rudder servo:2", "--inputs rudder,aileron")
HELD = (
    ("logs", "."), ("logs", "logs"), ("logs/a.tlog", "."), ("*/*.tlog", "logs"), ("link", "."),
    ("file://{place}/logs", "."), ("logs", "logs/data"), (".", "data"), ("**/*.tlog", "data"),
)  # fmt: skip
"""Logs, and a data set that would hold them or be held by them."""
BOTH = "give --vehicle or --vehicle-from, not both"
REFUSED = [
    *((f"{command} {name}", 6, name) for command in ("replay", "inspect") for name in UNREADABLE),
    ("replay log.tlog --out empty.tlog/out --json", 6, "empty.tlog/out"),
    ("replay log.tlog --out theirs --memory 1e-9", 2, "--memory 1e-09 is far below one sample"),
    ("replay log.tlog --out theirs --rate 80", 2, "--rate 50"),
    ("replay log.tlog --out theirs --boot 7", 2, "the log, which holds 1 boot: 30.0 to 150.0 s"),
    ("replay log.tlog --config url.toml", 2, "'file:///tmp/day' is a URL, but a path"),
    ("inspect reboot.tlog --boot 7", 2, "the log, which holds 2 boots: boot 1 from "),
    ("inspect log.mcap", 6, "log.mcap is an MCAP file, not a telemetry log"),
    ("orders no_rudder.tlog", 3, "no_rudder"),
    # Of a run's own samples.
    *((f"replay log.mcap --out out {each}", 2, "replay the log itself") for each in OF_RUNS),
    ("replay log.mcap --out theirs --from 1e6 --to 2e6", 2, "--to 2e+06 is outside log.mcap"),
    ("view log.mcap", 6, "no screen"),
    ("view log.mcap --to rerun+http://127.0.0.1:9/proxy", 6, "viewer"),
    ("view log.mcap --out mine.rrd", 6, "mine.rrd exists: --force overwrites it"),
    ("view text.mcap --out x.rrd", 6, "text.mcap"),
    ("view missing.mcap --out x.rrd", 6, "missing.mcap"),
    ("report text.mcap", 6, "text.mcap"),
    ("report missing.mcap", 6, "missing.mcap"),
    ("export log.mcap -o mine.csv", 6, "--force"),
    ("export absent.tlog -o x.csv", 6, "does not exist"),
    ("simulate lateral --seconds 30 --out mine.csv", 6, "mine.csv exists: --force"),
    ("simulate lateral --seconds 30 --out log.mcap", 6, "log.mcap exists: --force"),
    ("step a.csv", 2, "a.csv"),
    ("step word.csv", 2, "'x' is not a number"),
    ("step empty.tlog", 2, "empty.tlog"),
    ("step missing.csv", 6, "missing.csv"),
    ("live log.tlog", 2, "is a file, not a live link: use yawid replay for a log"),
    ("live udpin:127.0.0.1:{busy} --out theirs", 6, "in use"),
    ("live udpin:127.0.0.1:{free} --out empty.tlog", 6, "cannot write"),
    # A data set of one's own logs, in a place of its own.
    ("fleet nowhere --out data", 6, "nowhere: no such file or folder"),
    ("fleet theirs --out data", 6, "theirs: no log was found there; the names of logs end in .tlo"),
    ("fleet log.tlog --out data --config two.toml", 2, BOTH),
    ("fleet log.tlog --out data --config file.toml", 2, "must be one of folder, got 'file'"),
    ("fleet log.tlog --out data --vehicle '\t'", 2, "must be a name that can be printed, got"),
    ("fleet log.tlog --out data --vehicle 'a\x1b[2J'", 2, "--vehicle must be a name"),
    *((f"fleet {logs} --out {out}{dry}", 2, f"--out {out} ")
      for logs, out in HELD for dry in ("", " --dry-run")),
    # A folder without our database is none, whatever its files are called.
    *((f"fleet logs --out theirs{n}{dry}", 6, f"theirs{n} is not empty and is not a data set")
      for n in ("", *range(1, 6)) for dry in ("", " --dry-run")),
]  # fmt: skip


@pytest.mark.parametrize(("typed", "code", "said"), REFUSED, ids=[typed for typed, *_ in REFUSED])
def test_what_cannot_be_done_is_one_line_with_its_cause_and_touches_no_file(
    typed: str, code: int, said: str, place: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(place)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    before = contents(place)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        words = shlex.split(
            typed.format(place=place, busy=taken.getsockname()[1], free=free_udp_port())
        )
        assert ended(words) == code
    out, line = capsys.readouterr()
    assert (out, line.count("\n")) == ("", 1)
    assert said in line
    assert contents(place) == before
