"""Where machine code is kept between processes, and that only one makes it."""

import fcntl
import hashlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TextIO

from yawid import blocks
from yawid.estimation import kernel
from yawid.estimation.machine.object_code import processor

_DIGEST = hashlib.sha256().digest_size
_SETTLED = (blocks.Y_HAT, blocks.INNOVATION, blocks.RESIDUAL, blocks.NOISE_STD, blocks.STATUS)


def folders() -> list[Path]:
    """Return where it may be kept, first to last: NUMBA_CACHE_DIR alone, where that is set."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        return [Path(given)]
    beside = Path(__file__).parent / "__pycache__"
    users = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    with suppress(RuntimeError):  # a user without a home
        return [beside, users.expanduser() / "yawid"]
    return [beside]


@cache
def _version() -> str:
    """Return a name of all that the code depends on: versions and machines keep apart."""
    digest = hashlib.sha256()
    for folder in (Path(kernel.__file__).parent, Path(__file__).parent):
        for source in sorted(folder.glob("*.py")):
            digest.update(source.read_bytes())
    python = (sys.implementation.cache_tag, object.__basicsize__, sys.platform)
    digest.update(repr((python, processor(), _SETTLED, blocks.SCALARS)).encode())
    return digest.hexdigest()[:16]


def find(name: str) -> bytes | None:
    """Return the code that an earlier process left; None where there is none, or it is damaged."""
    for folder in folders():
        with suppress(OSError):
            whole = (folder / f"{name}-{_version()}.code").read_bytes()
            digest, code = whole[:_DIGEST], whole[_DIGEST:]
            if hashlib.sha256(code).digest() == digest:
                return code
    return None


def keep(name: str, code: bytes) -> Path | None:
    """Write the code, whole or not at all; return the folder, None where none can be written to."""
    for folder in folders():
        part = folder / f"{name}-{_version()}.{os.getpid()}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            part.write_bytes(hashlib.sha256(code).digest() + code)
            part.replace(part.with_suffix(".code"))
        except OSError:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            continue
        return folder
    return None


@contextmanager
def alone(name: str) -> Iterator[bool]:
    """Yield whether nobody else makes this code and it can be kept; who dies lets go."""
    lock = _opened(f"{name}-{_version()}.lock")
    if lock is None:
        yield False
        return
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield False
            return
        yield True


def _opened(name: str) -> TextIO | None:
    for folder in folders():
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            return (folder / name).open("w")
    return None
