"""Files: locks, flags to open them safely, and who else may write to them."""

import os
import stat
import sys
from pathlib import Path
from typing import Final

SAFE_OPEN: Final = sum(
    getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK", "O_BINARY")
)
"""Flags that open a regular file, unchanged, without following a link or waiting for a pipe."""
IS_POSIX: Final = sys.platform != "win32"
"""Whether an open file can be renamed and removed, and ``/dev/fd/N`` opens the descriptor N."""
_FAR: Final = 0x7FFFFFFE
"""The byte that Windows locks: nobody can read or write it meanwhile, so it is far behind the end.
"""
_FOR_OTHERS = stat.S_IWGRP | stat.S_IWOTH


def lock(descriptor: int) -> None:
    """Lock an open file, which no other process has then, until it is closed or the process ends.

    Raises:
        OSError: another process has locked it.
    """
    if sys.platform == "win32":
        import msvcrt

        os.lseek(descriptor, _FAR, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        os.lseek(descriptor, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def who_else_writes(
    path: Path, about: os.stat_result | None, *, is_above: bool = False
) -> str | None:
    """Return in words who else could change a file or folder, or one below it; None: nobody.

    ``about`` is None where it does not exist yet. Where ``is_above`` is set, only what this user
    makes below ``path`` has to be safe. On Windows ``about`` does not show who may write, so only
    the user's own folder is trusted.
    """
    if sys.platform == "win32":
        home = Path(os.path.realpath(Path.home()))
        is_own = path.is_relative_to(home) or (is_above and home.is_relative_to(path))
        return None if is_own else f"{path} is not in your own folder {home}"
    if about is None:
        return None
    if about.st_uid not in (0, os.geteuid()):
        return f"{path} belongs to user {about.st_uid}"
    # Where the sticky bit is set, a user cannot rename files of another user.
    if about.st_mode & _FOR_OTHERS and not (is_above and about.st_mode & stat.S_ISVTX):
        return f"{path} can be written to by others"
    return None
