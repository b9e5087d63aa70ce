"""``python -m yawid.fleet.child``: a process that replays one log after the other for a worker.

A log that crashes or hangs its process, or takes all memory, does so to this one; the worker
survives, knows which log it was, and starts another child.
"""

import gc
import shutil
from pathlib import Path
from typing import Any

from yawid.dataset.values import FAILED, failed
from yawid.fleet.one_log import rows_of
from yawid.fleet.spec import Spec
from yawid.system.child import serve
from yawid.system.stores import CHUNK, StoredPath

GARBAGE_AFTER = 50_000
"""The first threshold of the garbage collector, in objects: a high one saves time."""


def main() -> None:
    """Replay the logs ordered on stdin, (path, spec, scratch folder, data) each, until it ends."""
    gc.freeze()  # imported modules never become garbage
    gc.set_threshold(GARBAGE_AFTER)
    serve(lambda order: rows_here(*order))


def rows_here(path: str, spec: Spec, scratch: Path, data: bytes | None) -> Any:
    """Return the rows of a log by table, or None if this machine has no such file.

    A URL is first copied into the folder ``scratch``, from ``data`` where its bytes are given.
    """
    if "://" not in path:
        return rows_of(Path(path), spec) if Path(path).is_file() else None
    local = scratch / StoredPath(path).local_name
    try:
        with local.open("wb") as out:
            if data is not None:
                out.write(data)
            else:
                with StoredPath(path).open() as stream:
                    shutil.copyfileobj(stream, out, CHUNK)
    except Exception as error:  # a store's library may raise anything
        return failed(FAILED, f"{type(error).__name__}: {error}")
    try:
        return rows_of(local, spec)
    finally:
        local.unlink()


if __name__ == "__main__":
    main()
