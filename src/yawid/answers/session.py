"""What a summary says of a live session."""

from yawid.answers.part import Count, Number, Part


class LiveFacts(Part, frozen=True, kw_only=True):
    """The facts of a live session: the tap's counts, its events, failures and latency.

    ``rates`` holds, by message, the rate asked for, the answer, and the rate achieved.
    """

    datagrams: Count | None = None
    skipped_bytes: Count | None = None
    receive_buffer_bytes: Count | None = None
    dropped: dict[str, Count]
    events: list[str]
    rates: dict[str, dict[str, Number | str]] | None = None
    failed: list[str] | None = None
    latency_ms: dict[str, Number] | None = None
    viewer_skipped: Count | None = None
