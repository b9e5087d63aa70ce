"""The systemd unit and the Dockerfile name what there is: options, files, an endpoint."""

from __future__ import annotations

import re
import shlex
import string
from pathlib import Path

from places import TOOLS

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
