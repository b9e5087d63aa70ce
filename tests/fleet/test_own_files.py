"""A fleet removes, moves and overwrites its own files and no others."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from places import REPLAY_LOGS

from yawid.cli.main import main
from yawid.dataset.files import merge, read_table
from yawid.errors import YawidError
from yawid.fleet.journal import FINISHED, Journal

KEYS = {"yawid_version": "0", "analysis_version": "1", "config_hash": "c"}
MAY = 1_780_000_000_000_000  # 2026-05-28


def entry(path: str, sha: str) -> dict[str, list[dict[str, object]]]:
    log = {"path": path, "log_sha256": sha, "outcome": "ok", **KEYS}
    flight = {"log_sha256": sha, "sysid": 1, "boot": 1, "vehicle": "sysid:1", "date": MAY, **KEYS}
    return {"logs": [log], "flights": [flight]}


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Logs with what else lies next to them."""
    (tmp_path / "logs" / "flights").mkdir(parents=True)
    shutil.copy(REPLAY_LOGS / "no_rudder" / "log.tlog", tmp_path / "logs" / "a.tlog")
    for name in ("my_flight.parquet", "live.tlog.part", "flights/part-000001-0.parquet"):
        (tmp_path / "logs" / name).write_text("mine", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
@pytest.mark.parametrize(
    ("logs", "out"),
    [
        ("logs", "."),
        ("logs", "logs"),
        ("logs/a.tlog", "."),
        ("*/*.tlog", "logs"),
        ("file://{place}/logs", "."),
        ("link", "."),
        ("logs", "logs/data"),
        (".", "data"),
        ("**/*.tlog", "data"),
    ],
)
def test_a_data_set_that_holds_the_logs_or_is_held_by_them_is_refused_and_nothing_is_touched(
    place: Path,
    logs: str,
    out: str,
    dry: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(place)
    (place / "link").symlink_to(place / "logs")
    before = contents(place)

    assert main(["fleet", logs.format(place=place), "--out", out, *dry]) == 2
    said = capsys.readouterr().err
    assert f"--out {out} " in said
    assert said.count("\n") == 1
    assert contents(place) == before


@pytest.mark.parametrize(
    "names",
    [
        ["logs/part-000001-0.parquet", "flights/mine.parquet"],
        ["schema.json"],
        ["SCHEMA.md", "logs/readme"],
        ["manifest.json"],
        ["finished.jsonl"],
    ],
)
@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
def test_a_folder_without_our_manifest_is_no_data_set_whatever_its_files_are_called(
    place: Path, names: list[str], dry: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = place / "theirs"
    for name in names:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text('{"format": 1, "files": ["a.js"]}\n', encoding="utf-8")
    before = contents(out)

    assert main(["fleet", str(place / "logs"), "--out", str(out), *dry]) == 6
    assert capsys.readouterr().err.count("\n") == 1
    assert contents(out) == before


def test_a_manifest_that_names_files_elsewhere_is_refused(tmp_path: Path) -> None:
    merge(tmp_path / "data", [entry("/a", "A")])
    path = tmp_path / "data" / "manifest.json"
    manifest = json.loads(path.read_bytes())
    manifest["tables"]["flights"]["files"][0]["path"] = "flights/../../mine.parquet"
    path.write_text(json.dumps(manifest), encoding="utf-8")

    with pytest.raises(YawidError, match="is not a data set's manifest: it names flights/"):
        read_table(tmp_path / "data", "flights")


def test_what_lies_in_a_data_set_and_is_not_its_own_stays_when_it_is_swept(tmp_path: Path) -> None:
    merge(tmp_path, [entry("/a", "A")])
    month = tmp_path / "flights" / "month=2026-05"
    others = (
        month / "mine.parquet",
        month / "part-000001-0.parquet.bak",
        tmp_path / "flights" / "month=all" / "part-000001-0.parquet",
        tmp_path / "flights" / "part-000001-0.parquet",
        tmp_path / "logs" / "live.tlog.part",
        tmp_path / "logs" / "a.parquet",
    )
    for path in others:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine", encoding="utf-8")
    left = month / "part-000009-0.parquet"
    left.write_text("left by a run that was killed", encoding="utf-8")

    merge(tmp_path, [entry("/b", "B")])
    Journal(tmp_path).close()

    assert {path.read_text(encoding="utf-8") for path in others} == {"mine"}
    assert not left.exists()
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A", "B"]
    assert not (tmp_path / FINISHED).exists()
