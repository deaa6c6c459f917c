"""Files that several processes map: what one of them writes, the others see; none of them waits for one that stands still."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from api.http.rate_limits import Rates
from api.runtime.shared_memory import Number, SharedBuckets

#: Holds the lock on the whole of a file until its input ends.
HOLD = "import fcntl, sys; file = open(sys.argv[1], 'r+b'); fcntl.lockf(file, fcntl.LOCK_EX); print(flush=True); sys.stdin.read()"
#: Takes so many tokens of a caller.
TAKE = """
import sys
from pathlib import Path
from api.http.rate_limits import Rates
from api.runtime.shared_memory import SharedBuckets
rates = Rates(int(sys.argv[2]), clock=lambda: 1.0, buckets=SharedBuckets(Path(sys.argv[1])))
print(sum(rates.take("somebody").wait == 0.0 for _ in range(int(sys.argv[3]))))
"""


def test_processes_that_count_at_once_let_through_what_one_would(tmp_path: Path) -> None:
    command = [sys.executable, "-c", TAKE, str(tmp_path / "rates"), "3000", "2000"]
    together = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    through = [int(process.communicate()[0]) for process in together]
    assert sum(through) == 3000
    assert max(through) <= 2000


def test_callers_have_buckets_of_their_own_however_many_there_are(tmp_path: Path) -> None:
    now = 1.0
    rates = Rates(60, clock=lambda: now, buckets=SharedBuckets(tmp_path / "rates", places=64))
    for number in range(500):
        now += 1e-6
        allowance = rates.take(f"caller {number}")
        assert allowance is not None
        assert allowance.left == 59
    allowance = rates.take("caller 499")
    assert allowance is not None
    assert allowance.left == 58


def test_a_number_is_everybodys(tmp_path: Path) -> None:
    one, other = Number(tmp_path / "number"), Number(tmp_path / "number")
    assert other.get() == 0
    one.set(7)
    other.count()
    assert one.get() == 8


def test_nobody_waits_for_a_process_that_stands_still_with_the_lock(tmp_path: Path) -> None:
    number = Number(tmp_path / "number")
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "number")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        number.count()
        number.count()
        assert number.get() == 2
        holder.communicate()
