"""``yawid man``: a page that groff takes without a warning, with the manual's own sentences."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from yawid.cli import main as command_line
from yawid.cli.man_page import man_page

PARTS = {
    ("commands", "yawid a-b"): "Usage: a\n\n```sh\n.x -y\n```\n\nSee [there](x.md), **now**: `c`.",
    ("reasons", "odd"): "'Quoted' \\ and ±2.\n\nWhat to do:\n- this\n  and on\n- that",
    ("keys of --json", "k"): "left out",
}
BODY = r"""
.SH COMMANDS
.PP
.B yawid a\-b
.RS 4
.PP
Usage: a
.PP
.nf
\&.x \-y
.fi
.PP
See \fBthere\fP, \fBnow\fP: \fBc\fP.
.RE
.SH OPTIONS
.SH EXIT STATUS
.SH REASONS
.PP
.B odd
.RS 4
.PP
\&'Quoted' \e and \[u00B1]2.
.PP
What to do:
.IP \(bu 2
this and on
.IP \(bu 2
that
.RE
.SH TERMS
"""


def test_a_part_of_the_manual_as_roff():
    assert man_page("why", PARTS).endswith(BODY)


def test_groff_takes_the_page_and_every_command_is_on_it(capsys: pytest.CaptureFixture[str]):
    assert command_line.main(["man"]) == 0
    page = capsys.readouterr().out
    assert page.isascii()
    assert re.search(r"^\.B yawid replay$", page, re.MULTILINE)
    if not shutil.which("groff"):
        pytest.skip("groff is not installed")
    made = subprocess.run(
        ["groff", "-man", "-Tutf8", "-ww"],
        input=page,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert made.stderr == ""
    plain = re.sub(r"\x1b\[[\d;]*m|.\x08", "", made.stdout)
    assert "How does this aircraft's yaw answer its rudder" in plain
    assert re.search(r"EXIT STATUS\n +exit code 0", plain)
