"""What a fleet does with every log: sent to the workers, so it imports nothing large."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePath
from typing import Any

from yawid.config.run import RunConfig
from yawid.errors import ConfigError

FOLDER = "folder"
"""The value of ``vehicle_from`` by which a log's folder names its aircraft."""


@dataclass(frozen=True, slots=True)
class Spec:
    """What is done with every log: the settings of the run, how logs are read, what is kept.

    ``settings`` are the fields of :class:`RunConfig` that were given. With ``modes``, a row is kept
    for each second. ``vehicle`` names the aircraft of all logs; with ``vehicle_from`` "folder" it
    is the name of each log's folder.

    Raises:
        ConfigError: the signing key cannot be read, or the aircraft is named in two ways or wrong.
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
        name, by = self.vehicle, self.vehicle_from
        if name is not None and not (name.strip() and name.isprintable()):
            raise ConfigError(f"--vehicle must be a name that can be printed, got {name!r}")
        if by not in (None, FOLDER):
            raise ConfigError(f"--vehicle-from must be {FOLDER}, got {by!r}")
        if name is not None and by is not None:
            raise ConfigError("--vehicle and --vehicle-from both name the aircraft: give one")
        if self.key_file is not None:
            from yawid.sources.open_log import ReadOptions

            key = ReadOptions.asked(Path(self.key_file)).key
            object.__setattr__(self, "key_mark", key and key.mark)

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
