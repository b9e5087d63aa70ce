"""``python -m yawid.fleet.child``: a process that replays one log after the other for a worker.

A log that crashes or hangs its process, or takes all memory, does so to this one; the worker
survives, knows which log it was, and starts another child.
"""

import gc
from pathlib import Path
from typing import Any

from yawid.dataset.values import FAILED, failed
from yawid.errors import YawidError
from yawid.fleet.one_log import rows_of
from yawid.fleet.spec import Spec
from yawid.system.child import serve
from yawid.system.stores import StoredPath

GARBAGE_AFTER = 50_000
"""The first threshold of the garbage collector, in objects: a high one saves time."""


def main() -> None:
    """Replay the logs ordered on stdin, (path, spec, scratch folder) each, until it ends."""
    gc.freeze()  # imported modules never become garbage
    gc.set_threshold(GARBAGE_AFTER)
    serve(lambda order: rows_here(*order))


def rows_here(path: str, spec: Spec, scratch: Path) -> Any:
    """Return the rows of a log by table, or None if this machine has no such file.

    A URL is first copied into the folder ``scratch``.
    """
    if "://" not in path:
        return rows_of(Path(path), spec) if Path(path).is_file() else None
    local = scratch / StoredPath(path).local_name
    try:
        StoredPath(path).copy_to(local)
    except YawidError as error:
        return failed(FAILED, str(error))
    try:
        return rows_of(local, spec)
    finally:
        local.unlink()


if __name__ == "__main__":
    main()
