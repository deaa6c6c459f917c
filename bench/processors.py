"""How far the numbers of unlike processors are apart, and that with the instructions that all have they are the same to the bit.

    python -m bench.processors          (minutes: kernels are compiled for another processor)

Candidates are evaluated by this machine with all that its processor has, by this machine with what a processor of 2013 has (`COMMON`),
and, where qemu-x86_64 is installed, by such a processor, emulated.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bench import coverage, coverage_laws
from engine import signals
from engine.analysis.measuring import MetricRequest
from engine.batch.screening import Screening

COMMON = {
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+avx,+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sse3,+sse4.1,+sse4.2,+ssse3",
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
}
"""What lets compiled kernels, linear algebra and arrays use no instruction that a processor of 2013 does not have."""
_CANDIDATES = 12
_EMULATED = ("qemu-x86_64", "-cpu", "Haswell")


def evaluate(to: Path) -> None:
    """Write numbers of candidates of a linear loop, one with a delay and one with a saturation, NaN where the exact path decides."""
    step = {"reference": signals.make("step", {})}
    timed = [
        MetricRequest(metric=name, signals=step, output="position", duration=duration)
        for name in ("overshoot", "settling_time", "rise_time", "itae")
        for duration in (None, 1.0)
    ]
    framed = [
        MetricRequest(metric=name, open_at="error") for name in ("phase_margin", "gain_margin", "sensitivity_peak")
    ]
    rng = np.random.default_rng(1)
    points = {
        f"pid.{name}": middle * 10 ** rng.uniform(-0.5, 0.5, _CANDIDATES)
        for name, middle in (("kp", 8.0), ("ki", 2.0), ("kd", 0.4))
    }
    found = []
    for system in (coverage.diagram(), coverage.diagram(1e-3), coverage_laws.loop("saturation", 0.0)):
        screened = Screening(system, [*timed, *framed], threads=1)(points)
        found.append(np.where(screened.doubtful, np.nan, screened.values))
    np.save(to, np.array(found))


def numbers_of(more: Mapping[str, str], way: Sequence[str] = ()) -> npt.NDArray[np.float64]:
    """Return the numbers that a process of its own finds, with more settings, started in some way."""
    with tempfile.TemporaryDirectory() as folder:
        to = Path(folder) / "numbers.npy"
        code = f"from pathlib import Path; from bench.processors import evaluate; evaluate(Path({str(to)!r}))"
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"} | more
        subprocess.run([*way, sys.executable, "-W", "ignore", "-c", code], env=environment, check=True)  # noqa: S603 - ours
        found: npt.NDArray[np.float64] = np.load(to)
        return found


def apart(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]) -> str:
    """Say how many numbers differ, and by how much of them at most."""
    known = ~np.isnan(one) & ~np.isnan(other)
    with np.errstate(invalid="ignore"):
        differ = known & (one != other)
        most = np.abs(one - other)[differ] / np.abs(other)[differ]
    doubts = int((np.isnan(one) != np.isnan(other)).sum())
    return f"{known.sum()} numbers, {differ.sum()} differ, by {most.max(initial=0.0):.1e} at most; {doubts} doubted by one alone"


def main() -> None:
    """Compare, and print."""
    here, common = numbers_of({}), numbers_of(COMMON)
    print(f"all that this processor has, beside what all have: {apart(here, common)}")
    if shutil.which(_EMULATED[0]) is None:
        print("qemu-x86_64 is not installed: no other processor to compare with")
        return
    print(f"what all have, beside an emulated processor of 2013: {apart(common, numbers_of(COMMON, _EMULATED))}")


if __name__ == "__main__":
    main()
