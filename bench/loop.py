"""The pneumatic loop evaluated once, differentiated, and evaluated for many sets of gains, by everyone who is installed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from bench.accuracy import worst
from bench.clock import cpu_ms
from bench.ours import Ours
from bench.peers.casadi import Casadi
from bench.peers.jaxonomy import Jaxonomy
from bench.peers.pathsim import PathSim
from bench.peers.python_control import PythonControl
from bench.pneumatic_loop import EXACT, EXACT_RISE_ELASTICITY, GAINS, Batched, Contender, Differentiated, neighbours
from bench.table import Job, Row

PEERS: Mapping[str, Callable[[], Contender]] = {
    "python-control": PythonControl,
    "casadi, CVODES": lambda: Casadi("CVODES"),
    "casadi, Runge-Kutta": lambda: Casadi("Runge-Kutta"),
    "pathsim, SSPRK22": lambda: PathSim("SSPRK22"),
    "pathsim, RKDP54": lambda: PathSim("RKDP54"),
    "jaxonomy": Jaxonomy,
}
CHECKED = 20


def jobs(*, runs: int, sets: int) -> Iterator[Job]:
    """Measure the three jobs; peers that are not installed get a row that says so."""
    contenders: list[Contender] = [Ours()]
    missing = []
    for name, make in PEERS.items():
        try:
            contenders.append(make())
        except ModuleNotFoundError:
            missing.append(Row(who=name, remark="not installed"))
    yield Job(title="pneumatic loop, one set of gains", rows=[*(_one(each, runs) for each in contenders), *missing])
    yield Job(
        title="pneumatic loop, elasticities in 3 gains",
        rows=[_elasticities(each, runs) for each in contenders if isinstance(each, Differentiated)],
    )
    yield Job(
        title=f"pneumatic loop, {sets:,} sets of gains",
        rows=[_many(each, contenders[0], runs, sets) for each in contenders],
    )


def _one(contender: Contender, runs: int) -> Row:
    return Row(
        who=contender.name,
        milliseconds=cpu_ms(lambda: contender.metrics(GAINS), runs=runs),
        error=worst(contender.metrics(GAINS), EXACT),
        remark=contender.remark,
    )


def _elasticities(contender: Differentiated, runs: int) -> Row:
    found = contender.rise_elasticities()
    error = max(abs(value / exact - 1) for value, exact in zip(found, EXACT_RISE_ELASTICITY, strict=True))
    milliseconds = cpu_ms(contender.rise_elasticities, runs=max(1, runs // 3))
    return Row(who=contender.name, milliseconds=milliseconds, error=error, remark=contender.derivation)


def _many(contender: Contender, exact: Contender, runs: int, sets: int) -> Row:
    if not isinstance(contender, Batched):
        milliseconds = sets * cpu_ms(lambda: contender.metrics(GAINS), runs=max(1, runs // 3))
        return Row(who=contender.name, milliseconds=milliseconds, remark="one by one: sets times the median of one")
    gains = neighbours(sets)
    milliseconds = cpu_ms(lambda: contender.many(gains), runs=max(1, runs // 5))
    found = contender.many(gains)
    error = 0.0
    for index in range(0, sets, max(1, sets // CHECKED)):
        each = exact.metrics({name: float(column[index]) for name, column in gains.items()})
        error = max(error, worst({name: float(column[index]) for name, column in found.items()}, each))
    return Row(who=contender.name, milliseconds=milliseconds, error=error, remark="against our exact path")
