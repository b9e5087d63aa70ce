"""The versions that stand in every run."""

from __future__ import annotations

import platform
import sys
from importlib import metadata
from pathlib import Path

import pytest

from yawid.runs.versions import LIBRARIES, versions


def test_the_versions_are_those_that_the_installed_packages_tell_of_themselves() -> None:
    told = {name: metadata.version(name) for name in ("yawid", *LIBRARIES)}

    assert versions() == told | {"python": platform.python_version()}


def test_what_stands_first_on_the_path_counts_and_an_egg_tells_its_version_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for folder in (first / "rerun_sdk-9.1.dist-info", second / "Rerun.SDK-9.0.dist-info"):
        folder.mkdir(parents=True)
    egg = first / "numpy-8.1.egg-info"
    egg.mkdir()
    (egg / "PKG-INFO").write_text(
        "Metadata-Version: 2.1\nName: numpy\nVersion: 8.1\n", encoding="utf-8"
    )
    monkeypatch.setattr(sys, "path", [str(first), str(second), *sys.path])
    monkeypatch.setattr("yawid.runs.versions.LIBRARIES", ("rerun-sdk", "scipy"))

    found = versions()

    assert found["rerun-sdk"] == "9.1"
    assert found["scipy"] == metadata.version("scipy")
    monkeypatch.setattr(sys, "path", [str(first)])
    monkeypatch.setattr("yawid.runs.versions.LIBRARIES", ("numpy",))
    assert versions()["numpy"] == "8.1"
