"""Streams from sockets: an address becomes a source."""

from __future__ import annotations

from clsim.errors import InputError
from clsim.events.sockets.address import parse_address
from clsim.events.sockets.dv_source import DvSource
from clsim.events.sockets.stream_source import SocketSource

TIMEOUT_S = 5.0


def open_socket_source(url: str, *, timeout_s: float = TIMEOUT_S, idle_timeout_s: float | None = None) -> SocketSource:
    """Open ``tcp://HOST:PORT``, ``unix://PATH`` or ``udp://HOST:PORT?size=WIDTHxHEIGHT&format=t64|t32|spif``.

    Over TCP and UNIX sockets this is a client of DV's protocol. Over UDP it listens at the address and, because
    datagrams tell no sensor size, needs to be told. Within ``timeout_s`` the server must answer, and a packet that has
    begun must go on. After ``idle_timeout_s`` without an event the iteration ends (None: never; still scenes are
    silent).

    Raises:
        InputError: the address is malformed, nobody listens there, or what comes is not DV's protocol.
    """
    address = parse_address(url)
    if address.scheme == "udp":
        from clsim.events.sockets.udp_source import UdpSource

        return UdpSource(address, idle_timeout_s)
    if address.scheme in ("tcp", "unix"):
        return DvSource(address, timeout_s, idle_timeout_s)
    raise InputError(f"{url}: no stream can be read there; expected tcp://HOST:PORT, unix://PATH or udp://HOST:PORT")
