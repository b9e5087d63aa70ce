"""Where machine code is kept between processes, and which files are trusted.

Whoever can write such a file can run any code as the user who loads it. So, as OpenSSH does with
its keys, a file counts only if it belongs to the user or to root, no other user can change it, and
the same holds for its folder. Where two processes compile at once, each writes the same code.
"""

import hashlib
import os
import stat
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

from yawid.blocks import INNOVATION, NOISE_STD, RESIDUAL, SCALARS, STATUS, Y_HAT
from yawid.estimation import kernel
from yawid.estimation.machine.object_code import processor
from yawid.system.files import SAFE_OPEN, who_else_writes

_DIGEST = hashlib.sha256().digest_size
_SETTLED = (Y_HAT, INNOVATION, RESIDUAL, NOISE_STD, STATUS)
_FOLDER, _OF_USER, _FILE = 0o755, 0o700, 0o644
"""File modes: other users may load code that root compiled; a user's own is for that user."""


def folders() -> list[Path]:
    """Return the trusted folders, in the order of search.

    Where NUMBA_CACHE_DIR is set it is the only one; where others can write to that folder, the
    user's own cache replaces it.
    """
    first, is_given = _first()
    if why_not(first) is not None:
        return _of_user()
    return [first] if is_given else [first, *_of_user()]


def passed_by() -> str | None:
    """Return in words why NUMBA_CACHE_DIR is not used; None where it is used, or not set."""
    first, is_given = _first()
    why = why_not(first) if is_given else None
    return why and f"NUMBA_CACHE_DIR is not used: {why}"


def _first() -> tuple[Path, bool]:
    """Return the first folder, with links resolved, and whether NUMBA_CACHE_DIR names it."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    first = Path(given) if given else Path(__file__).parent / "__pycache__"
    return Path(os.path.realpath(first)), bool(given)


def _of_user() -> list[Path]:
    with suppress(RuntimeError):  # a user without a home
        named = Path(os.environ.get("XDG_CACHE_HOME") or ".")
        cache = named if named.is_absolute() else Path("~/.cache").expanduser()
        folder = Path(os.path.realpath(cache / "yawid"))
        if why_not(folder) is None:
            return [folder]
    return []


def why_not(folder: Path) -> str | None:
    """Return in words who else could change files in a folder (not a link); None: nobody."""
    for each in (folder, *folder.parents):
        try:
            about: os.stat_result | None = each.stat(follow_symlinks=False)
        except (FileNotFoundError, NotADirectoryError):
            about = None  # it does not exist yet; once made it is checked again
        except OSError as error:
            return f"{each}: {error.strerror}"
        if why := who_else_writes(each, about, is_above=each != folder):
            return why
    return None


def _make(folder: Path) -> None:
    """Make the folder and its missing parents.

    Raises:
        OSError: it cannot be made, or cannot be trusted.
    """
    mode = _OF_USER if folder in _of_user() else _FOLDER
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    for each in reversed(missing):
        each.mkdir(mode, exist_ok=True)
    if why := why_not(folder):
        raise PermissionError(why)


def _open(path: Path, flags: int, mode: int = 0) -> int:
    """Return a descriptor of a regular file that only the user and root can change.

    Raises:
        OSError: the file cannot be opened, or others can change it.
    """
    opened = os.open(path, flags | SAFE_OPEN, mode)
    about = os.fstat(opened)
    if not stat.S_ISREG(about.st_mode) or who_else_writes(path, about):
        os.close(opened)
        raise PermissionError(f"{path} can be changed by others, or is not a file")
    return opened


@cache
def _version() -> str:
    """Return a name made of all that the code depends on: sources, Python and processor."""
    digest = hashlib.sha256()
    for folder in (Path(kernel.__file__).parent, Path(__file__).parent):
        for source in sorted(folder.glob("*.py")):
            digest.update(source.read_bytes())
    python = (sys.implementation.cache_tag, object.__basicsize__, sys.platform)
    digest.update(repr((python, processor(), _SETTLED, SCALARS)).encode())
    return digest.hexdigest()[:16]


def find(name: str) -> bytes | None:
    """Return the code that an earlier process kept; None where there is none or it is damaged."""
    for folder in folders():
        with suppress(OSError):
            with open(_open(folder / f"{name}-{_version()}.code", os.O_RDONLY), "rb") as stream:
                whole = stream.read()
            digest, code = whole[:_DIGEST], whole[_DIGEST:]
            if hashlib.sha256(code).digest() == digest:
                return code
    return None


def keep(name: str, code: bytes) -> Path | None:
    """Write the code completely or not at all; return its folder, None where none is writable."""
    for folder in folders():
        part = folder / f"{name}-{_version()}.{os.getpid()}"
        try:
            _make(folder)
            new = os.O_WRONLY | os.O_CREAT | os.O_EXCL
            with open(_open(part, new, _FILE), "wb") as stream:
                stream.write(hashlib.sha256(code).digest() + code)
            part.replace(part.with_suffix(".code"))
        except OSError:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            continue
        return folder
    return None
