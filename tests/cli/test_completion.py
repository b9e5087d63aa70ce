"""``yawid completion``: what it prints is a script that the shell takes, and it completes."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from shell import Shell

from yawid.cli import main as command_line

COMMANDS = command_line.COMMANDS.keys()
PRESS_TAB = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
eval "$(complete -p yawid | sed 's/.*-F \\([^ ]*\\).*/\\1/') yawid"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def script(request: pytest.FixtureRequest, tmp_path: Path, capsys) -> Path:
    """The script of the shell that the parameter names, of bash without one."""
    shell = getattr(request, "param", "bash")
    assert command_line.main(["completion", shell]) == 0
    path = tmp_path / {"bash": "yawid.bash", "zsh": "_yawid"}[shell]
    path.write_text(capsys.readouterr().out, encoding="utf-8")
    return path


in_zsh = pytest.mark.parametrize("script", ["zsh"], indirect=True)


def offered(script: Path, *words: str) -> set[str]:
    """Return what bash offers for the last of these words of a command line."""
    done = subprocess.run(
        ["bash", "-c", PRESS_TAB, "bash", script, "yawid", *words],
        cwd=script.parent, capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    return set(done.stdout.split())


def files_of(folder: Path) -> None:
    """Write files of all kinds, and a case, to a folder."""
    for name in ("a.tlog", "b.BIN", "c.mcap", "d.mcap.part", "e.toml", "f.html"):
        (folder / name).touch()
    (folder / "replay_logs" / "climb").mkdir(parents=True)
    (folder / "replay_logs" / "climb" / "case.toml").touch()


def test_bash_takes_the_script_and_offers_every_command(script: Path):
    assert subprocess.run(["bash", "-n", script], check=False, timeout=60).returncode == 0
    assert offered(script, "") >= COMMANDS >= {"replay", "live", "completion"}


RUDDER = {"--rudder-sign", "--rudder-max-deg", "--rudder-unit", "--rudder-is"}


def test_bash_offers_options_choices_and_files(script: Path):
    assert offered(script, "replay", "--rudder-") == RUDDER
    assert offered(script, "step", "--model", "") == {"first", "second", "yaw"}
    assert offered(script, "replay", "--signing-key-file", "yawid.b") == {"yawid.bash"}


@in_zsh
def test_zsh_s_script_has_every_command(script: Path):
    text = script.read_text(encoding="utf-8")

    assert text.startswith("#compdef yawid\n")
    assert all(f"    {command}:" in text for command in COMMANDS)
    assert ":(els rml)" in text
    assert ":_files -g '(*.toml|*.TOML)'" in text


@in_zsh
@pytest.mark.skipif(shutil.which("zsh") is None, reason="needs zsh")
def test_zsh_offers_commands_options_values_files_and_cases(script: Path):
    """In a terminal of its own, with the Tab key; Ctrl-X shows the line and empties it."""
    files_of(script.parent)
    begin = (
        f"cd {script.parent}; fpath=($PWD $fpath); autoload -Uz compinit; compinit -u -D;"
        " unsetopt zle_bracketed_paste; LISTMAX=999;"
        ' show() { print -r "[$BUFFER]"; BUFFER=; zle redisplay }; zle -N show; bindkey "^X" show;'
        " print ready$((1 + 1))\r"
    )
    with Shell("zsh", "-f", "-i") as shell:
        shell.type(begin, r"ready2\r\n(?s:.)*> ")

        def offers(line: str) -> set[str]:
            """Return the words that are listed, or put in, after Tab at the end of a line."""
            seen = shell.type(f"yawid {line}\t\x18", r"\[yawid .*\]")
            # Enter ends the list, which the shell may write once more below the next line.
            shell.type("print next$((1 + 1))\r", r"next2\r\n(?s:.)*> ")
            return set(re.split(r"\x1b\[[\d;?]*[A-Za-z]|[]\s]", seen))

        assert offers("") >= COMMANDS
        assert offers("replay --rudder-") >= RUDDER
        assert offers("replay --method ") >= {"els", "rml"}
        assert offers("replay --method=") >= {"els", "rml"}
        assert offers("replay --maneuvers=") >= {"auto", "off"}
        assert offers("replay --rudder-sign nose-right --method ") >= {"els", "rml"}
        assert offers("replay --rerun s") >= {"save", "spawn"}
        logs = {"a.tlog", "b.BIN", "c.mcap", "d.mcap.part", "replay_logs/"}
        assert (of_replay := offers("replay ")) >= logs
        assert not of_replay & {"e.toml", "f.html"}
        assert not (of_view := offers("view ")) & {"a.tlog", "b.BIN"}
        assert of_view >= {"c.mcap", "replay_logs/"}
        assert offers("replay --config ") >= {"e.toml", "replay_logs/"}


def test_another_shell_is_refused_by_name(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as ended:
        command_line.main(["completion", "fish"])

    assert ended.value.code == 2
    assert "fish" in capsys.readouterr().err


def test_bash_offers_values_files_by_their_suffix_and_cases(script: Path):
    assert offered(script, "replay", "--method", "") == {"els", "rml"}
    assert offered(script, "replay", "--method", "=") == {"els", "rml"}
    assert offered(script, "replay", "--rerun", "=", "s") == {"save", "spawn"}
    assert offered(script, "replay", "--method", "=", "els", "--rudder-") == RUDDER
    assert offered(script, "replay", "--also", "") == {"els", "rml", "none"}
    assert offered(script, "replay", "--rerun", "s") == {"save", "spawn"}
    assert offered(script, "inspect", "--inputs", "") == {"rudder", "rudder,aileron"}
    files_of(script.parent)
    assert offered(script, "replay", "") == {
        "a.tlog", "b.BIN", "c.mcap", "d.mcap.part", "replay_logs",
    }  # fmt: skip
    assert offered(script, "fleet", "") == offered(script, "replay", "")
    assert offered(script, "view", "") == {"c.mcap", "replay_logs"}
    assert offered(script, "replay", "--config", "") == {"e.toml", "replay_logs"}
    assert offered(script, "report", "c.mcap", "-o", "") == {"f.html", "replay_logs"}
    assert offered(script, "trend", "") == {"replay_logs"}
