"""``yawid completion``: what it prints is a script that the shell takes, and it completes."""

from __future__ import annotations

import subprocess
from pathlib import Path

from yawid.cli import main as command_line

COMMANDS = command_line.COMMANDS.keys()
PRESS_TAB = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
eval "$(complete -p yawid | sed 's/.*-F \\([^ ]*\\).*/\\1/') yawid"
printf '%s\\n' "${COMPREPLY[@]}"
"""


def script(shell: str, folder: Path, capsys) -> Path:
    """Write the script of a shell, and files of all kinds next to it."""
    assert command_line.main(["completion", shell]) == 0
    path = folder / f"yawid.{shell}"
    path.write_text(capsys.readouterr().out, encoding="utf-8")
    for name in ("a.tlog", "b.BIN", "c.mcap", "d.mcap.part", "e.toml", "f.html"):
        (folder / name).touch()
    (folder / "replay_logs").mkdir()
    return path


def offered(script: Path, *words: str) -> set[str]:
    """Return what bash offers for the last of these words of a command line."""
    done = subprocess.run(
        ["bash", "-c", PRESS_TAB, "bash", script, "yawid", *words],
        cwd=script.parent, capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    return set(done.stdout.split())


RUDDER = {"--rudder-sign", "--rudder-max-deg", "--rudder-unit", "--rudder-is"}
OFFERED = {
    "replay --rudder-": RUDDER,
    "replay --method = els --rudder-": RUDDER,
    "step --model ": {"first", "second", "yaw"},
    "replay --signing-key-file yawid.b": {"yawid.bash"},
    "replay --method ": {"els", "rml"},
    "replay --method =": {"els", "rml"},
    "replay --rerun = s": {"save", "spawn"},
    "replay --rerun s": {"save", "spawn"},
    "live --rerun s": {"save", "serve", "spawn"},
    "replay --also ": {"els", "rml", "none"},
    "inspect --inputs ": {"rudder", "rudder,aileron"},
    "fleet ": {"a.tlog", "b.BIN", "c.mcap", "d.mcap.part", "replay_logs"},
    "view ": {"c.mcap", "replay_logs"},
    "replay --config ": {"e.toml", "replay_logs"},
    "report c.mcap -o ": {"f.html", "replay_logs"},
    "trend ": {"replay_logs"},
}


def test_bash_takes_the_script_and_offers_commands_options_values_and_files(tmp_path: Path, capsys):
    bash = script("bash", tmp_path, capsys)

    assert subprocess.run(["bash", "-n", bash], check=False, timeout=60).returncode == 0
    assert offered(bash, "") >= COMMANDS >= {"replay", "live", "completion"}
    for typed, expected in OFFERED.items():
        assert offered(bash, *typed.split(" ")) == expected, typed


def test_zsh_s_script_has_every_command_value_and_file(tmp_path: Path, capsys):
    text = script("zsh", tmp_path, capsys).read_text(encoding="utf-8")

    assert text.startswith("#compdef yawid\n")
    assert all(f"    {command}:" in text for command in COMMANDS)
    assert ":(els rml)" in text
    assert ":_files -g '(*.toml|*.TOML)'" in text
