"""What was learnt is kept from one session to the next, and only where it fits."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checks.children import free_udp_port
from live_link import (
    CONFIG,
    Screen,
    frames,
    listening,
    send,
    tlog_size,
    wait_for_size,
)

from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.estimation.armax import VERSION, RecursiveArmax
from yawid.runs.live import Console, Ended, LiveOptions, live
from yawid.runs.live import saved_state as state_file
from yawid.runs.live.saved_state import StateFile, check_states
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag


def fly(
    folder: Path, state: Path, name: str, sent: list[bytes], config: RunConfig = CONFIG
) -> tuple[Ended, str]:
    with listening(folder, config, Outputs(folder, name), state=state) as session:
        send(sent, session.port)
        wait_for_size(session.part("tlog", name), tlog_size(sent))
    [ended] = session.ended
    return ended, session.screen.getvalue()


def test_a_second_session_goes_on_from_where_the_first_ended(tmp_path: Path):
    state = tmp_path / "state"
    first, _ = fly(tmp_path, state, "one", frames(30.0))
    second, said = fly(tmp_path, state, "two", frames(7.0, first_s=500.0))

    learnt = first.summary.estimates["els"].updates
    assert f"resumed from {state}: {learnt} updates" in said
    assert second.summary.estimates["els"].updates > learnt
    theta = [e.summary.estimates["els"].theta["a1"] for e in (first, second)]
    assert theta[1] == pytest.approx(theta[0], abs=0.05)


def test_what_is_saved_is_the_estimator_to_the_bit(tmp_path: Path):
    state = tmp_path / "state"
    ended, _ = fly(tmp_path, state, "one", frames(30.0))
    _, _, body = state.read_bytes().partition(b"\n")
    theta = ended.summary.estimates["els"].theta
    size = len(body) // 2
    saved = RecursiveArmax.from_bytes(body[:size])
    np.testing.assert_array_equal(saved.theta, list(theta.values()))


def test_the_state_is_saved_while_the_session_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("yawid.runs.live.saved_state.SAVE_S", 0.1)
    state = tmp_path / "state"
    with listening(tmp_path, state=state) as session:
        send(frames(20.0), session.port)
        session.screen.wait_for("tracking")
        wait_for_size(state, 1)
        as_it_runs = state.read_bytes()
    body = as_it_runs.partition(b"\n")[2]
    assert RecursiveArmax.from_bytes(body[: len(body) // 2]).updates > 0
    assert not state.with_name("state.part").exists()


def test_another_vehicle_starts_anew_with_the_reason_and_the_old_state_is_kept(tmp_path: Path):
    state = tmp_path / "state"
    fly(tmp_path, state, "one", frames(30.0))
    old = state.read_bytes()
    ended, said = fly(tmp_path, state, "two", frames(20.0, sysid=7))

    assert (
        "does not fit this session, so estimation starts again: vehicle is 7/1, type 1, in the "
        "state 1/1" in said
    )
    assert (tmp_path / "state.old").read_bytes() == old
    assert state.read_bytes() != old
    assert ended.summary.estimates["els"].updates < 400

    # A file of that name stays, whoever put it there.
    second = state.read_bytes()
    fly(tmp_path, state, "three", frames(20.0))
    assert (tmp_path / "state.old").read_bytes() == old
    assert (tmp_path / "state.old-2").read_bytes() == second


def test_another_configuration_is_refused_at_once_with_the_reason(tmp_path: Path):
    state = tmp_path / "state"
    fly(tmp_path, state, "one", frames(15.0))
    with pytest.raises(ConfigError, match=r"configuration: memory is 30\.0, in the state 20\.0"):
        StateFile(state, replace(CONFIG, memory=30.0), print)


NO_SIZES = json.dumps(
    {"version": state_file.VERSION, "sizes": [7], "key": {"configuration": 0}, "saved_s": 0}
).encode()


@pytest.mark.parametrize("content", [b"", b"hello", b"{}\n", b'{"version": 1}\nabc', NO_SIZES])
def test_a_file_that_is_no_state_is_refused_and_left_alone(content: bytes, tmp_path: Path):
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="not a saved state"):
        StateFile(path, CONFIG, print)
    assert path.read_bytes() == content


def test_a_state_cut_short_is_refused(tmp_path: Path):
    state = tmp_path / "state"
    fly(tmp_path, state, "one", frames(15.0))
    state.write_bytes(state.read_bytes()[:-1])
    with pytest.raises(ConfigError, match="is incomplete"):
        StateFile(state, CONFIG, print)


def test_the_reference_engine_cannot_be_saved(tmp_path: Path):
    with pytest.raises(ConfigError, match="--engine numba"):
        StateFile(tmp_path / "state", replace(CONFIG, engine="filterpy"), print)
    with pytest.raises(ConfigError, match="--engine numba"):
        check_states(tmp_path / "state", replace(CONFIG, engine="filterpy"))


def test_a_state_that_cannot_be_written_is_one_line_and_exit_code_6(tmp_path: Path):
    folder = tmp_path / "gone"
    folder.mkdir()
    with listening(tmp_path, state=folder / "state") as session:
        folder.rmdir()
        send(frames(20.0), session.port)
        session.screen.wait_for("cannot write")
    assert session.ended[0].exit_code == 6
    assert session.screen.getvalue().count("cannot write") == 1


def rewritten(state: Path, old: str, new: str) -> None:
    """A state as another version would have written it: in the sizes that its head says."""
    head, _, body = state.read_bytes().partition(b"\n")
    assert old.encode() in head + body
    assert len(old) == len(new)
    state.write_bytes(head.replace(old.encode(), new.encode()) + b"\n" + body.replace(
        old.encode(), new.encode()
    ))  # fmt: skip


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """What a session has learnt of system 1."""
    fly(tmp_path, tmp_path / "state", "before", frames(15.0))
    return tmp_path / "state"


@pytest.mark.parametrize("every_vehicle", [False, True])
@pytest.mark.parametrize(
    ("old", "new"),
    [
        (state_file.VERSION, state_file.VERSION[:-1] + "0"),
        (VERSION, VERSION[:-1] + "0"),
        ('"config": {"orders"', '"config": {"order_"'),
    ],
)
def test_a_state_of_another_version_is_refused_before_anything_is_received(
    old: str, new: str, every_vehicle: bool, state: Path
):
    rewritten(state, old, new)
    content = state.read_bytes()
    if every_vehicle:
        state.rename(state.with_name("state-1"))
    options = LiveOptions(
        f"udpin:127.0.0.1:{free_udp_port()}", seconds=0.1, state=state, every_vehicle=every_vehicle
    )
    screen = Screen()
    with pytest.raises(
        ConfigError, match="to start again, remove it or give another file"
    ) as refused:
        live(options, CONFIG, Outputs(state.parent / "out", "x"), StopFlag(), Console(screen))
    assert "\n" not in str(refused.value)
    assert "listening" not in screen.getvalue()
    assert list((state.parent / "out").iterdir()) == []
    assert state.with_name("state-1" if every_vehicle else "state").read_bytes() == content


@pytest.mark.parametrize("every_vehicle", [False, True])
@pytest.mark.parametrize("place", ["gone/state", "file/state"])
def test_a_state_that_cannot_be_written_is_refused_before_anything_is_received(
    place: str, every_vehicle: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "file").write_text("", encoding="utf-8")
    sysid = ["--sysid", "all"] if every_vehicle else []
    endpoint = f"udpin:127.0.0.1:{free_udp_port()}"
    arguments = ["--state", str(tmp_path / place), "--out", str(tmp_path / "out"), *sysid]
    code = main(["live", endpoint, "--seconds", "0.1", *arguments])
    said = capsys.readouterr()
    assert (code, said.out) == (6, "")
    assert said.err.count("\n") == 1
    assert str(tmp_path / place) in said.err
