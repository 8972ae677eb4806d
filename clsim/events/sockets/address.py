"""Stream addresses: ``tcp://HOST:PORT``, ``udp://HOST:PORT``, ``unix://PATH`` and ``-``, with ``?option=value``."""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass, field
from typing import Any, TypeAlias
from urllib.parse import parse_qsl

from clsim.errors import InputError

SCHEMES = ("tcp", "udp", "unix")

SocketName: TypeAlias = Any
"""What the socket module takes as an address: its form depends on the family."""


@dataclass(frozen=True)
class Address:
    """An address taken apart; ``text`` is how the user wrote it."""

    text: str
    scheme: str
    """``tcp``, ``udp``, ``unix``, or ``-`` for standard output."""
    host: str = ""
    port: int = 0
    path: str = ""
    options: dict[str, str] = field(default_factory=dict)

    def allow(self, **choices: tuple[str, ...]) -> None:
        """Check the options: each must be named here, with one of these values (any value if there are none).

        Raises:
            InputError: an option or its value is unknown.
        """
        for name, value in self.options.items():
            if name not in choices:
                expected = f"expected {_listed(tuple(choices))}" if choices else "this kind of address takes none"
                raise InputError(f"{self.text}: unknown option {name!r}; {expected}")
            if choices[name] and value not in choices[name]:
                raise InputError(f"{self.text}: {name} is {value!r}; expected {_listed(choices[name])}")


def is_address(name: str) -> bool:
    """Tell whether an output is a socket address or standard output rather than a file."""
    return is_standard_output(name) or "://" in name


def is_standard_output(name: str) -> bool:
    """Tell whether an output is ``-``, perhaps with options as in ``-?format=aedat4``."""
    return name.partition("?")[0] == "-"


def parse_address(text: str) -> Address:
    """Take an address apart. ``tcp://:7777`` means the loopback address; IPv6 addresses stand in brackets.

    Raises:
        InputError: unknown scheme, no port, a port outside 0 … 65535, an empty path, or malformed options.
    """
    target, mark, query = text.partition("?")
    try:
        options = dict(parse_qsl(query, keep_blank_values=True, strict_parsing=True)) if mark else {}
    except ValueError:
        raise InputError(f"{text}: the options {query!r} are not of the form name=value&name=value") from None
    if target == "-":
        return Address(text, "-", options=options)
    scheme, separator, rest = target.partition("://")
    if not separator or scheme not in SCHEMES:
        raise InputError(f"{text!r} is no stream address; expected tcp://HOST:PORT, udp://HOST:PORT, unix://PATH or -")
    if scheme == "unix":
        if not rest or "\0" in rest:
            raise InputError(f"{text!r}: expected a path after unix://, as in unix:///tmp/events.sock")
        return Address(text, scheme, path=rest, options=options)
    host, separator, port = rest.rpartition(":")
    bracketed = host.startswith("[") and host.endswith("]")
    if not separator or (":" in host and not bracketed):
        raise InputError(
            f"{text}: expected {scheme}://HOST:PORT, as in {scheme}://127.0.0.1:7777 or {scheme}://[::1]:7777"
        )
    if not (port.isascii() and port.isdigit() and len(port) <= 5 and int(port) <= 65535):
        raise InputError(f"{text}: the port is {port!r}; expected a number within 0 … 65535")
    host = host[1:-1] if bracketed else host
    return Address(text, scheme, host or "127.0.0.1", int(port), options=options)


def resolve(address: Address) -> tuple[socket.AddressFamily, SocketName]:
    """Look up the host of a ``tcp`` or ``udp`` address.

    Raises:
        InputError: the host is unknown.
    """
    kind = socket.SOCK_STREAM if address.scheme == "tcp" else socket.SOCK_DGRAM
    try:
        found = socket.getaddrinfo(address.host, address.port, type=kind)
    except (OSError, UnicodeError) as error:
        raise InputError(f"{address.text}: the host {address.host!r} is unknown ({cause(error)})") from None
    # IPv4 first: who serves at "localhost" means 127.0.0.1, where most clients look.
    family, _, _, _, name = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return family, name


def exposure_warning(address: Address, name: SocketName) -> str | None:
    """Return a sentence of warning if the resolved address ``name`` is open to other machines."""
    if ipaddress.ip_address(name[0].partition("%")[0]).is_loopback:
        return None
    if address.scheme == "tcp":
        return f"{address.text}: every machine that reaches this address can read the events; nothing is encrypted"
    return f"{address.text}: the events leave this machine; nothing is encrypted"


def unusable(address: Address, error: OSError, expected: str = "a free port of this machine") -> InputError:
    """Return the one sentence for an address the operating system refuses."""
    return InputError(f"{address.text}: cannot be used ({cause(error)}); expected {expected}")


def cause(error: Exception) -> str:
    """Return what the operating system says of an error."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def _listed(words: tuple[str, ...]) -> str:
    return " or ".join((", ".join(words[:-1]), words[-1])) if len(words) > 1 else words[0]
