"""Every exception yawid raises on purpose and its exit code; ``cli/`` alone makes lines of them."""


class YawidError(Exception):
    """The root: anything that yawid itself has to say about its input, output or use."""

    exit_code = 6


class ConfigError(YawidError, ValueError):
    """A setting outside its limits; the message names the value and the limit."""

    exit_code = 2


class SourceError(YawidError):
    """A log or a link that cannot be read."""


class ChannelError(YawidError):
    """A channel that cannot be made from the messages there are."""

    exit_code = 3


class SinkError(YawidError):
    """A file or viewer that cannot be written."""


class NotIdentifiable(YawidError):  # noqa: N818 it names a finding, not a fault
    """A record that cannot answer: not of the form asked for, or showing too little of it."""

    exit_code = 5
