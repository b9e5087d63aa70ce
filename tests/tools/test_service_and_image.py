"""The systemd unit and the Dockerfile name what there is: options, files, an endpoint."""

from __future__ import annotations

import re
import shlex
import shutil
import string
import subprocess
from pathlib import Path

import pytest
from places import ROOT, TOOLS

from yawid.cli import main as command_line
from yawid.sources.link.endpoints import parse_endpoint

UNIT = (TOOLS / "yawid.service").read_text(encoding="utf-8")


def test_the_service_starts_a_live_tap_and_so_do_the_options_that_it_names():
    given = dict(re.findall(r"\b(YAWID_\w+)=(\S*)", re.findall("^Environment=.*", UNIT, re.M)[0]))
    (start,) = re.findall(r"^ExecStart=(.*)", UNIT, re.MULTILINE)
    other = dict(re.findall(r"^#   (YAWID_\w+)=(.*)", UNIT, re.MULTILINE))
    assert given.keys() == other.keys()

    for values in (given, other):
        words = shlex.split(string.Template(start).substitute(values))
        arguments = command_line.parsed(words[1:])
        parse_endpoint(arguments.endpoint)
        assert arguments.out == Path("/var/lib/yawid")
        assert arguments.request_rates is None


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="needs systemd-analyze")
def test_systemd_knows_every_line_of_the_unit(tmp_path: Path):
    unit = tmp_path / "yawid.service"
    unit.write_text(UNIT.replace("/opt/yawid/bin/yawid", "/bin/true"), encoding="utf-8")

    done = subprocess.run(
        ["systemd-analyze", "verify", unit],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip

    assert (done.returncode, done.stderr) == (0, "")


def test_the_image_copies_files_that_there_are():
    copied = re.findall(
        r"^COPY (?!--)(.*) \S+$", (TOOLS / "Dockerfile").read_text(encoding="utf-8"), re.MULTILINE
    )

    assert [name for name in " ".join(copied).split() if not (ROOT / name).exists()] == []
    assert "src" in copied


def test_image_and_service_install_the_wheel():
    image = (TOOLS / "Dockerfile").read_text(encoding="utf-8")
    assert "pip wheel" in image
    assert "--only-binary=:all: /dist/*.whl" in image
    assert "bin/pip install yawid-*.whl" in UNIT
