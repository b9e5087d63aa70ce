"""``python -m yawid.fleet.child``: a process that replays one log after the other for a worker.

The two exchange pickled objects over stdin and stdout. A log that crashes or hangs its process, or
takes all memory, does so to this one; the worker survives, knows which log it was, and starts
another child.
"""

import gc
import os
import pickle
import queue
import shutil
import signal
import sys
import threading
from pathlib import Path
from typing import Any, BinaryIO

from yawid.dataset.values import FAILED, failed
from yawid.fleet.one_log import rows_of
from yawid.fleet.spec import Spec
from yawid.system.processes import die_with_parent
from yawid.system.stores import CHUNK, StoredPath

READY = "ready"
"""The first answer, sent when all imports are done: a log's timeout starts after it."""
GARBAGE_AFTER = 50_000
"""The first threshold of the garbage collector, in objects: a high one saves time."""


def main() -> None:
    """Read (path, spec, scratch folder, data) from stdin and write rows to stdout until stdin ends.

    Whatever any other code prints goes to stderr.
    """
    orders, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for number in (signal.SIGINT, signal.SIGTERM):  # the worker handles them and closes the pipe
        signal.signal(number, signal.SIG_IGN)
    die_with_parent()
    gc.freeze()  # imported modules never become garbage
    gc.set_threshold(GARBAGE_AFTER)
    pickle.dump(READY, answers)
    answers.flush()
    _answer(orders, answers)


def _answer(orders: BinaryIO, answers: BinaryIO) -> None:
    waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_take, args=(orders, waiting), daemon=True).start()
    while True:
        path, spec, scratch, data = waiting.get()
        pickle.dump(rows_here(path, spec, Path(scratch), data), answers)
        answers.flush()


def _take(orders: BinaryIO, waiting: "queue.SimpleQueue[Any]") -> None:
    """Take orders until stdin ends; then the worker has ended, and this process ends at once."""
    try:
        while True:
            waiting.put(pickle.load(orders))
    finally:
        os._exit(0)


def rows_here(path: str, spec: Spec, scratch: Path, data: bytes | None) -> Any:
    """Return the rows of a log by table, or None if this machine has no such file.

    A URL is first copied into the folder ``scratch``, from ``data`` where its bytes are given.
    """
    if "://" not in path:
        return rows_of(Path(path), spec) if Path(path).is_file() else None
    local = scratch / (path.rpartition("/")[2] or "log")
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
