"""``python -m yawid.fleet.child``: replays one log after the other for a worker, by two pipes.

Whatever a log does to its process it does to this one: a crash, a hang, all memory taken. The
worker that feeds it lives on, knows which log it was, and starts another.
"""

import contextlib
import ctypes
import gc
import os
import pickle
import shutil
import signal
import sys
from pathlib import Path
from typing import Any, BinaryIO

from yawid.dataset.values import FAILED, failed
from yawid.fleet.one_log import rows_of
from yawid.fleet.spec import Spec

READY = "ready"
"""Said once all is imported: a log's time begins after that."""
GARBAGE_AFTER = 50_000
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)


def main() -> None:
    """Read (path, spec, scratch folder, data) from stdin, write rows to stdout, until stdin ends.

    What anything else prints goes to stderr.
    """
    orders, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for number in (signal.SIGINT, signal.SIGTERM):  # the worker's to heed; it closes the pipe
        signal.signal(number, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    with contextlib.suppress(OSError):
        # Where memory runs out the system is to end this process, and no other.
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")
    gc.freeze()  # what is imported is no garbage
    gc.set_threshold(GARBAGE_AFTER)
    pickle.dump(READY, answers)
    answers.flush()
    _answer(orders, answers)


def _answer(orders: BinaryIO, answers: BinaryIO) -> None:
    while True:
        try:
            path, spec, scratch, data = pickle.load(orders)
        except EOFError:
            return
        pickle.dump(rows_here(path, spec, Path(scratch), data), answers)
        answers.flush()


def rows_here(path: str, spec: Spec, scratch: Path, data: bytes | None) -> Any:
    """Return the rows of a log, None where this machine has no such file."""
    if "://" not in path:
        return rows_of(Path(path), spec) if Path(path).is_file() else None
    local = scratch / (path.rpartition("/")[2] or "log")
    try:
        with local.open("wb") as out:
            if data is not None:
                out.write(data)
            else:
                _stream(path, out)
    except Exception as error:  # whatever a store's library raises
        return failed(FAILED, f"{type(error).__name__}: {error}")
    try:
        return rows_of(local, spec)
    finally:
        local.unlink()


def _stream(url: str, out: BinaryIO) -> None:
    import fsspec

    with fsspec.open(url, "rb") as stream:
        shutil.copyfileobj(stream, out, 1 << 20)


if __name__ == "__main__":
    main()
