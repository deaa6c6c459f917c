"""A TCP connection to a port of this machine that can be cut."""

from __future__ import annotations

import contextlib
import socket
import threading


class Cable:
    """Leads connections from a port of its own to another one, until it is cut."""

    def __init__(self, port: int) -> None:
        self.target, self.whole = port, True
        self._ends: list[socket.socket] = []
        self._door = socket.create_server(("127.0.0.1", 0))
        self.port = self._door.getsockname()[1]
        self.connections = 0
        threading.Thread(target=self._listen, daemon=True).start()

    def cut(self, *, for_good: bool = False) -> None:
        self.whole = not for_good
        for end in self._ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        self._ends.clear()

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._door.shutdown(socket.SHUT_RDWR)
        self._door.close()
        self.cut()

    def _listen(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._door.accept()
                far = self._connected()
                if far is None:
                    near.close()
                    continue
                self._ends += [near, far]
                self.connections += 1
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=pair, daemon=True).start()

    def _connected(self) -> socket.socket | None:
        """Return the other end; None while the cable is cut, or nobody is there."""
        if not self.whole:
            return None
        try:
            return socket.create_connection(("127.0.0.1", self.target))
        except OSError:
            return None

    @staticmethod
    def _carry(source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65_536):
                target.sendall(data)
        with contextlib.suppress(OSError):
            target.shutdown(socket.SHUT_RDWR)
