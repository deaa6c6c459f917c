"""When memory is given back: where a process has much more than it once got along with."""

from __future__ import annotations

import math
import subprocess
import sys

from api.runtime.memory import Memory
from api.settings import Settings

MIB = 1 << 20


def test_it_is_given_back_once_there_is_much_more_than_there_was() -> None:
    found, given = [200 * MIB], []

    def give_back() -> None:
        given.append(found[0])
        found[0] = 210 * MIB

    memory = Memory(measure=lambda: found[0], give_back=give_back)
    for now in (200, 215, 230, 600, 180, 190, 230):
        found[0] = now * MIB
        memory.look()
    assert given == [600 * MIB, 230 * MIB]  # 230 is a little for 200, and much for 180


#: Rings of objects that are few and large, made in a thread; what is left of them when they are given back.
LOAD = """
import gc, threading
from api.runtime.memory import give_back, resident

class Ring:
    def __init__(self):
        self.itself = self
        self.large = [bytearray(1 << 15) for _ in range(100)]

gc.disable()
before = resident()
def work():
    for _ in range(100):
        Ring()
thread = threading.Thread(target=work)
thread.start()
thread.join()
peak = resident()
give_back()
print(peak - before, resident() - before)
"""


def test_what_threads_and_rings_hold_goes_back_to_the_system() -> None:
    done = subprocess.run([sys.executable, "-c", LOAD], capture_output=True, text=True, check=True)
    peak, left = map(int, done.stdout.split())
    assert peak > 300 * MIB
    assert left < peak / 10


def test_jobs_are_planned_with_half_of_the_memory_that_they_may_have() -> None:
    assert Settings(job_memory=2 << 30).job_plan == 1 << 30
    assert Settings(job_memory=0).job_plan == math.inf
