"""The live session: a link is recorded to a tlog and estimated at the same time."""

from yawid.runs.live.loop import LiveOptions, live, session_name
from yawid.runs.live.vehicle_session import Ended
from yawid.sinks.terminal.console import Console

__all__ = ["Console", "Ended", "LiveOptions", "live", "session_name"]
