"""What computes on a machine that has no room for the second process that is asked for."""

from __future__ import annotations

import errno
import itertools
import os

from tests.support.computing import run as run  # noqa: PLC0414 - what a worker asks this module for

_fork, _numbers = os.fork, itertools.count(1)


def _fork_if_there_is_room() -> int:
    if next(_numbers) == 2:
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))
    return _fork()


os.fork = _fork_if_there_is_room
