"""The worker's hold on its zygote and on the children that compute."""

from __future__ import annotations

import itertools
import os
import pickle
import select
import signal
import socket
import subprocess
import sys
import threading
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import suppress
from pathlib import Path

from storage.jobs.compute import HEADER, ComputeJob, Frame, send
from storage.jobs.zygote import COMMAND, EXITED, KILL, NOT_STARTED, PREPARED, START

_PIECE = 1 << 20
_END = b"e"


class ChildDied(Exception):  # noqa: N818 - said as it is
    """A child ended without a word; the message says how, and ``signal`` what killed it."""

    def __init__(self, how: str, signal: int | None = None) -> None:
        super().__init__(how)
        self.signal = signal


class Child:
    """A process that computes one job."""

    def __init__(self, zygote: Zygote, number: int, *, pipe: socket.socket, control: socket.socket) -> None:
        self._zygote = zygote
        self._pipe = pipe
        self.number = number
        #: The line to the zygote that it was forked from.
        self.control = control
        self._received = bytearray()
        #: The wait status, None when the zygote went first.
        self.exited: Future[int | None] = Future()

    def receive(self, timeout: float) -> Frame | None:
        """Return the next frame, or None when it is not complete within ``timeout`` (s).

        Raises
        ------
        ChildDied
            When there will be no more.
        """
        while True:
            if len(self._received) >= HEADER.size:
                (length,) = HEADER.unpack_from(self._received)
                if len(self._received) >= HEADER.size + length:
                    frame: Frame = pickle.loads(self._received[HEADER.size : HEADER.size + length])  # noqa: S301 - from our own child
                    del self._received[: HEADER.size + length]
                    return frame
            if not select.select([self._pipe], [], [], timeout)[0]:
                return None
            try:
                piece = self._pipe.recv(_PIECE)
            except ConnectionResetError:
                piece = b""
            if not piece:
                raise self._death()
            self._received += piece

    def end(self) -> None:
        """Ask a computation that listens to hand over what it has."""
        with suppress(OSError):  # it has just ended
            self._pipe.send(_END)

    def kill(self) -> None:
        """Kill the process and all that it started; nothing happens when it has ended."""
        self._pipe.close()
        self._zygote.kill(self)

    def _death(self) -> ChildDied:
        try:
            status = self.exited.result(timeout=5)
        except FutureTimeoutError:
            return ChildDied("the computing process closed its pipe")
        if status is None:
            return ChildDied("the computing process lost the process that started it")
        if status == NOT_STARTED:
            return ChildDied("the computing process could not be started: the system has no room for another one")
        code = os.waitstatus_to_exitcode(status)
        if code >= 0:
            return ChildDied(f"the computing process ended by itself with exit code {code}")
        hint = ", perhaps because memory ran out" if -code == signal.SIGKILL else ""
        return ChildDied(f"the computing process was killed by {signal.Signals(-code).name}{hint}", -code)


class Zygote:
    """Starts children; is started itself with the first one, and again after it died."""

    def __init__(self, compute_path: str) -> None:
        self._compute_path = compute_path
        self._lock = threading.Lock()
        self._numbers = itertools.count()
        self._children: dict[int, Child] = {}
        self._process: subprocess.Popen[bytes] | None = None
        self._control: socket.socket | None = None
        self._reader: threading.Thread | None = None
        #: How long it took to load what computes, None until that is done.
        self.warm_up_seconds: float | None = None
        self._settled = threading.Event()

    def warm_up(self) -> None:
        """Begin to import the compute function; returns at once."""
        with self._lock:
            self._ensure()

    def settled(self, timeout: float) -> bool:
        """Wait until it can compute, or will never be able to, which a child then tells; False after ``timeout`` (s)."""
        return self._settled.wait(timeout)

    def start(self, job: ComputeJob) -> Child:
        """Give a job to a fresh child."""
        ours, theirs = socket.socketpair()
        with theirs, self._lock:
            control = self._ensure()
            number = next(self._numbers)
            child = Child(self, number, pipe=ours, control=control)
            self._children[number] = child
            try:
                socket.send_fds(control, [COMMAND.pack(START, number)], [theirs.fileno()])
            except OSError:
                self._forget(child, None)
        with suppress(OSError):  # a zygote that could not import its function shows in `Child.receive`
            send(ours, job)
        return child

    def kill(self, child: Child) -> None:
        """Kill a child, unless it has ended."""
        with self._lock:
            if child.number in self._children:
                try:
                    child.control.sendall(COMMAND.pack(KILL, child.number))
                except OSError:
                    return  # the zygote is dead, and its children with it

    def close(self) -> None:
        """Kill all children and the zygote."""
        with self._lock:
            process, control, reader = self._process, self._control, self._reader
            self._process = None
        if process is None or reader is None:
            return
        if control is not None:
            with suppress(OSError):  # it went by itself meanwhile
                control.shutdown(socket.SHUT_RDWR)
        try:
            process.wait(timeout=2)
        except subprocess.TimeoutExpired:
            process.kill()  # it was still importing
            process.wait()
        reader.join()

    def _ensure(self) -> socket.socket:
        if self._process is None or self._process.poll() is not None or self._control is None:
            if self._process is not None:  # it is dead, or closed its line and is about to be
                self._process.kill()
                self._process.wait()
            ours, theirs = socket.socketpair()
            with theirs:
                self._process = subprocess.Popen(  # noqa: S603 - our own module
                    [sys.executable, "-P", "-m", "storage.jobs.zygote", self._compute_path, str(theirs.fileno())],
                    stdin=subprocess.DEVNULL,
                    pass_fds=[theirs.fileno()],
                    env={
                        **os.environ,
                        "PYTHONPATH": os.pathsep.join(str(Path(path).absolute()) for path in sys.path),
                    },
                    start_new_session=True,
                )
            self._control = ours
            self._settled.clear()
            self._reader = threading.Thread(target=self._read, args=(ours,), name="zygote-reader", daemon=True)
            self._reader.start()
        return self._control

    def _read(self, control: socket.socket) -> None:
        """Learn which children have ended, until the zygote has."""
        received = b""
        while True:
            try:
                piece = control.recv(EXITED.size - len(received))
            except OSError:
                piece = b""
            if not piece:
                break
            received += piece
            if len(received) == EXITED.size:
                number, status = EXITED.unpack(received)
                received = b""
                if number == PREPARED:
                    self.warm_up_seconds = status / 1000
                    self._settled.set()
                    continue
                with self._lock:
                    self._forget(self._children.get(number), status)
        with self._lock:
            if self._control is control:
                self._control = None
                self._settled.set()
            for child in [child for child in self._children.values() if child.control is control]:
                self._forget(child, None)
            control.close()

    def _forget(self, child: Child | None, status: int | None) -> None:
        if child is not None and self._children.pop(child.number, None) is not None:
            child.exited.set_result(status)
