"""Where to listen: pymavlink's connection strings, except those that are ambiguous."""

import re
from dataclasses import dataclass
from typing import Literal, cast

from yawid.errors import ConfigError

EndpointKind = Literal["udpin", "udpout", "udpbcast", "mcast", "tcp", "serial"]
MULTICAST = ("239.255.145.50", 14550)  # ArduPilot's group, and pymavlink's default
BAUD = 57600
_HOST_PORT = re.compile(r"(udpin|udpout|udpbcast|tcp):([^:\s\[\]]+):(\d+)")
_HOST6_PORT = re.compile(r"(udpin|udpout|tcp):\[([\da-fA-F.]*:[\da-fA-F:.]*(?:%[\w.-]+)?)\]:(\d+)")
_MULTICAST = re.compile(r"mcast:(?:(?:(\d+(?:\.\d+){3}):)?(\d+))?")
_SERIAL = re.compile(r"(/dev/[^,\s]+|(?i:COM)\d+)(?:,(\d+))?")
_UNSUPPORTED = ("tcpin", "uds", "unix", "ws", "wss")


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A host and a port (0 is any free one), or a serial device and its baud rate.

    A host with a colon is an IPv6 address; it is written in brackets.
    """

    host: str
    port: int
    kind: EndpointKind = "udpin"

    def __str__(self) -> str:
        if self.kind == "serial":
            return f"{self.host},{self.port}"
        return f"{self.kind}:{written(self.host, self.port)}"

    @property
    def to_send(self) -> str:
        """What to type at the sender, or to check, where nothing arrives."""
        here = "ADDRESS-OF-THIS-MACHINE" if self.host in ("0.0.0.0", "::") else self.host
        at = written(here, self.port)
        if self.kind == "udpin":
            return f"in MAVProxy: output add {at}; mavlink-router: mavlink-routerd -e {at} ..."
        if self.kind == "serial":
            return f"check cable, port, baud rate ({self.port}) and the radio"
        return f"start the program that sends to {self}"

    @property
    def is_ipv6(self) -> bool:
        """Whether the host is an IPv6 address."""
        return ":" in self.host


def written(host: str, port: int) -> str:
    """Return an address as text, an IPv6 host in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def parse_endpoint(text: str) -> Endpoint:
    """Return the endpoint that a pymavlink connection string names.

    Raises:
        ConfigError: it is ambiguous or not supported; the message gives the right spellings.
    """
    if match := _MULTICAST.fullmatch(text):
        host, port = match[1] or MULTICAST[0], int(match[2] or MULTICAST[1])
        return _checked(Endpoint(host, port, "mcast"), text)
    if match := _SERIAL.fullmatch(text):
        baud = int(match[2] or BAUD)
        if not 0 < baud < 1 << 31:
            raise ConfigError(f"{text!r}: {baud} is not a baud rate: write {match[1]},{BAUD}")
        return Endpoint(match[1], baud, "serial")
    if match := _HOST_PORT.fullmatch(text) or _HOST6_PORT.fullmatch(text):
        return _checked(Endpoint(match[2], int(match[3]), cast("EndpointKind", match[1])), text)
    named = text.partition(":")[0]
    if named in _UNSUPPORTED:
        raise ConfigError(f"{text!r}: {named} is not supported, {_spellings(text)}")
    if text.count(":") > 2:
        raise ConfigError(
            f"{text!r}: an IPv6 address is written in brackets, after udpin, udpout or tcp: write "
            "udpin:[::1]:14560 (from this machine) or udpin:[::]:14560 (from the network)"
        )
    raise ConfigError(f"{text!r} does not say where to listen, {_spellings(text)}")


def _checked(endpoint: Endpoint, text: str) -> Endpoint:
    if not 0 < endpoint.port < 65536:
        raise ConfigError(f"{text!r}: {endpoint.port} is not a port, {_spellings('')}")
    return endpoint


def _spellings(text: str) -> str:
    """Return both right spellings in words, with the port in the text if there is one."""
    match = re.search(r"(?:^|:)(\d+)$", text)
    port = match[1] if match and 0 < int(match[1]) < 65536 else "14560"
    return (
        f"write udpin:127.0.0.1:{port} (from this machine) "
        f"or udpin:0.0.0.0:{port} (from the network)"
    )
