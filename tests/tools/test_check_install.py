"""What check_install.py goes by, without installing: that is for tools/check.py --long."""

from __future__ import annotations

import re
from importlib.metadata import version

from checks.check_install import DATA, newest_allowed, oldest_allowed
from places import ROOT, SRC

from yawid.version import __version__


def test_every_library_has_a_lower_bound_that_can_be_tried():
    assert [each for each in oldest_allowed() if not re.fullmatch(r"[\w-]+==\d[\d.]*", each)] == []


def test_numba_and_its_llvmlite_have_upper_bounds_and_the_newest_pair_is_the_one_tested_here():
    here = [f"{name}=={version(name).rpartition('.')[0]}.*" for name in ("numba", "llvmlite")]
    assert newest_allowed() == here


def test_what_the_package_holds_besides_modules_is_known_and_packed():
    files = {path for path in SRC.rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    others = {path for path in files if path.suffix != ".py"}

    assert {path.relative_to(SRC.parent).as_posix() for path in others} == DATA


def test_version_py_alone_has_the_version_and_the_changes_begin_with_it():
    changes = (SRC / "manual" / "changes.md").read_text(encoding="utf-8")
    assert f" {__version__} " in changes.partition("\n")[0]
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert 'version = { attr = "yawid.version.__version__" }' in project
    assert __version__ not in project
