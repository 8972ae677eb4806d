"""``unix://PATH``: what ``tcp://`` sends, over a UNIX socket."""

from __future__ import annotations

import contextlib
import os
import socket
import stat

from clsim.errors import InputError
from clsim.events.sockets.address import Address, parse_address, unusable
from clsim.events.sockets.tcp import MAX_CLIENTS, StreamServer, stream_options


class UnixSink(StreamServer):
    """A server at ``unix://PATH?compression=lz4|none&queue_mb=64``; the socket file is removed at the end."""

    def __init__(self, address: Address | str, width: int, height: int) -> None:
        """Start to listen, replacing a socket file whose server is gone.

        Raises:
            InputError: the address is malformed or in use, the path is that of another file or cannot be created, or
                the sensor is too large for the protocol.
        """
        if isinstance(address, str):
            address = parse_address(address)
        encoder, queue_bytes = stream_options(address, width, height)
        self.path = address.path
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            _remove_stale(address)
            listener.bind(address.path)
            listener.listen(MAX_CLIENTS)
            self._inode = os.stat(address.path).st_ino
        except OSError as error:
            listener.close()
            raise unusable(address, error, "a path in a folder that exists and may be written") from None
        except InputError:
            listener.close()
            raise
        super().__init__(listener, encoder, queue_bytes)

    def close(self) -> None:
        """Close as StreamServer does, and remove the socket file unless another took its place."""
        super().close()
        with contextlib.suppress(FileNotFoundError):
            if os.stat(self.path).st_ino == self._inode:
                os.unlink(self.path)


def _remove_stale(address: Address) -> None:
    """Remove the socket file of a server that is gone; refuse any other file."""
    try:
        mode = os.lstat(address.path).st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise InputError(f"{address.text}: the file exists and is no socket; expected a free path")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(address.path)
        except ConnectionRefusedError:
            os.unlink(address.path)
            return
        except BlockingIOError:  # its queue of newcomers is full: somebody listens
            pass
    raise InputError(f"{address.text}: a server listens there already; expected a free path")
