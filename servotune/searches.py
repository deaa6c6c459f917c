"""What takes the service longer: choosing parameters, and what is asked for later."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from servotune.documents import Document, SystemLike, given
from servotune.identifications import Identifications
from servotune.jobs import Job
from servotune.replies import Optimization, Validation


class Searches(Identifications):
    """The part of `Client` whose methods return a job."""

    def optimize(
        self,
        system: SystemLike,
        *,
        variables: Sequence[Document],
        goals: Sequence[Document],
        method: Document | None = None,
        experiments: Sequence[Document] | None = None,
        scenarios: Sequence[Document] | None = None,
        across_scenarios: str | None = None,
        uncertain: Sequence[Document] | None = None,
        yield_samples: int | None = None,
        cross_check: Sequence[str] | None = None,
        alternatives: Sequence[Document] | None = None,
        queue: Document | None = None,
    ) -> Job[Optimization]:
        """Start a search for the variables that serve the goals best in the worst of the scenarios.

        Parameters
        ----------
        system : str or mapping
            Id or document.
        variables : sequence of mappings
            `{"parameter": "kp", "lower": 1, "upper": 10}`, with `choices` or `integer` for discrete ones, with
            `"expression": "=kp/20"` for those that are tied to others.
        goals : sequence of mappings
            A metric with a `sense`, with `lower`, `upper` or `target`, `"hard": False` for what need not hold; without any sense
            a point that serves all of them with most room is looked for; whole
            curves with `bounds` (`envelope`, `path_bound` ...) or a `reference` (`tracking_error`).
        method : mapping, optional
            `{"kind": "gradient", "seed": 1}`; `{"kind": "auto"}` by default. `"max_seconds": 60` limits its time.
        experiments : sequence of mappings, optional
            Commands under which time metrics are taken.
        scenarios : sequence of mappings, optional
            Parameter values that the same variables must serve, each plain or `{"name": "heavy", "parameters": {...}}`.
        across_scenarios : {"worst", "mean"}, optional
            Which objective of the scenarios counts.
        uncertain : sequence of mappings, optional
            `{"parameter": "mass", "lower": 0.8, "upper": 1.2}`: the variables must serve the worst of the ranges.
        yield_samples : int, optional
            Draws of the uncertain parameters, for the share that meets the goals.
        cross_check : sequence of str, optional
            Other methods that solve it, too.
        alternatives : sequence of mappings, optional
            Structures to be compared, each a `system` or what it has to `add` and `remove`.
        queue : mapping, optional
            `{"priority": "low", "time_limit": 600}`: its turn among the workspace's jobs, and how long (s) it may take.
        """
        body = given(
            system=system,
            variables=variables,
            experiments=experiments,
            goals=goals,
            scenarios=scenarios,
            across_scenarios=across_scenarios,
            uncertain=uncertain,
            yield_samples=yield_samples,
            cross_check=cross_check,
            alternatives=alternatives,
            method=method,
            queue=queue,
        )
        return self._start("/v1/optimizations", body)

    def validate_later(self, system: SystemLike, **fields: Any) -> Job[Validation]:
        """Start a validation of a long recording or a slow model; `fields` are those of `validate`."""
        body = given(system=system, **fields)
        headers = {"Prefer": "respond-async"}
        return Job(self._transport, self._transport.post("/v1/validations", body, creates=True, headers=headers))
