"""The live session: a tlog being written, and estimated as it grows."""

from yawid.live.console import Console
from yawid.live.loop import LiveOptions, live, session_name
from yawid.live.session import Ended

__all__ = ["Console", "Ended", "LiveOptions", "live", "session_name"]
