"""What a summary says of a live session."""

from typing import Annotated, Final

from yawid.answers.part import Count, Number, Part, named, says

OF_RATE: Final = named(
    asked_hz="asked for, in Hz",
    answer="what the vehicle answered",
    achieved_hz="the rate that was received, in Hz",
)
"""What is said of a message that was asked for."""


class LiveFacts(Part, frozen=True, kw_only=True):
    """The facts of a live session: the tap's counts, its events, failures and latency."""

    datagrams: Annotated[Count | None, says("received")] = None
    skipped_bytes: Annotated[Count | None, says("outside of frames, of all senders", "bytes")] = (
        None
    )
    receive_buffer_bytes: Annotated[
        Count | None, says("of the socket, as the system granted it", "bytes")
    ] = None
    dropped: Annotated[
        dict[str, Count],
        says(
            "datagrams dropped on this machine, by place",
            **named(
                queue="no room in the queue",
                socket="by the system",
                too_long="of more than 9000 bytes",
                at_the_stop="still waiting at the end",
            ),
        ),
    ]
    events: Annotated[list[str], says("messages that were shown while it ran")]
    rates: Annotated[
        dict[str, Annotated[dict[str, Number | str], says(**OF_RATE)]] | None,
        says(
            "messages asked for by --request-rates, by name",
            propertyNames={"pattern": r"^[A-Z0-9_]+$"},
        ),
    ] = None
    failed: Annotated[list[str] | None, says("outputs that failed, in words")] = None
    latency_ms: Annotated[
        dict[str, Number] | None,
        says(
            "from a datagram's arrival to its estimate, each the upper edge of its bin",
            "ms",
            **named(p50="median", p99="99th percentile", max="longest"),
        ),
    ] = None
    viewer_skipped: Annotated[
        Count | None, says("messages left out because the viewer was too slow")
    ] = None
