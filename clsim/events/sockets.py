"""Events to wherever an address points."""

from __future__ import annotations

from clsim.errors import InputError
from clsim.events.address import parse_address
from clsim.events.batch import Sink


def open_socket_sink(url: str, width: int, height: int) -> Sink:
    """Open ``tcp://HOST:PORT`` for the events of a sensor of ``width`` × ``height`` pixels.

    Raises:
        InputError: the address is malformed, in use, or of an unknown kind.
    """
    address = parse_address(url)
    if address.scheme == "tcp":
        from clsim.events.tcp import TcpSink

        return TcpSink(address, width, height)
    raise InputError(f"{url}: events cannot be sent to {address.scheme}; expected tcp://HOST:PORT")
