"""What a fleet asks of every log: it travels to the workers, and nothing heavy with it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from yawid.config.run import RunConfig


@dataclass(frozen=True, slots=True)
class Spec:
    """What is asked of every log: the settings of the run, how logs are read, what is kept.

    ``settings`` are those of :class:`RunConfig` that were given, ``automatic`` chooses the orders
    by each log, ``modes`` keeps a row a second.
    """

    settings: Mapping[str, Any] = field(default_factory=dict)
    automatic: bool = False
    form: Literal["auto", "tlog", "raw"] = "auto"
    key_file: str | None = None
    modes: bool = False

    @property
    def config_hash(self) -> str:
        """The same for the same settings, however they were given."""
        whole = asdict(RunConfig(**self.settings)), self.automatic, self.form, self.key_file
        text = json.dumps([*whole, self.modes], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
