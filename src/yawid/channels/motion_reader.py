"""The lateral motion for the bare airframe: attitudes, commands and accelerations as received.

Nothing is put on a grid here. Attitudes and commands are the rows that make the samples, so that a
row that came late or twice is in neither. An acceleration belongs to the next attitude received
after it: by that its use does not depend on how the stream was cut into blocks.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from yawid.blocks import Floats, MessageBlock, MotionBlock, RecordBlock, StampedRows
from yawid.channels.series import END, Piece, Series, boot_us
from yawid.config.run import RunConfig
from yawid.quantities.airspeed import GRAVITY

COLUMNS = ("roll", "pitch", "p", "q", "r")
"""The columns of an attitude."""
ACCELERATIONS = {
    "ACCELERATION": 1.0, "HIGHRES_IMU": 1.0,
    "SCALED_IMU": 1e-3 * GRAVITY, "RAW_IMU": 1e-3 * GRAVITY,
}  # fmt: skip
"""The messages with ``yacc``, and its unit in m/s^2; RAW_IMU is in mg as ArduPilot sends it. The
first is that of on-board logs."""
APART_US = 2_000_000
"""An acceleration that is further than this from the next attitude is on another clock."""
ABSURD_M_S2 = 500.0
MOST_WAITING = 20_000
"""The most accelerations kept while no attitude comes."""


def record_columns(rows: RecordBlock) -> Floats:
    """Return the columns of a record's rows as attitudes and an acceleration, (n, 6)."""
    return np.column_stack([getattr(rows, name) for name in (*COLUMNS, "ay")])


@dataclass(slots=True)
class MotionReader:
    """The way from pieces of segments to :class:`MotionBlock`; ``take`` returns what is ready.

    Rows of a segment begin where both channels have rows.
    """

    config: RunConfig
    _source: str | None = None
    _waiting: Series = field(default_factory=lambda: Series.empty(1))
    _begins: list[int] = field(default_factory=lambda: [END, END])
    _unix_ns: list[int] = field(default_factory=lambda: [0, 0, 0])
    _ready: list[MotionBlock] = field(default_factory=list)

    def observe(self, messages: Mapping[str, MessageBlock]) -> None:
        """Take in accelerations, of the message that came first."""
        found = [messages[name] for name in ACCELERATIONS if name in messages]
        if not found:
            return
        self._source = self._source or min(found, key=lambda block: int(block.order[0])).name
        if (block := messages.get(self._source)) is None:
            return
        if "id" in (block.fields.dtype.names or ()):
            block = block.select(block.fields["id"] == 0)
        ay = ACCELERATIONS[self._source] * np.asarray(block.fields["yacc"], float)
        rows = Series(block.order, block.received_us, boot_us(block.fields), ay[:, None])
        self._waiting = Series.joined([self._waiting, rows])
        if len(self._waiting) > 2 * MOST_WAITING:
            self._waiting = self._waiting.select(slice(-MOST_WAITING, None))

    def feed_piece(self, piece: Piece, width: int) -> Piece:
        """Take a piece in; return it with the first ``width`` columns of its yaw rows alone."""
        bare = replace(piece.yaw, values=np.ascontiguousarray(piece.yaw.values[:, :width]))
        motion = replace(piece.yaw, values=piece.yaw.values[:, width:])
        begins = zip(
            [END, END] if piece.opens else self._begins, (piece.yaw, piece.surface), strict=True
        )
        self._begins = [int(rows.order.min(initial=begin)) for begin, rows in begins]
        if self.config.boot in (None, piece.boot) and max(self._begins) < END:
            self._make(piece, motion, max(self._begins))
        return replace(piece, yaw=bare)

    def _make(self, piece: Piece, motion: Series, both: int) -> None:
        """Add a block from the rows at or after the place ``both``."""
        attitude = replace(motion, values=motion.values[:, : len(COLUMNS)])
        attitude = attitude.select(np.asarray(np.isfinite(attitude.values).all(axis=1)))
        later = self._waiting.order > (motion.order[-1] if len(motion) else -1)
        next_one = np.searchsorted(motion.order, self._waiting.order[~later])
        accelerations = self._waiting.select(~later)
        self._waiting = self._waiting.select(later)
        if motion.values.shape[1] > len(COLUMNS):  # a record has them in the same rows
            accelerations = replace(motion, values=motion.values[:, len(COLUMNS) :])
            next_one = np.arange(len(motion))
        u, ones = piece.surface.values, np.ones(len(piece.surface))
        exact = float(motion.values.shape[1] == len(COLUMNS))
        commands = np.column_stack([u[:, 0], u[:, -1], piece.epoch * ones, exact * ones])
        surface = replace(piece.surface, values=commands)
        next_us, next_order = motion.t_us[next_one], motion.order[next_one]
        ay = np.column_stack([accelerations.values[:, 0], next_us])
        near = np.abs(accelerations.t_us - next_us) <= APART_US
        near &= (np.abs(ay[:, 0]) < ABSURD_M_S2) & (accelerations.order >= both)
        accelerations = replace(accelerations, values=ay, order=next_order)
        made = (
            self._stamped(0, piece, attitude.select(attitude.order >= both)),
            self._stamped(1, piece, surface.select(surface.order >= both)),
            self._stamped(2, piece, accelerations.select(near)),
        )
        if any(map(len, made)):
            self._ready.append(MotionBlock(*made))

    def _stamped(self, i: int, piece: Piece, rows: Series) -> StampedRows:
        """Return the rows with Unix times that never decrease."""
        unix_ns = (rows.t_us + piece.offset.at(rows.order)) * 1000 if len(rows) else rows.t_us
        unix_ns = np.maximum.accumulate(np.append(self._unix_ns[i], unix_ns))[1:]
        if len(rows):
            self._unix_ns[i] = int(unix_ns[-1])
        return StampedRows(rows.t_us, unix_ns, np.ascontiguousarray(rows.values))

    def take(self) -> MotionBlock | None:
        """Return the motion since the last call, None where there is none."""
        ready, self._ready = self._ready, []
        return MotionBlock.joined(ready) if ready else None
