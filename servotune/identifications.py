"""What recordings tell: parameters of a system, models without one, the friction of a drive, a characteristic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from servotune.documents import Document, SystemLike, given
from servotune.jobs import Job
from servotune.replies import BlackBox, DriveParameters, Expected, Identification, StaticCurve
from servotune.transport import Transport

_PATH = "/v1/identifications"


class Identifications:
    """The part of `Client` that identifies."""

    _transport: Transport

    def identify(
        self,
        system: SystemLike,
        *,
        parameters: Sequence[str | Document],
        dataset: str | None = None,
        inputs: Mapping[str, str | Document] | None = None,
        outputs: Mapping[str, str] | None = None,
        experiments: Sequence[Document] | None = None,
        frequency_responses: Sequence[Document] | None = None,
        offsets: str | None = None,
        initial_states: str | None = None,
        estimation: Sequence[float] | None = None,
        validation: Sequence[float] | None = None,
        split: float | None = None,
        starts: int | None = None,
        max_evaluations: int | None = None,
        queue: Document | None = None,
    ) -> Job[Identification]:
        """Start the estimation of parameters from recordings, measured frequency responses, or both.

        Parameters
        ----------
        parameters : sequence
            Names, or `{"parameter": "lag.time_constant", "lower": 0, "upper": 0.1, "start": 0.01}`.
        dataset, inputs, outputs : str, mapping, mapping
            A recording: which of its channels drives which port, and which one measures which output. An input may say what it
            does between its samples: `{"channel": "u", "between_samples": "hold"}` (a D/A converter), `"linear"`,
            `"band_limited"` (behind an anti-aliasing filter); otherwise all three are tried (`"auto"`) and the best is taken.
        experiments : sequence, optional
            Several recordings in place of it: `{"dataset": ..., "inputs": ..., "outputs": ..., "parameters": {"load": 5}}`, the
            parameters being what is known of this one alone, and `split`, `estimation`, `validation` its parts where they are not
            those of all.
        frequency_responses : sequence, optional
            Measured frequency responses beside recordings, or in place of them:
            `{"dataset": ..., "inputs": {"u": ...}, "outputs": ..., "segment": 2.0, "band": ["1 Hz", "50 Hz"]}`, or `{"frf": ...}` with
            the identifier of a kept response in place of the dataset.
        offsets : str, optional
            `"estimate"` adds an unknown constant to each output (a sensor's zero).
        initial_states : str, optional
            `"estimate"` where a recording does not begin at rest.
        estimation, validation : (start, end), optional
            Parts of the recording (s).
        split : float, optional
            The first part of the recording that estimates, when no parts are given.
        starts, max_evaluations : int, optional
            How many starts are tried, and how many simulations for each.
        queue : mapping, optional
            As for `optimize`.
        """
        body = given(
            system=system,
            dataset=dataset,
            inputs=inputs,
            outputs=outputs,
            experiments=experiments,
            frequency_responses=frequency_responses,
            parameters=parameters,
            offsets=offsets,
            initial_states=initial_states,
            estimation=estimation,
            validation=validation,
            split=split,
            starts=starts,
            max_evaluations=max_evaluations,
            queue=queue,
        )
        return self._start(_PATH, body)

    def expected_cost(self, system: SystemLike, *, parameters: Sequence[str | Document], **settings: Any) -> Expected:
        """Return what an identification would take and warn of; nothing is started.

        Parameters
        ----------
        settings
            Those of `identify`.
        """
        body = given(system=system, parameters=parameters, **settings)
        found: Expected = self._transport.post(_PATH, body, params={"dry_run": "true"})
        return found

    def black_box(
        self,
        dataset: str,
        *,
        inputs: Mapping[str, str],
        outputs: Mapping[str, str],
        method: Literal["subspace", "transfer_function"] = "transfer_function",
        orders: Sequence[int] | None = None,
        largest_delay: float | None = None,
        offsets: str | None = None,
        between_samples: Literal["hold", "linear"] | None = None,
        split: float | None = None,
        queue: Document | None = None,
    ) -> Job[BlackBox]:
        """Start the search for a model without a diagram; names of inputs and outputs are free.

        Parameters
        ----------
        orders : sequence of int, optional
            Among which the validation chooses.
        largest_delay : float, optional
            s; a transfer function is tried with every delay up to it.
        between_samples : {"hold", "linear"}, optional
            What the inputs do between their samples, linear by default: it decides which continuous model the samples are of.
        """
        body = given(
            method=method,
            dataset=dataset,
            inputs=inputs,
            outputs=outputs,
            orders=orders,
            largest_delay=largest_delay,
            offsets=offsets,
            between_samples=between_samples,
            split=split,
            queue=queue,
        )
        return self._start(_PATH, body)

    def drive_parameters(self, dataset: str, *, force: str, **settings: Any) -> Job[DriveParameters]:
        """Start the regression for mass, friction and offset of a drive.

        Parameters
        ----------
        force : str
            Channel of the force or torque.
        settings
            `position` or `velocity` (channels), `force_factor`, `low_pass`, `decimation`, `asymmetric` and the others of the
            reference.
        """
        return self._start(_PATH, {"method": "inverse_dynamics", "dataset": dataset, "force": force, **settings})

    def static_curve(self, dataset: str, *, of: str, over: str, degree: int | None = None) -> Job[StaticCurve]:
        """Start the search for a polynomial: channel ``of`` over channel ``over``."""
        return self._start(_PATH, given(method="static_curve", dataset=dataset, input=over, output=of, degree=degree))

    def _start(self, path: str, body: Document) -> Job[Any]:
        return Job(self._transport, self._transport.post(path, body, creates=True))
