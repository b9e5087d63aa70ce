from __future__ import annotations

import errno
import sys
from hashlib import sha256
from pathlib import Path

import pytest
from finished_runs import replayed
from places import REPLAY_LOGS

from yawid.config.run import RunConfig
from yawid.dataset.files import table_of
from yawid.dataset.schema import TABLES
from yawid.fleet.one_log import Rows, rows_here, rows_of
from yawid.fleet.spec import Spec


def log_of(case: str) -> Path:
    return REPLAY_LOGS / case / "log.tlog"


def rows_in_tables(path: Path, spec: Spec) -> Rows:
    """Return rows after a look whether they fit the tables, each key once."""
    rows = rows_of(path, spec)
    for name, each in rows.items():
        table_of(TABLES[name], each)
        keys = [tuple(row.get(key) for key in TABLES[name].keys) for row in each]
        assert len(set(keys)) == len(keys)
    return rows


@pytest.mark.parametrize(
    ("case", "whose"),
    [("two_vehicles", [(1, 1), (2, 1)]), ("c172p_reboot", [(1, 1), (1, 2)])],
)
def test_each_vehicle_and_each_boot_of_a_log_is_a_flight(
    case: str, whose: list[tuple[int, int]]
) -> None:
    rows = rows_in_tables(log_of(case), Spec())

    assert [(row["sysid"], row["boot"]) for row in rows["flights"]] == whose
    assert {(row["sysid"], row["boot"]) for row in rows["manoeuvres"]} == set(whose)
    assert len(rows["runs"]) == 2 * len(whose)
    assert rows["logs"][0]["flights"] == len(whose)
    assert all(row["usable"] for row in rows["flights"])


def test_what_was_asked_for_binds_every_log_and_seconds_are_kept_where_wanted() -> None:
    settings = {"boot": 2, "manoeuvres": "off", "orders": (2, 2, 2, 1)}
    rows = rows_in_tables(log_of("c172p_reboot"), Spec(settings, modes=True))

    (flight,) = rows["flights"]
    assert (flight["boot"], flight["answer"]) == (2, "stream")
    assert {row["na"] for row in rows["runs"]} == {2}
    assert flight["duration_s"] == pytest.approx(len(rows["modes"]), abs=2)
    assert rows["modes"][-1]["wn_rad_s"] == pytest.approx(flight["wn_rad_s"], rel=0.05)
    assert not rows["manoeuvres"]


def test_a_finished_run_gives_the_manoeuvres_of_its_log_under_the_logs_own_hash(
    tmp_path: Path,
) -> None:
    log = log_of("sitl_fbwa_manoeuvres")
    mcap = replayed(log, tmp_path)

    of_log, of_mcap = rows_in_tables(log, Spec()), rows_in_tables(mcap, Spec())

    assert of_mcap["manoeuvres"] == of_log["manoeuvres"]
    assert of_mcap["logs"][0]["log_sha256"] == of_log["logs"][0]["log_sha256"]
    assert of_mcap["logs"][0]["file_sha256"] != of_log["logs"][0]["file_sha256"]
    assert of_log["logs"][0]["outcome"] == of_mcap["logs"][0]["outcome"] == "ok"


def test_whatever_is_wrong_with_a_log_is_an_outcome_with_its_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def told(path: Path, spec: Spec) -> tuple[str, list[str], str]:
        row = rows_in_tables(path, spec)["logs"][0]
        return row["outcome"], row["reasons"], row["text"]

    text = tmp_path / "text.tlog"
    text.write_text("no log\n", encoding="utf-8")
    outcome, reasons, said = told(text, Spec())
    assert (outcome, reasons) == ("unreadable", ["unreadable"])
    assert said.startswith("text.tlog is a text file")
    outcome, reasons, said = told(log_of("no_rudder"), Spec())
    assert (outcome, reasons) == ("unusable", ["no_rudder"])
    outcome, reasons, said = told(log_of("c172p_3211"), Spec({"rate": 500.0}))
    assert (outcome, reasons) == ("usage", ["usage"])
    monkeypatch.setattr("yawid.fleet.one_log.open_log", lambda *_, **__: 1 / 0)
    outcome, reasons, said = told(log_of("no_rudder"), Spec())
    assert (outcome, reasons) == ("crashed", ["crashed"])
    assert said.startswith("ZeroDivisionError: division by zero (test_one_log.py:")


def test_what_a_machine_or_a_store_lacks_is_failed_and_says_nothing_of_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def told(rows: Rows) -> tuple[str, str]:
        return rows["logs"][0]["outcome"], rows["logs"][0]["text"]

    (tmp_path / "broken.tlog").symlink_to("/proc/self/mem")  # its first byte: EIO
    key = tmp_path / "key"
    key.write_text("one\n", encoding="utf-8")
    spec = Spec(key_file=str(key))

    outcome, said = told(rows_of(tmp_path / "broken.tlog", Spec()))
    assert (outcome, "Input/output error" in said) == ("failed", True)
    logs = REPLAY_LOGS / "no_rudder"
    with monkeypatch.context() as patched:
        patched.setattr("shutil.copyfileobj", full)
        outcome, said = told(rows_here(f"file://{logs}/log.tlog", Spec(), tmp_path))
    assert (outcome, said.partition(" be ")[2]) == ("failed", "read: No space left on device")
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]
    outcome, said = told(rows_here(f"file://{logs}/absent.tlog", Spec(), tmp_path))
    assert (outcome, said.partition(" be ")[2]) == ("failed", "read: No such file or directory")
    outcome, said = told(rows_here(f"{logs}/absent.tlog", Spec(), tmp_path))
    assert (outcome, "No such file or directory" in said) == ("failed", True)
    ulog = tmp_path / "a.ulg"
    ulog.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8))
    with monkeypatch.context() as patched:
        patched.setitem(sys.modules, "pyulog", None)
        outcome, said = told(rows_of(ulog, Spec()))
    assert (outcome, "needs pyulog (pip install 'yawid[ulog]')" in said) == ("failed", True)
    key.write_text("other\n", encoding="utf-8")
    assert told(rows_of(log_of("no_rudder"), spec)) == (
        "failed",
        f"signing key file {key}: it holds another key than when the fleet was started",
    )
    key.unlink()
    assert told(rows_of(log_of("no_rudder"), spec)) == (
        "failed",
        f"signing key file {key}: No such file or directory",
    )


def test_of_a_key_its_content_is_in_the_hash_and_not_its_path_or_spelling(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a", "b", "c")]
    for path, text in zip(paths, ("one\n", "one", sha256(b"one").hexdigest()), strict=True):
        path.write_text(text, encoding="utf-8")

    def hashes() -> list[str]:
        return [Spec(key_file=str(path)).config_hash for path in paths]

    one = hashes()
    assert len({*one, Spec().config_hash}) == 2
    paths[0].write_text("two\n", encoding="utf-8")
    assert hashes()[0] not in (one[0], Spec().config_hash)
    assert hashes()[1:] == one[1:]


def test_equal_options_have_equal_hashes_however_they_are_given() -> None:
    whole = {name: getattr(RunConfig(), name) for name in ("method", "turn", "rate")}

    assert Spec(whole).config_hash == Spec().config_hash
    assert Spec({"turn": "remove"}).config_hash != Spec().config_hash
    assert Spec(modes=True).config_hash != Spec().config_hash
