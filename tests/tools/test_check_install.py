"""What check_install.py goes by, without installing: that is for tools/check.py --long."""

from __future__ import annotations

import tomllib

from places import ROOT, SRC

from yawid.version import __version__

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_what_the_package_holds_besides_modules_is_packed_and_nothing_else():
    packed = {
        path
        for package, patterns in PROJECT["tool"]["setuptools"]["package-data"].items()
        for pattern in patterns
        for path in (SRC.parent / package.replace(".", "/")).glob(pattern)
    }
    files = {path for path in SRC.rglob("*") if path.is_file() and "__pycache__" not in path.parts}

    assert {path for path in files if path.suffix != ".py"} == packed


def test_version_py_alone_has_the_version_and_the_changes_begin_with_it():
    changes = (SRC / "manual" / "changes.md").read_text(encoding="utf-8")
    assert f" {__version__} " in changes.partition("\n")[0]
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert 'version = { attr = "yawid.version.__version__" }' in project
    assert __version__ not in project
