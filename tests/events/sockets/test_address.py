"""Addresses: what is taken apart, and the one sentence for what is not."""

from __future__ import annotations

import socket

import pytest

from clsim.errors import InputError
from clsim.events.socket_sinks import open_socket_sink
from clsim.events.sockets.address import Address, exposure_warning, parse_address, resolve
from clsim.events.sockets.sources import open_socket_source


def test_addresses_taken_apart() -> None:
    def parts(text: str) -> tuple[str, str, int, str, dict[str, str]]:
        address = parse_address(text)
        assert address == Address(text, address.scheme, address.host, address.port, address.path, address.options)
        return address.scheme, address.host, address.port, address.path, address.options

    assert parts("tcp://10.1.2.3:7777") == ("tcp", "10.1.2.3", 7777, "", {})
    assert parts("tcp://:7777") == ("tcp", "127.0.0.1", 7777, "", {})
    assert parts("tcp://[::1]:0?compression=none") == ("tcp", "::1", 0, "", {"compression": "none"})
    assert parts("udp://localhost:3333?format=spif&size=4x3") == (
        "udp",
        "localhost",
        3333,
        "",
        {"format": "spif", "size": "4x3"},
    )
    assert parts("unix:///run/a b.sock") == ("unix", "", 0, "/run/a b.sock", {})
    assert parts("-") == ("-", "", 0, "", {})


def test_ipv4_first(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [(socket.AF_INET6, 1, 6, "", ("::1", 7, 0, 0)), (socket.AF_INET, 1, 6, "", ("127.0.0.1", 7))]
    monkeypatch.setattr("socket.getaddrinfo", lambda *_, **__: found)
    assert resolve(parse_address("tcp://localhost:7")) == (socket.AF_INET, ("127.0.0.1", 7))


@pytest.mark.parametrize(
    ("text", "host", "warning"),
    [
        ("tcp://0.0.0.0:7", "0.0.0.0", "every machine that reaches this address can read the events; nothing is enc"),
        ("udp://192.0.2.1:7", "192.0.2.1", "the events leave this machine; nothing is encrypted"),
        ("udp://[fe80::1%lo]:7", "fe80::1%lo", "the events leave this machine"),
        ("tcp://localhost:7", "127.0.0.1", None),
        ("udp://[::1]:7", "::1", None),
    ],
)
def test_who_can_read_events_is_told_where_they_leave_the_machine(text: str, host: str, warning: str | None) -> None:
    found = exposure_warning(parse_address(text), (host, 7))
    assert found is warning is None or (found or "").startswith(f"{text}: {warning}")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "no stream address"),
        ("events.aedat4", "no stream address"),
        ("http://127.0.0.1:80", "no stream address"),
        ("tcp://127.0.0.1", "expected tcp://HOST:PORT"),
        ("tcp://::1:7777", "expected tcp://HOST:PORT"),
        ("tcp://127.0.0.1:", "the port is ''"),
        ("tcp://127.0.0.1:65536", "the port is '65536'"),
        ("tcp://127.0.0.1:-1", "the port is '-1'"),
        ("tcp://127.0.0.1:٣", "the port is '٣'"),
        ("tcp://127.0.0.1:7777/path", "the port is '7777/path'"),
        ("tcp://no-such-host.invalid:7777", "the host 'no-such-host.invalid' is unknown"),
        ("tcp://127.0.0.1:0?compression", "not of the form name=value"),
        ("tcp://127.0.0.1:0?compression=zip", "compression is 'zip'; expected lz4 or none"),
        ("tcp://127.0.0.1:0?queue_mb=0", "queue_mb is '0'"),
        ("tcp://127.0.0.1:0?format=t64", "unknown option 'format'; expected compression or queue_mb"),
        ("udp://127.0.0.1:9?format=t16", "format is 't16'; expected t64, t32 or spif"),
        ("udp://127.0.0.1:0", "the port is 0"),
        ("unix://", "expected a path after unix://"),
        ("unix://no/such/folder/s", "cannot be used (No such file or directory)"),
        ("unix:///tmp/" + "long" * 30, "cannot be used (AF_UNIX path too long)"),
        ("-?format=dat", "format is 'dat'; expected text or aedat4"),
    ],
)
def test_sink_addresses_refused(text: str, complaint: str) -> None:
    with pytest.raises(InputError) as raised:
        open_socket_sink(text, 64, 48).close()
    assert complaint in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("-", "no stream can be read there"),
        ("tcp://127.0.0.1:1?compression=none", "takes none"),
        ("tcp://127.0.0.1:1", "cannot be reached"),
        ("tcp://no-such-host.invalid:7777", "cannot be reached"),
        ("unix:///no/such/socket", "cannot be reached"),
        ("udp://127.0.0.1:0", "expected ?size=WIDTHxHEIGHT"),
        ("udp://127.0.0.1:0?size=0x3", "expected ?size=WIDTHxHEIGHT"),
        ("udp://192.0.2.1:9?size=4x3", "cannot be used"),  # an address no machine has (RFC 5737)
    ],
)
def test_source_addresses_refused(text: str, complaint: str) -> None:
    with pytest.raises(InputError) as raised:
        open_socket_source(text, timeout_s=5).close()
    assert complaint in str(raised.value)


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
@pytest.mark.parametrize("port", [0, 1, 1024, 65534, 65535])
def test_every_port_that_there_is_can_be_named(scheme: str, port: int) -> None:
    assert parse_address(f"{scheme}://127.0.0.1:{port}").port == port
