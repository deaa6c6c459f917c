"""The worker beside the service: a process that ends with it, and is started again when it dies."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading

_CODE = "import sys; from api.commands import worker; sys.exit(worker(['--with-parent']))"
#: The pauses (s) before a worker that died is started again: the first one, and the longest.
_PAUSE, _LONGEST_PAUSE = 1.0, 30.0
#: A worker that lived so long (s) did not die of its start.
_LIVED = 60.0

_log = logging.getLogger(__name__)


class WorkerBeside:
    """Keeps one worker running.

    The pipe to its standard input closes however this process dies, and the worker ends with it.
    """

    def __init__(self) -> None:
        self._stopping = threading.Event()
        self._process = self._start()
        self._watch = threading.Thread(target=self._keep_running, name="worker-beside", daemon=True)
        self._watch.start()

    @property
    def pid(self) -> int:
        """The process of the worker, which may have died."""
        return self._process.pid

    def alive(self) -> bool:
        """Return whether the process is there."""
        return self._process.poll() is None

    def stop(self) -> None:
        """Let the worker give its jobs back, and end it."""
        self._stopping.set()
        self._watch.join()
        process = self._process
        assert process.stdin is not None
        process.stdin.close()
        process.terminate()
        try:
            process.wait(timeout=15)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _start(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen([sys.executable, "-c", _CODE], stdin=subprocess.PIPE)  # noqa: S603 - our own code

    def _keep_running(self) -> None:
        pause, lived = _PAUSE, 0.0
        while not self._stopping.wait(0.2):
            lived += 0.2
            code = self._process.poll()
            if code is None:
                continue
            pause = _PAUSE if lived > _LIVED else min(2 * pause, _LONGEST_PAUSE)
            _log.error("the worker beside the service ended with code %d, and starts again in %.0f s", code, pause)
            if self._stopping.wait(pause):
                return
            assert self._process.stdin is not None
            self._process.stdin.close()
            self._process, lived = self._start(), 0.0
