"""A process that has imported the compute function and forks a child for each job, within milliseconds.

It listens on a socket to its worker. When that closes, because the worker stopped or was killed, it kills every child;
when it dies itself, the kernel kills them (Linux). So no computation outlives its worker, also not one that
sits in compiled code. It has one thread and, once it is prepared, computes nothing, which is what makes forking safe
and answers quick. A module may have a function ``prepare``, called once after its import; what it need not wait for it
leaves to a process beside, and returns what is to be done `Later`.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import selectors
import signal
import socket
import struct
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import NoReturn, cast

from storage.jobs.compute import Compute, compute_one
from storage.loading import uncollected

#: Worker to zygote: what to do, and with which child; with START comes the child's end of its pipe.
COMMAND = struct.Struct("<cq")
START, KILL = b"S", b"K"
#: Zygote to worker: which child has ended, and its wait status.
EXITED = struct.Struct("<qi")
#: In place of a wait status, which is never negative: the system had no room for a child.
NOT_STARTED = -1
#: In place of a child: the zygote is prepared, after so many milliseconds.
PREPARED = -1

_PR_SET_PDEATHSIG = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Later:
    """What is left to do once a process has ended that this one has started."""

    process: int
    work: Callable[[], None]


def main(compute_path: str, control: socket.socket) -> NoReturn:
    """Serve until the worker closes its end of ``control``."""
    # Ctrl-C and a service manager's SIGTERM to every process are the worker's to handle: it gives the jobs back first.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    wake_reader, wake_writer = os.pipe()
    os.set_blocking(wake_writer, False)
    signal.signal(signal.SIGCHLD, lambda _signal, _frame: None)
    signal.set_wakeup_fd(wake_writer)
    module, _, function = compute_path.partition(":")
    with uncollected():  # what is imported stays shared between the children
        home = importlib.import_module(module)
        compute = cast("Compute", getattr(home, function))
        # What takes long to load is loaded once, here, and shared by all children.
        begun = time.monotonic()
        prepare = getattr(home, "prepare", None)
        later: Later | None = None if prepare is None else prepare()
    with suppress(BrokenPipeError):  # a worker that went meanwhile is noticed below
        control.sendall(EXITED.pack(PREPARED, round(1000 * (time.monotonic() - begun))))
    children: dict[int, int] = {}  # process id by number
    with selectors.DefaultSelector() as selector:
        selector.register(control, selectors.EVENT_READ)
        selector.register(wake_reader, selectors.EVENT_READ)
        while True:
            for key, _events in selector.select():
                if key.fileobj is control:
                    _obey(control, children, compute, inherited=(wake_reader, wake_writer))
                else:
                    os.read(wake_reader, 512)
                    ended = _reap(control, children)
                    if later is not None and later.process in ended:
                        later.work()
                        later = None


def _obey(control: socket.socket, children: dict[int, int], compute: Compute, *, inherited: tuple[int, ...]) -> None:
    data, descriptors, _flags, _address = socket.recv_fds(control, COMMAND.size, 1)
    if not data:
        for process in children.values():
            _kill(process)
        for process in children.values():
            os.waitpid(process, 0)
        os._exit(0)
    command, number = COMMAND.unpack(data)
    if command == START:
        pipe = socket.socket(fileno=descriptors[0])
        try:
            process = os.fork()
        except OSError:  # those that compute go on
            pipe.close()
            control.sendall(EXITED.pack(number, NOT_STARTED))
            return
        if process == 0:
            _be_child(control, pipe, compute, inherited)
        pipe.close()
        # Both sides set the group, so that it exists before either goes on.
        _set_group(process)
        children[number] = process
    elif number in children:
        _kill(children[number])


def _be_child(control: socket.socket, pipe: socket.socket, compute: Compute, inherited: tuple[int, ...]) -> NoReturn:
    zygote = os.getppid()
    _set_group(0)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != zygote:
            os._exit(1)
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    control.close()
    for descriptor in inherited:
        os.close(descriptor)
    try:
        compute_one(compute, pipe)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _set_group(process: int) -> None:
    try:
        os.setpgid(process, process)
    except (PermissionError, ProcessLookupError):
        return  # it has done so itself, or is gone already


def _kill(process: int) -> None:
    try:
        os.killpg(process, signal.SIGKILL)
    except ProcessLookupError:
        return


def _reap(control: socket.socket, children: dict[int, int]) -> set[int]:
    """Tell which children have ended; return the ids of all processes that have."""
    ended: set[int] = set()
    numbers = {process: number for number, process in children.items()}
    while True:
        try:
            process, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return ended
        if process == 0:
            return ended
        ended.add(process)
        if (number := numbers.get(process)) is not None:
            # Whatever the child has started and left behind goes with it.
            _kill(process)
            del children[number]
            control.sendall(EXITED.pack(number, status))


if __name__ == "__main__":
    main(sys.argv[1], socket.socket(fileno=int(sys.argv[2])))
