"""The vehicle's boots in a log: each has a clock of its own, which --from and --to count by."""

from __future__ import annotations

from dataclasses import dataclass, field

from yawid.channels.series import Series
from yawid.config.run import RunConfig
from yawid.errors import ConfigError

MOST = 1000
"""So many boots are remembered: a clock that falls back with every message must not take memory
without end."""


def outside(config: RunConfig, what: str) -> ConfigError:
    """Return the error of a stretch that lies outside ``what``, which says what it covers."""
    ends = (("from", config.from_s), ("to", config.to_s))
    given = " ".join(f"--{name} {value:g}" for name, value in ends if value is not None)
    return ConfigError(f"{given} is outside {what} since boot")


@dataclass(slots=True)
class Boots:
    """First and last time (us since boot) at which yaw was reported, by the boot's number from 1.

    Boots in which it never was are left out.
    """

    spans_us: dict[int, tuple[int, int]] = field(default_factory=dict)

    def observe(self, boot: int, yaw: Series) -> None:
        """Take in rows of yaw from one boot."""
        if len(yaw) == 0 or (len(self.spans_us) >= MOST and boot not in self.spans_us):
            return
        first, last = self.spans_us.get(boot, (int(yaw.t_us[0]), int(yaw.t_us[0])))
        self.spans_us[boot] = min(first, int(yaw.t_us.min())), max(last, int(yaw.t_us.max()))

    @property
    def text(self) -> str:
        """What the log covers, in words."""
        spans = {n: f"{a / 1e6:.1f} to {b / 1e6:.1f} s" for n, (a, b) in self.spans_us.items()}
        if len(spans) == 1:
            return next(iter(spans.values()))
        return ", ".join(f"boot {number} from {span}" for number, span in spans.items())

    def check(self, config: RunConfig) -> None:
        """Check that what --boot, --from and --to ask for is in the log at all.

        Raises:
            ConfigError: it is not.
        """
        if not self.spans_us:
            return
        if config.boot is not None and config.boot not in self.spans_us:
            raise ConfigError(f"--boot {config.boot}: the log covers {self.text} since boot")
        asked = [self.spans_us[n] for n in self.spans_us if config.boot in (None, n)]
        low, high = config.window_us
        if not any(low <= last and first <= high for first, last in asked):
            raise outside(config, f"the log, which covers {self.text}")

    def warning(self, config: RunConfig) -> str | None:
        """Return what is to be said where --from and --to cut several boots alike."""
        if config.boot is not None or len(self.spans_us) < 2:
            return None
        if config.from_s is None and config.to_s is None:
            return None
        return (
            f"the log holds {len(self.spans_us)} boots, and --from and --to cut each of them "
            f"alike: {self.text}; choose one by --boot"
        )
