"""The versions that stand in every run."""

from __future__ import annotations

import platform
import sys
from importlib import metadata
from pathlib import Path

import pytest

from yawid.runs.versions import LIBRARIES, versions


def test_the_versions_are_those_that_the_packages_first_on_the_path_tell_of_themselves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = {name: metadata.version(name) for name in ("yawid", *LIBRARIES)}
    assert versions() == told | {"python": platform.python_version()}

    first, second = tmp_path / "first", tmp_path / "second"
    egg = first / "of_an_egg-8.1.egg-info"
    for folder in (first / "rerun_sdk-9.1.dist-info", second / "Rerun.SDK-9.0.dist-info", egg):
        folder.mkdir(parents=True)
    text = "Metadata-Version: 2.1\nName: of-an-egg\nVersion: 8.1\n"
    (egg / "PKG-INFO").write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "path", [str(first), str(second), *sys.path])
    monkeypatch.setattr("yawid.runs.versions.LIBRARIES", ("rerun-sdk", "scipy", "of-an-egg"))
    expected = {"rerun-sdk": "9.1", "scipy": metadata.version("scipy"), "of-an-egg": "8.1"}
    assert expected.items() <= versions().items()
