"""How far a log has been read: a bar with rate and remaining time, on a terminal only."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO


@contextmanager
def progress(stream: TextIO, name: str, total_bytes: int) -> Iterator[Callable[[float], None]]:
    """Show how far a log of ``total_bytes`` has been read; yields ``advance(bytes)``."""
    if not stream.isatty():
        yield lambda count: None
        return
    from rich import progress as parts
    from rich.console import Console

    columns = (
        parts.TextColumn("{task.description}"),
        parts.BarColumn(),
        parts.DownloadColumn(),
        parts.TransferSpeedColumn(),
        parts.TimeRemainingColumn(),
    )
    with parts.Progress(*columns, console=Console(file=stream), transient=True) as bar:
        task = bar.add_task(name, total=total_bytes)
        yield lambda count: bar.update(task, advance=count)
