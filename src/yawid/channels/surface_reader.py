"""The surfaces' reader: from the servo message to rows of deflections on the vehicle's clock.

If several outputs have one function, such as twin fins, the first one is the surface; the others
are only compared with it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from yawid.blocks import FIRST_DATE_US, Floats, Ints, MessageBlock, RecordBlock
from yawid.channels.series import NEWEST, Latest, Readings, Series, boot_us, unwrap_uint32_us
from yawid.channels.surface import Surface, SurfacePart
from yawid.config.run import RunConfig
from yawid.errors import ConfigError

APART_US = 10_000_000
"""The drift between two clocks above which their offset is determined again."""
TOLERANCE = 0.05
"""Twins differ in a message if they are more than this part of half the travel apart: rounding to
1 us and trims set by hand make much less."""
LEAST_SHARE = 0.01
"""Twins differ as a whole if they differ in more than this share of the messages."""


@dataclass(slots=True)
class Twins:
    """Counts of messages compared, and of those that differ, by message and both outputs."""

    _counts: dict[tuple[str, int, int], tuple[int, int]] = field(default_factory=dict)

    def observe(self, block: MessageBlock, surface: Surface) -> None:
        """Compare the surface's twins with its first output in rows that have both."""
        for twin in surface.twins:
            first, other = (surface.normalised(part, block) for part in (surface.parts[0], twin))
            both = np.isfinite(first) & np.isfinite(other)
            apart = np.abs(first[both] - other[both]) > TOLERANCE
            key = surface.message, surface.parts[0].number, twin.number
            compared, differed = self._counts.get(key, (0, 0))
            self._counts[key] = compared + len(apart), differed + int(apart.sum())

    def share_apart(self, surface: Surface, twin: SurfacePart) -> float:
        """Return the share of messages in which the twin differs, NaN where none has both."""
        key = surface.message, surface.parts[0].number, twin.number
        compared, apart = self._counts.get(key, (0, 0))
        return apart / compared if compared else float("nan")

    def how(self, surface: Surface) -> str:
        """Return how the surface was found and whether its twins move with it."""
        how = surface.how
        for twin in surface.twins:
            share = self.share_apart(surface, twin)
            if np.isfinite(share):
                alike = "moves differently" if share > LEAST_SHARE else "moves alike"
                how += f"; {surface.name_of(twin)} {alike}"
        return how


@dataclass(slots=True)
class SurfaceReader:
    """The way from the servo message to rows of deflections, timed by the last boot time.

    A row has a value for each of the ``columns`` inputs and, as the last one, the aileron's newest
    value, whether it is an input or not; NaN where nothing reports it.
    """

    columns: int
    twins: Twins = field(default_factory=Twins)
    _aileron: Latest = field(default_factory=lambda: Latest(1))
    _unix_offset: int = 0
    _boot: Readings = field(default_factory=Readings.none)

    def observe_clock(self, clock: MessageBlock | None) -> None:
        """Keep the full boot times of a block of the yaw source, and the newest one before it."""
        if clock is not None:
            fresh = Readings(clock.order, boot_us(clock.fields))
            self._boot = Readings.joined([self._boot.select(NEWEST), fresh])

    def read(
        self,
        messages: Mapping[str, MessageBlock],
        surfaces: tuple[Surface, ...],
        aileron: Surface | None,
    ) -> Series:
        """Return one row for each message, with the deflection of every surface, (n, columns + 1).

        Its time is unwrapped by the yaw source's clock.
        """
        # The aileron's own message may be another one than that of the inputs.
        if aileron is not None and (block := messages.get(aileron.message)) is not None:
            block = block.select(aileron.rows(block))
            self._aileron.add(block.order, aileron.deflection(block)[:, None])
        none = Series.empty(self.columns + 1)
        order = self._boot.order
        if not surfaces or surfaces[0].message not in messages or len(order) == 0:
            return none
        block = messages[surfaces[0].message]
        block = block.select(surfaces[0].rows(block) & (block.order >= order[0]))
        if len(block) == 0:
            return none
        for surface in surfaces:
            self.twins.observe(block, surface)
        own_aileron = self._aileron.at(block.order + 1)[
            :, 0
        ]  # of the same message: of this very row
        values = np.stack([*(s.deflection(block) for s in surfaces), own_aileron], axis=1)
        return Series(block.order, block.received_us, self._times(block), values)

    def _times(self, block: MessageBlock) -> Ints:
        if block.name == "SERVO_OUTPUT_RAW":
            raw = block.fields["time_usec"].astype(np.int64)
            return unwrap_uint32_us(raw, block.order, self._boot.us, self._boot.order)
        reported = boot_us(block.fields)
        if reported[0] < FIRST_DATE_US:
            return reported
        return self._from_unix(reported, self._boot.at(block.order))

    def _from_unix(self, reported: Ints, boot: Ints) -> Ints:
        """Return Unix times as boot times, by an offset that is renewed where both drift apart."""
        times, start = reported - self._unix_offset, 0
        while (apart := np.abs(times[start:] - boot[start:]) > APART_US).any():
            start += int(np.argmax(apart))
            self._unix_offset = int(reported[start] - boot[start])
            times[start:] = reported[start:] - self._unix_offset
        return times


def record_surfaces(block: RecordBlock, config: RunConfig) -> tuple[Surface, ...]:
    """Return the inputs' surfaces by a record's names for them.

    Raises:
        ConfigError: the record does not have all of them.
    """
    if missing := set(config.inputs) - block.called.keys():
        raise ConfigError(
            f"--inputs asks for a column that the record does not have: {' and '.join(missing)}"
        )
    hows = {
        name: "column, measured: straight lines between its rows"
        if name in block.measured
        else "column, commanded: held from row to row"
        for name in config.inputs
    }
    if not config.travel_is_known:
        stroke_deg = float(np.rad2deg(config.half_travel))
        hows["rudder"] += (
            f"; its travel is not known, its largest stroke within 5 s is {stroke_deg:.3g} deg"
        )
    return tuple(
        Surface(
            "", hows[name], (SurfacePart(0, None),),
            column=block.called[name], measured=name in block.measured,
        )
        for name in config.inputs
    )  # fmt: skip


def record_values(block: RecordBlock, config: RunConfig) -> Floats:
    """Return a record's inputs and, as the last column, its aileron, (n, inputs + 1)."""
    sign = -1.0 if config.rudder_sign == "nose-left" else 1.0
    # It is in rad already, or in half travels, which are converted to rad where known.
    scale = sign if config.rudder_unit in ("rad", "deg") else sign * config.half_travel
    rudder = block.rudder if scale == 1.0 else scale * block.rudder
    found = {"rudder": rudder, "aileron": block.aileron}
    return np.column_stack([*(found[name] for name in config.inputs), block.aileron])
