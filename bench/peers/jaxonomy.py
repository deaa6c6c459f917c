"""jaxonomy at the pneumatic loop, where a user has installed it: it brings some eighty packages, so the lock leaves it out."""

from __future__ import annotations

import importlib
from importlib.metadata import version
from typing import Any

import numpy as np
import numpy.typing as npt

from bench.pneumatic_loop import DURATION, FILTER, GAINS, MOTOR_DENOMINATOR, MOTOR_NUMERATOR, SAMPLES, Gains, Sets
from bench.sampled import step_metrics

Real = npt.NDArray[np.float64]


class Jaxonomy:
    """The loop block by block; new gains are a batch of one."""

    remark = "curve and 4 step metrics; compiles at every call, no margins"

    def __init__(self) -> None:
        self._jaxonomy = importlib.import_module("jaxonomy")
        library = importlib.import_module("jaxonomy.library")
        self.name = f"jaxonomy {version('jaxonomy')}"
        builder = self._jaxonomy.DiagramBuilder()
        reference = builder.add(library.Constant(1.0, name="reference"))
        error = builder.add(library.Adder(2, operators="+-", name="error"))
        pid = builder.add(library.PID(*GAINS.values(), FILTER, name="pid"))
        motor = builder.add(library.TransferFunction(MOTOR_NUMERATOR, MOTOR_DENOMINATOR, name="motor"))
        builder.connect(reference.output_ports[0], error.input_ports[0])
        builder.connect(motor.output_ports[0], error.input_ports[1])
        builder.connect(error.output_ports[0], pid.input_ports[0])
        builder.connect(pid.output_ports[0], motor.input_ports[0])
        self._diagram = builder.build()
        self._position = motor.output_ports[0]
        self._time = np.linspace(0.0, DURATION, SAMPLES)

    def metrics(self, gains: Gains) -> dict[str, float]:
        """Simulate one set of gains and read the metrics off its samples."""
        return {
            name: float(value[0]) for name, value in self.many({k: np.array([v]) for k, v in gains.items()}).items()
        }

    def many(self, sets: Sets) -> dict[str, Real]:
        """Simulate all sets in one call and read the metrics off the samples."""
        run = self._jaxonomy.simulate_batch(
            self._diagram,
            (0.0, DURATION),
            {f"pid.{gain}": column for gain, column in sets.items()},
            options=self._options(),
            recorded_signals={"position": self._position},
        )
        times, curves = np.asarray(run.time), np.asarray(run.outputs["position"])
        each = [
            step_metrics(times[index] if times.ndim > 1 else times, curve.ravel()) for index, curve in enumerate(curves)
        ]
        return {name: np.array([found[name] for found in each]) for name in each[0]}

    def _options(self) -> Any:
        step = DURATION / (SAMPLES - 1)
        return self._jaxonomy.SimulatorOptions(
            math_backend="jax", max_major_step_length=step, max_major_steps=2 * SAMPLES, rtol=1e-8, atol=1e-10
        )
