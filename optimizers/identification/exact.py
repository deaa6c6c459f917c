"""Answers of nonlinear diagrams on the exact path, event by event, with exact slopes: for laws that are no formula of the instant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.recorded import simulate_recorded
from engine.exact.sampled_data import recorded as sampled_data
from engine.model.tangent import INFINITESIMAL
from optimizers.identification.answers import Answer, Samples

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.exact.laws.system import NonlinearSystem
    from optimizers.recorded.recording import RecordedExperiment

Array = npt.NDArray[Any]


class ExactModel:
    """A nonlinear diagram driven by one recording; ``initial`` tells whether its initial states are coordinates.

    ``clock`` is asked for the time (s) at every few steps, and may end the response by an error of its own.
    """

    def __init__(
        self, diagram: Diagram, experiment: RecordedExperiment, *, initial: bool, clock: Callable[[], float] = monotonic
    ) -> None:
        recording = experiment.recording
        self._diagram, self._known = diagram, dict(experiment.values)
        self._clock = clock
        self._outputs = tuple(recording.outputs)
        self._sampled_alone = diagram.sampled_alone
        self._h = recording.sample_time
        self._between = recording.between_samples
        self._inputs = np.zeros((len(diagram.inputs), recording.samples))
        for name, signal in recording.inputs.items():
            self._inputs[diagram.inputs.index(name)] = signal
        self.states = diagram.laws(self._known).states if initial else 0

    def shown(self, values: Mapping[str, float], deviation: Samples) -> Answer:
        """Return the response without slopes."""
        laws = self._diagram.laws({**self._known, **values})
        found, _ = self._simulated(laws, deviation if self.states else None)
        return Answer(values=found, slopes=np.zeros((len(values) + self.states, *found.shape)))

    def answer(self, values: Mapping[str, float], deviation: Samples) -> Answer:
        """Return the response with its slopes."""
        given = {**self._known, **values}
        laws = self._diagram.laws(given, dict.fromkeys(values, INFINITESIMAL))
        if not self.states:
            found, slopes = self._simulated(laws, None)
            return Answer(values=found, slopes=slopes)
        found, slopes = self._simulated(laws, np.broadcast_to(deviation, (laws.lanes, laws.states)))
        still = self._diagram.laws(given, {next(iter(values)): 0.0})  # one lane, complex
        moved = deviation + 1j * INFINITESIMAL * np.eye(self.states)
        by_state = [self._simulated(still, row[None])[1][0] for row in moved]
        return Answer(values=found, slopes=np.concatenate([slopes, np.array(by_state)]))

    def _simulated(self, laws: NonlinearSystem, deviation: Array | None) -> tuple[Samples, Samples]:
        asked: dict[str, Any] = {"outputs": self._outputs, "deviation": deviation, "between": self._between}
        found = None
        if self._sampled_alone:
            found = sampled_data.simulate_recorded(laws, self._inputs, self._h, **asked)
        return found or simulate_recorded(laws, self._inputs, self._h, clock=self._clock, **asked)
