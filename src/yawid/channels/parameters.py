"""The parameters that a vehicle has reported so far, and what they say about its outputs."""

import math
import re
from collections.abc import Iterator

import numpy as np

from yawid.answers.heard import GainSeen, words_of_gains
from yawid.blocks import Array, Floats, MessageBlock
from yawid.channels.series import Series
from yawid.channels.surface import Travel
from yawid.quantities.vehicles import ARDUPILOT, PX4

STOCK_TRAVEL_US: Travel = (1100.0, 1500.0, 1900.0)
"""ArduPilot's defaults of SERVOn_MIN, SERVOn_TRIM and SERVOn_MAX."""
PX4_TRAVEL_US: Travel = (1000.0, 1500.0, 2000.0)
"""PX4's defaults of PWM_MAIN_MINn and PWM_MAIN_MAXn, and their middle."""
_RELEVANT = re.compile(
    r"SERVO[1-9]\d?_(FUNCTION|MIN|TRIM|MAX|REVERSED)"
    r"|RC[1-9]\d?_(MIN|TRIM|MAX|REV|REVERSED)"
    r"|MIXING_(GAIN|OFFSET)|(PWM_MAIN|PWM_AUX|HIL_ACT)_(FUNC|MIN|MAX|CENT|REV)\d*|CA_SV_CS\d+_TYPE"
    r"|Q_(M_PWM_(MIN|MAX)|THR_(MIN|MAX)_PWM|TILT_MASK|TAILSIT_MOTMX)"
)
_FUNCTION = re.compile(r"SERVO([1-9]\d?)_FUNCTION")
YAW_LOOP = {ARDUPILOT: ("YAW2SRV_DAMP", "YAW_RATE_ENABLE"), PX4: ("FW_YR_P",)}
"""Parameters, by autopilot, that are not 0 where it feeds the yaw rate back to the rudder."""
_GAINS = {name for names in YAW_LOOP.values() for name in names}

_INTEGERS = range(1, 9)
"""MAV_PARAM_TYPE_UINT8 to MAV_PARAM_TYPE_INT64."""
_LEAST_NORMAL = np.finfo(np.float32).tiny


def _values(fields: Array) -> Floats:
    """Return the values (n,) of PARAM_VALUE rows.

    ArduPilot sends an integer as a float. PX4 puts the integer's four bytes in the float's place:
    read as a float, a small integer is then denormal and a negative one NaN.
    """
    reported = np.ascontiguousarray(fields["param_value"], np.float32)
    if "param_type" not in (fields.dtype.names or ()):
        # An on-board log has the values themselves, not the encoding of a link.
        return reported.astype(float)
    bytewise = np.isin(fields["param_type"], _INTEGERS) & ~(np.abs(reported) >= _LEAST_NORMAL)
    return np.where(bytewise, reported.view(np.int32), reported).astype(float)


class ParameterTable:
    """The parameters by name; of each the last value received counts."""

    def __init__(self) -> None:
        self.values: dict[str, float] = {}
        self._count = 0
        self._gains: list[GainSeen] = []
        self._untimed: list[tuple[int, str, float]] = []
        self._functions: dict[int, int] | None = None

    def changes(self, block: MessageBlock) -> Iterator[int]:
        """Take PARAM_VALUE rows in, one by one; yield the places where a surface may change."""
        fields = block.fields
        has_count = "param_count" in (fields.dtype.names or ())  # an on-board log has none
        counts = fields["param_count"] if has_count else np.zeros(len(block), int)
        columns = (block.order, fields["param_id"], _values(fields), counts)
        for order, raw, value, of in zip(*(column.tolist() for column in columns), strict=True):
            name = raw.split(b"\0", 1)[0].decode("ascii", "replace")
            changed, had_all = self.values.get(name) != value, not self.missing
            self.values[name], self._count = value, of or self._count
            if name in _GAINS and changed and math.isfinite(value):
                self._untimed.append((order, name, value))
            if (changed and _RELEVANT.fullmatch(name)) or had_all == bool(self.missing):
                self._functions = None
                yield order

    @property
    def missing(self) -> int:
        """The number of parameters that the vehicle has and the log lacks, 0 if unknown."""
        return max(self._count - len(self.values), 0)

    def yaw_loop(self, autopilot: int) -> str | None:
        """Return the gains of the feedback from yaw rate to rudder, None where there is none."""
        seen = [*((each.name, each.value) for each in self._gains), *(g[1:] for g in self._untimed)]
        names = YAW_LOOP.get(autopilot, ())
        return words_of_gains({name: [v for n, v in seen if n == name] for name in names})

    def changed_gains(self, autopilot: int) -> list[GainSeen] | None:
        """Return those gains with their times where one of them changed, else None."""
        of = [each for each in self._gains if each.name in YAW_LOOP.get(autopilot, ())]
        return of if len(of) > len({each.name for each in of}) else None

    def observe_time(self, boot: int, yaw: Series) -> None:
        """Give the gains received the time of the first row of the yaw source after them."""
        while self._untimed and len(yaw) and self._untimed[0][0] < yaw.order[-1]:
            order, name, value = self._untimed.pop(0)
            from_s = float(yaw.t_us[np.searchsorted(yaw.order, order)]) / 1e6
            self._gains.append(GainSeen(name, value, boot, from_s))

    def get(self, name: str, default: float) -> float:
        """Return a value, or the default where it was not reported or is not finite."""
        value = self.values.get(name, default)
        return value if math.isfinite(value) else default

    def functions(self) -> dict[int, int]:
        """Return servo number -> function for every SERVOn_FUNCTION received."""
        # Every block of messages asks for them, and a thousand parameters hardly ever change.
        if self._functions is None:
            found = ((_FUNCTION.fullmatch(name), v) for name, v in self.values.items())
            named = ((int(m[1]), int(v)) for m, v in found if m and math.isfinite(v))
            self._functions = dict(sorted(named))
        return self._functions

    def travel(self, prefix: str, stock: Travel = STOCK_TRAVEL_US) -> tuple[Travel, bool, bool]:
        """Return (min, trim, max) in us, reversed, and whether all three were reported in order.

        What was not reported is taken from ``stock``, and all three if they are not in order. PX4
        writes a reversed stick as RCn_REV = -1.
        """
        names = [f"{prefix}_{end}" for end in ("MIN", "TRIM", "MAX")]
        low, trim, high = (self.get(n, s) for n, s in zip(names, stock, strict=True))
        sound = 0.0 < low < trim < high < 65535.0
        reverse = self.get(f"{prefix}_REVERSED", 0.0) == 1.0 or self.get(f"{prefix}_REV", 1.0) < 0.0
        reported = sound and all(name in self.values for name in names)
        return (low, trim, high) if sound else stock, reverse, reported

    def px4_travel(self, bank: str, number: int) -> tuple[Travel | None, bool]:
        """Return (min, centre, max) of a PX4 output in us, None for -1..1, and reversed."""
        reverse = bool(int(self.get(f"{bank}_REV", 0.0)) >> (number - 1) & 1)
        if bank == "HIL_ACT":
            return None, reverse
        low = self.get(f"{bank}_MIN{number}", PX4_TRAVEL_US[0])
        high = self.get(f"{bank}_MAX{number}", PX4_TRAVEL_US[2])
        centre = self.get(f"{bank}_CENT{number}", -1.0)
        middle = centre if 800.0 <= centre <= 2200.0 else 0.5 * (low + high)
        return (low, middle, high) if 0.0 < low < middle < high else PX4_TRAVEL_US, reverse
