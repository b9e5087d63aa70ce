"""The versions of all software that a result was made with."""

import re
import sys
from pathlib import Path

from yawid.version import __version__

LIBRARIES = ("numpy", "numba", "scipy", "pymavlink", "mcap", "protobuf", "rerun-sdk", "filterpy")


def versions() -> dict[str, str]:
    """Return the versions of yawid, Python and the libraries a result depends on."""
    installed = _installed()
    found = {name: installed.get(_plain(name)) or _described(name) for name in LIBRARIES}
    return {"yawid": __version__, "python": sys.version.split()[0]} | found


def _installed() -> dict[str, str]:
    """Return versions read from the names of metadata folders: ``rerun_sdk-0.24.dist-info``.

    importlib.metadata parses a file in each folder with the email library instead: that takes a
    third of the time that importing NumPy takes, for one line of each file.
    """
    found: dict[str, str] = {}
    for place in sys.path:
        for folder in Path(place).glob("*-*.dist-info"):
            name, version = folder.name.removesuffix(".dist-info").rsplit("-", 1)
            found.setdefault(_plain(name), version)
    return found


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "_", name).lower()


def _described(name: str) -> str:
    """Return the version of a library that is installed in another way (an egg, a zip file)."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
