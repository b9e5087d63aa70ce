"""Which versions a result was made with."""

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
    """Return versions as the folders beside the packages bear them: ``rerun_sdk-0.24.dist-info``.

    importlib.metadata reads the file in that folder by way of the mail library: a third of NumPy's
    import, for one line each.
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
    """Return the version of what is installed in another way (an egg, a zip file)."""
    from importlib.metadata import version

    return version(name)
