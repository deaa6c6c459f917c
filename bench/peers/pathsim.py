"""pathsim at the pneumatic loop: a block simulator, so curves only."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np

from bench.pneumatic_loop import DURATION, FILTER, GAINS, MOTOR_DENOMINATOR, MOTOR_NUMERATOR, SAMPLES, Gains
from bench.sampled import step_metrics


class PathSim:
    """The loop block by block, with one of its solvers at one step per sample."""

    remark = "curve and 4 step metrics; no margins, no derivatives, no batch"

    def __init__(self, solver: str) -> None:
        from pathsim import blocks, solvers  # noqa: PLC0415  a peer that is not installed is a row of the table

        self.name = f"pathsim {version('pathsim')}, {solver}"
        self._blocks = blocks
        self._solver = getattr(solvers, solver)

    def metrics(self, gains: Gains = GAINS) -> dict[str, float]:
        """Build the loop, simulate it and read the metrics off the samples."""
        from pathsim import Connection, Simulation  # noqa: PLC0415  as above

        blocks = self._blocks
        reference, error, scope = blocks.Constant(1.0), blocks.Adder("+-"), blocks.Scope()
        pid = blocks.PID(Kp=gains["kp"], Ki=gains["ki"], Kd=gains["kd"], f_max=FILTER)
        motor = blocks.TransferFunctionNumDen(Num=MOTOR_NUMERATOR, Den=MOTOR_DENOMINATOR)
        simulation = Simulation(
            [reference, error, pid, motor, scope],
            [
                Connection(reference, error[0]),
                Connection(motor, error[1], scope),
                Connection(error, pid),
                Connection(pid, motor),
            ],
            dt=DURATION / (SAMPLES - 1),
            Solver=self._solver,
            log=False,
        )
        simulation.run(DURATION)
        time, (curve,) = scope.read()
        return step_metrics(np.asarray(time), np.asarray(curve))
