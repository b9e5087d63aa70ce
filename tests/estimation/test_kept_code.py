"""Machine code is loaded from nobody's file but the user's own and root's."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from yawid.cli.main import main
from yawid.estimation import kernel
from yawid.estimation.machine import kept
from yawid.estimation.machine.object_code import processor

NAME, CODE = "some_code", b"what a processor runs"
NOBODY = 65534


@pytest.fixture(autouse=True)
def own_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The user's cache and the named folder lie in a folder of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "users"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "outer/named"))


@pytest.fixture
def code(tmp_path: Path) -> Path:
    """The file of code that was kept in the named folder."""
    assert kept.keep(NAME, CODE) == tmp_path / "outer/named"
    assert kept.find(NAME) == CODE
    [path] = (tmp_path / "outer/named").glob("*.code")
    return path


def of_another(path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can give a file away")
    os.chown(path, NOBODY, -1)


def linked(path: Path) -> None:
    path.symlink_to(path.rename(path.with_name("elsewhere")))


def a_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def cut_to(size: int) -> Callable[[Path], None]:
    return lambda path: os.truncate(path, size)


@pytest.mark.parametrize(
    "spoil",
    [
        of_another, linked, a_pipe, lambda path: path.chmod(0o664), lambda path: path.chmod(0o646),
        *map(cut_to, (0, 31, 32 + len(CODE) - 1)),
    ],
    ids=[
        "another's", "a link", "a pipe, which is not waited for", "writable for the group",
        "writable for others",
        "empty", "shorter than its digest", "cut",
    ],
)  # fmt: skip
def test_a_file_that_another_could_have_written_is_not_loaded_but_made_again(
    code: Path, spoil: Callable[[Path], None]
) -> None:
    """Nor one that is damaged."""
    spoil(code)

    assert kept.find(NAME) is None
    assert kept.keep(NAME, CODE) == code.parent
    assert kept.find(NAME) == CODE
    assert stat.S_ISREG(code.lstat().st_mode)


@pytest.mark.parametrize(
    "spoil",
    [
        of_another,
        lambda path: path.chmod(0o775),
        lambda path: path.chmod(0o1777),
        lambda path: of_another(path.parent),
        lambda path: path.parent.chmod(0o777),
    ],
    ids=["another's", "of a group", "sticky", "in another's", "in one for all"],
)
def test_nothing_is_loaded_from_a_folder_that_another_can_write_to(
    code: Path, tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    spoil(code.parent)

    assert kept.find(NAME) is None
    assert kept.keep(NAME, CODE) == tmp_path / "users" / "yawid"
    assert kept.find(NAME) == CODE
    for folder in (tmp_path / "users", tmp_path / "users" / "yawid"):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert (kept.passed_by() or "").startswith("NUMBA_CACHE_DIR is not used: ")


def test_a_folder_in_one_for_all_whose_files_stay_their_owners_counts_and_so_does_a_link_to_it(
    code: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path.chmod(0o1777)  # as /tmp is
    (tmp_path / "link").symlink_to(tmp_path / "outer/named")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "link"))

    assert (kept.find(NAME), kept.passed_by()) == (CODE, None)
    (tmp_path / "outer/named").chmod(0o777)
    assert kept.find(NAME) is None


def test_with_an_umask_for_a_group_the_packages_own_folder_is_passed_by(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setattr(kept, "__file__", str(tmp_path / "package" / "kept.py"))
    before = os.umask(0o002)
    try:
        (tmp_path / "package" / "__pycache__").mkdir(parents=True, mode=0o777)
        (tmp_path / "package").chmod(0o755)
        kept._version.cache_clear()
        assert kept.keep(NAME, CODE) == tmp_path / "users" / "yawid"
        [path] = (tmp_path / "users" / "yawid").iterdir()
    finally:
        os.umask(before)
        kept._version.cache_clear()
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_a_relative_cache_home_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "outer/named").mkdir(parents=True)
    (tmp_path / "outer/named").chmod(0o777)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "outer/named")
    monkeypatch.chdir(tmp_path)

    assert kept.keep(NAME, CODE) == tmp_path / ".cache" / "yawid"


def test_the_first_replay_on_a_terminal_says_which_folder_it_passed_by(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "outer/named").mkdir(parents=True)
    (tmp_path / "outer/named").chmod(0o1777)
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    monkeypatch.setattr("yawid.estimation.machine.runner.RUNNER.compile_behind", lambda: True)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)

    assert main(["replay", "missing.tlog"]) == 6
    first, second, _ = capsys.readouterr().err.splitlines()
    assert first.startswith("yawid: first run: the estimators are being compiled")
    reason = f"{tmp_path / 'outer/named'} can be written to by others"
    assert second == f"yawid: NUMBA_CACHE_DIR is not used: {reason}"


@pytest.mark.parametrize(
    "other",
    [
        lambda patch: patch.setenv("NUMBA_CPU_NAME", f"not-{processor()[0]}"),
        lambda patch: patch.setenv("NUMBA_CPU_FEATURES", f"{processor()[1]},-avx"),
        lambda patch: patch.setattr(sys, "platform", "another"),
        lambda patch: patch.setattr(kernel, "__file__", "/nowhere/kernel/__init__.py"),
        lambda patch: patch.setattr(kept, "__file__", "/nowhere/machine/kept.py"),
    ],
    ids=["processor", "features", "Python", "kernel", "compiler"],
)
def test_each_processor_and_each_of_its_features_has_code_of_its_own(
    code: Path, monkeypatch: pytest.MonkeyPatch, other: Callable[[pytest.MonkeyPatch], None]
) -> None:
    """As each Python, and each version of the kernel and of its compiler, has."""
    with monkeypatch.context() as context:
        other(context)
        kept._version.cache_clear()
        assert kept.find(NAME) is None
        assert kept.keep(NAME, b"of the other") == code.parent
    kept._version.cache_clear()
    assert kept.find(NAME) == CODE
