"""Events to wherever an address points."""

from __future__ import annotations

import os
from typing import Any

from clsim.errors import InputError
from clsim.events.batch import Sink
from clsim.events.sockets.address import Address, parse_address


def open_socket_sink(url: str, width: int, height: int, **options: Any) -> Sink:
    """Open an address for the events of a sensor of ``width`` × ``height`` pixels.

    ``tcp://HOST:PORT`` and ``unix://PATH`` serve DV's protocol (``?compression=lz4|none&queue_mb=64``),
    ``udp://HOST:PORT`` sends datagrams (``?format=t64|t32|spif``), ``-`` is standard output (``?format=text|aedat4``;
    ``options`` are the format's, as in clsim.events.files.open_sink).

    Raises:
        InputError: the address is malformed, in use, or not fit for the sensor.
    """
    address = parse_address(url)
    if address.scheme == "tcp":
        from clsim.events.sockets.tcp import TcpSink

        return TcpSink(address, width, height)
    if address.scheme == "unix":
        from clsim.events.sockets.unix import UnixSink

        return UnixSink(address, width, height)
    if address.scheme == "udp":
        from clsim.events.sockets.udp import UdpSink

        return UdpSink(address, width, height)
    return _open_stdout(address, width, height, options)


def _open_stdout(address: Address, width: int, height: int, options: dict[str, Any]) -> Sink:
    from clsim.events.files import open_sink

    address.allow(format=("text", "aedat4"))
    kind = address.options.get("format", "text")
    if kind != "text" and os.isatty(1):
        raise InputError(f"{address.text}: standard output is a terminal; expected a pipe or a file for binary events")
    return open_sink("-", width, height, format=kind, **options)
