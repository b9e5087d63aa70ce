"""What a fleet does with every log: sent to the workers, so it imports nothing large."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from yawid.config.run import RunConfig
from yawid.errors import ConfigError

if TYPE_CHECKING:
    from yawid.sources.open_log import ReadOptions


@dataclass(frozen=True, slots=True)
class Spec:
    """What is done with every log: the settings of the run, how logs are read, what is kept.

    ``settings`` are the fields of :class:`RunConfig` that were given. With ``modes``, a row is kept
    for each second. ``vehicle`` names the aircraft of all logs; with ``vehicle_from`` "folder" it
    is the name of each log's folder.

    Raises:
        ConfigError: the signing key cannot be read, or the aircraft's name cannot be printed.
    """

    settings: Mapping[str, Any] = field(default_factory=dict)
    key_file: str | None = None
    modes: bool = False
    vehicle: str | None = None
    vehicle_from: str | None = None
    key_mark: str | None = field(init=False, default=None)
    """Fingerprint of the key that ``key_file`` held at the start: the key counts, not its path."""

    def __post_init__(self) -> None:
        """Read the key's fingerprint; the readers are large, so only a key imports them."""
        name = self.vehicle
        if name is not None and not (name.strip() and name.isprintable()):
            raise ConfigError(f"--vehicle must be a name that can be printed, got {name!r}")
        if self.key_file is not None:
            key = self.read_options().key
            object.__setattr__(self, "key_mark", key and key.mark)

    def read_options(self) -> "ReadOptions":
        """Return how a log's bytes are read: with the signing key, if any.

        Raises:
            ConfigError: the key cannot be read here, or is not that with which the fleet started.
        """
        from yawid.sources.open_log import ReadOptions

        options = ReadOptions.asked(None if self.key_file is None else Path(self.key_file))
        if options.key is not None and self.key_mark not in (None, options.key.mark):
            raise ConfigError(
                f"signing key file {self.key_file}: it holds another key than when the fleet was "
                "started"
            )
        return options

    def name_of(self, path: str) -> str | None:
        """Return the name of the aircraft of the log with this path or URL, None where not asked.

        The name depends on the log alone, not on the path by which it was searched for.
        """
        return self.vehicle if self.vehicle_from is None else PurePath(path).parent.name or None

    @property
    def config_hash(self) -> str:
        """A hash that is equal for equal settings, whether given or left at their defaults."""
        config = RunConfig(**self.settings)
        whole = [asdict(config), self.key_mark, self.modes]
        whole += filter(None, [self.vehicle, self.vehicle_from])
        text = json.dumps(whole, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
