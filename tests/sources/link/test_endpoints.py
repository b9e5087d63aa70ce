"""Where to listen, as it is written: pymavlink's spellings, and what is refused of them."""

from __future__ import annotations

import pytest

from yawid.errors import ConfigError
from yawid.sources.link.endpoints import parse_endpoint


@pytest.mark.parametrize(
    "text",
    ["udpin:127.0.0.1:14560", "udpin:0.0.0.0:14560", "udpout:10.0.0.1:14550",
     "udpbcast:192.168.1.255:14550", "tcp:127.0.0.1:5760", "mcast:239.1.2.3:14551",
     "/dev/ttyUSB0,921600", "COM3,57600", "com3,57600", "udpin:[::1]:14560", "udpin:[::]:14560",
     "udpout:[2001:db8::7]:14550", "tcp:[fe80::1%eth0]:5760", "udpin:[::ffff:10.0.0.1]:14560"],
)  # fmt: skip
def test_an_endpoint_that_leaves_nothing_open_is_taken(text: str) -> None:
    assert str(parse_endpoint(text)) == text


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("mcast:", "mcast:239.255.145.50:14550"),
        ("mcast:14551", "mcast:239.255.145.50:14551"),
        ("/dev/ttyACM0", "/dev/ttyACM0,57600"),
    ],
)
def test_what_an_endpoint_leaves_out_is_pymavlink_s_default(text: str, meant: str) -> None:
    assert str(parse_endpoint(text)) == meant


@pytest.mark.parametrize(
    "text",
    ["udp:", "udp:127.0.0.1:14550", "udpin:14550", "udpin:", "udpin::14550", "14550", "",
     "127.0.0.1:14550", "udpin:127.0.0.1:", "udpin:127.0.0.1:port", "udpin:127.0.0.1:70000"],
)  # fmt: skip
def test_an_endpoint_that_leaves_something_open_is_refused_with_both_spellings(text: str) -> None:
    port = "14550" if "14550" in text else "14560"
    with pytest.raises(ConfigError) as caught:
        parse_endpoint(text)
    assert f"udpin:127.0.0.1:{port}" in str(caught.value)
    assert f"udpin:0.0.0.0:{port}" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["/dev/ttyUSB0,0", "/dev/ttyUSB0,99999999999"])
def test_a_baud_rate_no_port_has_is_refused_with_the_usual_one(text: str) -> None:
    with pytest.raises(ConfigError, match="not a baud rate: write /dev/ttyUSB0,57600"):
        parse_endpoint(text)


@pytest.mark.parametrize("text", ["tcpin:0.0.0.0:5760", "ws:127.0.0.1:1", "unix:/tmp/x"])
def test_other_kinds_of_endpoint_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(ConfigError, match=r"not supported, write udpin:127\.0\.0\.1"):
        parse_endpoint(text)


@pytest.mark.parametrize(
    "text",
    ["udpin:::1:14560", "udpin:[::1]", "udpin:[::1:14560", "udpbcast:[::1]:14560",
     "mcast:[ff02::1]:14550", "tcp:2001:db8::7:5760", "udpin:[::1]:14560:"],
)  # fmt: skip
def test_an_ipv6_address_written_otherwise_is_refused_with_the_right_spelling(text: str) -> None:
    with pytest.raises(ConfigError, match=r"in brackets.*udpin:\[::1\]:14560") as caught:
        parse_endpoint(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["udpin:[127.0.0.1]:14560", "udpin:[12]:14560"])
def test_brackets_are_for_ipv6_alone(text: str) -> None:
    with pytest.raises(ConfigError, match="does not say where"):
        parse_endpoint(text)
