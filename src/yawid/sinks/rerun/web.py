"""Rerun's own web viewer: a process that serves it, to browsers of this machine only."""

import shutil
import socket
import subprocess
import time
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final
from urllib.parse import quote

from yawid.errors import SinkError
from yawid.sinks.door import say
from yawid.system.processes import HERE, OWN_GROUP, has_desktop

START_S: Final = 20.0
LOOK_S: Final = 0.1


@contextmanager
def web_viewer() -> Iterator[tuple[str, Callable[[], object]]]:
    """Serve the viewer while the context lasts, say where, and open it if there is a desktop.

    Yields the address for a recording, and a function that waits until the viewer ends. What it was
    sent it keeps for browsers that come later.

    Raises:
        SinkError: it does not start.
    """
    import rerun_cli  # of rerun-sdk, which may be missing

    # The command next to the interpreter is a script that waits for this one.
    program = shutil.which("rerun", path=str(Path(rerun_cli.__file__).parent))
    with socket.create_server((HERE, 0)) as first, socket.create_server((HERE, 0)) as second:
        ports = first.getsockname()[1], second.getsockname()[1]
    process = subprocess.Popen(
        [str(program), "--serve-web", "--bind", HERE, "--port", str(ports[0]),
         "--web-viewer-port", str(ports[1])],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True, creationflags=OWN_GROUP,  # Ctrl-C ends the run, then this
    )  # fmt: skip
    try:
        _wait_until_listening(process, ports)
        address = f"rerun+http://{HERE}:{ports[0]}/proxy"
        url = f"http://{HERE}:{ports[1]}/?url={quote(address, safe='')}"
        say(f"Rerun's web viewer, on this machine only: {url}")
        if has_desktop():
            webbrowser.open(url)
        yield address, process.wait
    finally:
        process.terminate()
        process.wait()


def _wait_until_listening(process: "subprocess.Popen[bytes]", ports: tuple[int, int]) -> None:
    end_s = time.monotonic() + START_S
    for port in ports:
        while True:
            with socket.socket() as probe:
                if probe.connect_ex((HERE, port)) == 0:
                    break
            if process.poll() is not None or time.monotonic() > end_s:
                raise SinkError("Rerun's web viewer does not start")
            time.sleep(LOOK_S)
