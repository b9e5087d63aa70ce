"""An interactive shell in a terminal of its own, for tests of what a user sees and types."""

from __future__ import annotations

import os
import pty
import re
import select
import time


class Shell:
    """A shell in a terminal of its own until the end of its block; ``seen`` is all it wrote."""

    def __init__(self, *command: str) -> None:
        self.child, self.terminal = pty.fork()
        if self.child == 0:
            os.environ |= {"PS1": "> ", "TERM": "xterm-256color", "LANG": "C.UTF-8"}
            os.execvp(command[0], command)
        self.seen = b""

    def __enter__(self) -> Shell:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self.terminal)
        os.waitpid(self.child, 0)

    def type(self, keys: str, until: str) -> str:
        """Type ``keys``, wait for a pattern in what is written from then on; return that."""
        begin, end_s = len(self.seen), time.monotonic() + 60.0
        os.write(self.terminal, keys.encode())
        while not re.search(until.encode(), self.seen[begin:]):
            assert time.monotonic() < end_s, self.seen[begin:][-2000:]
            if select.select([self.terminal], [], [], 0.1)[0]:
                self.seen += os.read(self.terminal, 1 << 16)
        return self.seen[begin:].decode()
