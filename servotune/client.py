"""A typed client of the service: one method for each thing the API does, plain dictionaries in and out."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, cast

from servotune.access import Keys, Workspaces
from servotune.datasets import Datasets
from servotune.errors import ApiError, ServiceUnreachableError
from servotune.jobs import Job, Jobs
from servotune.schedules import Schedules
from servotune.transport import Transport

if TYPE_CHECKING:
    from servotune.replies import (
        CatalogItem,
        FrequencyResponse,
        Identification,
        Influence,
        Optimization,
        Simulation,
        Spectrum,
        StateSpace,
        Stored,
        Validation,
    )

Document = Mapping[str, Any]
"""A JSON object as the API documents it; quantities are SI numbers or `{"value": 65, "unit": "cm**2"}`."""

SystemLike = str | Mapping[str, Any]
"""The id of a stored system, or a system document itself."""


class Client:
    """A connection to a Servotune service; made by `servotune.connect`.

    Attributes
    ----------
    systems : Systems
        Stored system documents and their revisions.
    datasets : Datasets
        Recordings.
    jobs : Jobs
        Long work.
    schedules : Schedules
        Jobs that are run again and again.
    catalog : Catalog
        The elements, metrics, methods and signals that the service knows.
    keys, workspaces : Keys, Workspaces
        Who may come in, and where to.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self.systems = Systems(transport)
        self.datasets = Datasets(transport)
        self.jobs = Jobs(transport)
        self.schedules = Schedules(transport)
        self.catalog = Catalog(transport)
        self.keys = Keys(transport)
        self.workspaces = Workspaces(transport)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._transport.close()

    def ready(self) -> dict[str, Any]:
        """Return the readiness report of the service.

        Raises
        ------
        ServerError
            It is up but not ready; `problem` holds its report.
        ServiceUnreachableError
            It does not answer.
        """
        return cast("dict[str, Any]", self._transport.body(self._transport.send("GET", "/readyz", attempts=1)))

    def simulate(
        self,
        system: SystemLike,
        *,
        input: Document | Sequence[Document],  # noqa: A002 -- the name of the field in the API
        outputs: Sequence[str] | None = None,
        duration: float | None = None,
        samples: int | None = None,
        metrics: Sequence[str] | None = None,
        band: Sequence[float] | None = None,
        variants: Sequence[Document] | None = None,
    ) -> Simulation:
        """Return the response to a command: curves and metrics, one set for each variant of the parameters.

        Parameters
        ----------
        system : str or mapping
            Id or document.
        input : mapping or sequence of mappings
            `{"port": "reference", "signal": {"kind": "step", "amplitude": 1}}`.
        outputs, metrics : sequence of str, optional
            Names; all outputs, and all metrics that apply, by default.
        duration : float, optional
            Length of the curves (s); chosen by the service by default.
        samples : int, optional
            Points of each curve. Metrics do not depend on it.
        band : (low, high), optional
            What `band_energy` looks at, rad/s.
        variants : sequence of mappings, optional
            Parameter values to compare, `[{"kp": 50}, {"kp": 200}]`.
        """
        body = _given(
            system=system,
            input=input,
            outputs=outputs,
            duration=duration,
            samples=samples,
            metrics=metrics,
            band=band,
            variants=variants,
        )
        return cast("Simulation", self._transport.post("/v1/simulations", body))

    def frequency_response(
        self,
        system: SystemLike,
        *,
        from_: str | None = None,
        to: str | None = None,
        open_at: str | None = None,
        frequencies: Sequence[float] | None = None,
        metrics: Sequence[str] | None = None,
        operating_point: Document | None = None,
        variants: Sequence[Document] | None = None,
    ) -> FrequencyResponse:
        """Return the frequency response from an input to an output, or, with `open_at`, of the loop cut at that block.

        Frequencies are in rad/s, phases in rad; margins and sensitivity peaks come with `open_at`. A nonlinear system is
        linearised where it rests under the constant inputs of `operating_point`, `{"reference": 0.1}`; 0 by default.
        """
        body = _given(
            system=system,
            to=to,
            open_at=open_at,
            frequencies=frequencies,
            metrics=metrics,
            operating_point=operating_point,
            variants=variants,
        ) | _given(**{"from": from_})
        return cast("FrequencyResponse", self._transport.post("/v1/frequency-responses", body))

    def influence(
        self,
        system: SystemLike,
        *,
        input: str,  # noqa: A002 -- the name of the field in the API
        output: str,
        parameters: Sequence[str],
        metrics: Sequence[str],
        change: float | None = None,
        open_at: str | None = None,
        from_: str | None = None,
        to: str | None = None,
        signal: Document | None = None,
        predict: Sequence[Document] | None = None,
    ) -> Influence:
        """Return how strongly each parameter moves each metric: exact elasticities, and eq. (4) at a finite change.

        `parameters` are paths of the system's, and `signals.<input>.<parameter>` of the command's. Where a nonlinear
        response cannot be differentiated, an elasticity comes from differences (`method`) with its estimated `error`.
        For each set of changes in `predict`, parameter -> new value or `{"change": 0.1}`, the reply tells what the
        elasticities predict for every metric, what it really becomes, and the error.
        """
        body = _given(
            system=system,
            input=input,
            output=output,
            parameters=parameters,
            metrics=metrics,
            change=change,
            open_at=open_at,
            to=to,
            signal=signal,
            predict=predict,
        ) | _given(**{"from": from_})
        return cast("Influence", self._transport.post("/v1/influence", body))

    def spectrum(
        self,
        system: SystemLike | None = None,
        *,
        input: Document | Sequence[Document] | None = None,  # noqa: A002 -- the name of the field in the API
        output: str | None = None,
        dataset: str | None = None,
        channel: str | None = None,
        quantity: str | None = None,
        frequencies: Sequence[float] | None = None,
        window: str | None = None,
        segment: float | None = None,
        overlap: float | None = None,
        removal: str | None = None,
        part: Sequence[float] | None = None,
        duration: float | None = None,
        samples: int | None = None,
        fundamental: float | None = None,
        orders: int | None = None,
        band: Sequence[float] | None = None,
        variants: Sequence[Document] | None = None,
    ) -> Spectrum:
        """Return the spectrum of a system's output under a command, or of a dataset's channel.

        Parameters
        ----------
        system, input, output : optional
            What is simulated; or
        dataset, channel : str, optional
            what was recorded.
        quantity : {"amplitude", "density", "transform"}, optional
            Amplitudes of sines (the default) or mean square per Hz, both estimated from samples; or the exact Fourier
            integral of a simulated response that settles.
        frequencies : sequence of float, optional
            Of the transform (rad/s); chosen by the service by default.
        window : {"flat_top", "hann", "none"}, optional
        segment, overlap : float, optional
            Length of the segments that are averaged (s), and how much of one its neighbour shares.
        removal : {"nothing", "mean", "trend"}, optional
            What is taken away from each segment first.
        part : (start, end), optional
            Stretch of the recording or response that is looked at (s).
        duration, samples : optional
            Of the simulated response that is sampled.
        fundamental, orders : optional
            Its harmonics (rad/s) up to this order are wanted, too.
        band : (low, high), optional
            Its energy or mean square is wanted, too (rad/s).
        variants : sequence of mappings, optional
            Parameter values to compare, those of commands among them: `[{"signals.reference.delay": 0.1}, ...]`.
        """
        body = _given(
            system=system,
            input=input,
            output=output,
            dataset=dataset,
            channel=channel,
            quantity=quantity,
            frequencies=frequencies,
            window=window,
            segment=segment,
            overlap=overlap,
            removal=removal,
            part=part,
            duration=duration,
            samples=samples,
            fundamental=fundamental,
            orders=orders,
            band=band,
            variants=variants,
        )
        return cast("Spectrum", self._transport.post("/v1/spectra", body))

    def validate(
        self,
        system: SystemLike,
        *,
        dataset: str,
        inputs: Mapping[str, str],
        outputs: Mapping[str, str],
        parameters: Mapping[str, Any] | None = None,
        offsets: Mapping[str, float] | str | None = None,
        window: Sequence[float] | None = None,
        limit_percent: float | None = None,
    ) -> Validation:
        """Return measured against simulated: fit, errors, the worst interval and the verdict against a limit (%)."""
        body = _given(
            system=system,
            dataset=dataset,
            inputs=inputs,
            outputs=outputs,
            parameters=parameters,
            offsets=offsets,
            window=window,
            limit_percent=limit_percent,
        )
        return cast("Validation", self._transport.post("/v1/validations", body))

    def identify(
        self,
        system: SystemLike,
        *,
        dataset: str,
        inputs: Mapping[str, str],
        outputs: Mapping[str, str],
        parameters: Sequence[str | Document],
        offsets: str | None = None,
        estimation: Sequence[float] | None = None,
        validation: Sequence[float] | None = None,
        split: float | None = None,
    ) -> Job[Identification]:
        """Start the estimation of parameters from a recording.

        Parameters
        ----------
        inputs, outputs : mapping
            Which channel of the dataset drives which port, and which one measures which output.
        parameters : sequence
            Names, or `{"parameter": "lag.time_constant", "lower": 0, "upper": 0.1, "start": 0.01}`.
        offsets : str, optional
            `"estimate"` adds an unknown constant to each output (a sensor's zero).
        estimation, validation : (start, end), optional
            Parts of the recording (s).
        split : float, optional
            The first part of the recording that estimates, when no parts are given.
        """
        body = _given(
            system=system,
            dataset=dataset,
            inputs=inputs,
            outputs=outputs,
            parameters=parameters,
            offsets=offsets,
            estimation=estimation,
            validation=validation,
            split=split,
        )
        return self._start("/v1/identifications", body)

    def optimize(
        self,
        system: SystemLike,
        *,
        variables: Sequence[Document],
        goals: Sequence[Document],
        method: Document,
        experiments: Sequence[Document] | None = None,
        scenarios: Sequence[Document] | None = None,
        across_scenarios: str | None = None,
        uncertain: Sequence[Document] | None = None,
        yield_samples: int | None = None,
        cross_check: Sequence[str] | None = None,
        alternatives: Sequence[Document] | None = None,
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
            A metric with a `sense`, with `lower`, `upper` or `target`, `"hard": False` for what need not hold; whole
            curves with `bounds` (`envelope`, `path_bound` ...) or a `reference` (`tracking_error`).
        method : mapping
            `{"kind": "gradient", "seed": 1}`.
        experiments : sequence of mappings, optional
            Commands under which time metrics are taken.
        scenarios : sequence of mappings, optional
            Parameter values that the same variables must serve.
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
        """
        body = _given(
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
        )
        return self._start("/v1/optimizations", body)

    def _start(self, path: str, body: Document) -> Job[Any]:
        return Job(self._transport, self._transport.post(path, body, creates=True))


class Systems:
    """System documents that the service keeps; every change is a new revision."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def create(self, document: Document) -> Stored:
        """Store a document and return it with its id."""
        return cast("Stored", self._transport.post("/v1/systems", document, creates=True))

    def get(self, system: str) -> Stored:
        """Return the present revision."""
        return cast("Stored", self._transport.get(f"/v1/systems/{system}"))

    def list(self) -> Iterator[Stored]:
        """Yield the stored systems."""
        return self._transport.items("/v1/systems")

    def revision(self, system: str, number: int) -> Stored:
        """Return one revision, counted from 1."""
        return cast("Stored", self._transport.get(f"/v1/systems/{system}/revisions/{number}"))

    def revisions(self, system: str) -> Iterator[Stored]:
        """Yield the revisions of one system."""
        return self._transport.items(f"/v1/systems/{system}/revisions")

    def update(self, system: str, document: Document, *, etag: str | None = None) -> Stored:
        """Store a new revision.

        Parameters
        ----------
        etag : str, optional
            The version that the change starts from; by default the one stored now, whoever wrote it.

        Raises
        ------
        PreconditionFailedError
            Somebody else stored another revision since.
        """
        headers = {"If-Match": etag or self.etag(system)}
        response = self._transport.send("PUT", f"/v1/systems/{system}", json=document, headers=headers)
        return cast("Stored", self._transport.body(response))

    def delete(self, system: str, *, etag: str | None = None) -> None:
        """Delete a system; results keep the revision that they used."""
        self._transport.send("DELETE", f"/v1/systems/{system}", headers={"If-Match": etag or self.etag(system)})

    def state_space(self, system: str, *, open_at: str | None = None) -> StateSpace:
        """Return the realised matrices in SI, with the names of states, inputs and outputs.

        Parameters
        ----------
        system : str
            Id of a stored system.
        open_at : str, optional
            Block where the loop is cut; `loop` is then the last input and the last output.
        """
        path = f"/v1/systems/{system}/state-space"
        return cast("StateSpace", self._transport.get(path, params=_given(open_at=open_at)))

    def matlab(self, system: str, *, open_at: str | None = None) -> bytes:
        """Return the same as the content of a .mat file."""
        query = {"format": "mat"} | _given(open_at=open_at)
        return self._transport.send("GET", f"/v1/systems/{system}/state-space", params=query).content

    def etag(self, system: str) -> str:
        """Return the tag of the version stored now, for `update` and `delete`."""
        return self._transport.send("GET", f"/v1/systems/{system}").headers["ETag"]


class Catalog:
    """What the service knows: element kinds, metrics, optimisation methods, signals."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def elements(self) -> list[CatalogItem]:
        """Return every element kind: ports, parameters, equation, source."""
        return list(self._transport.items("/v1/catalog/elements"))

    def metrics(self) -> list[CatalogItem]:
        """Return every metric: definition, unit, source."""
        return list(self._transport.items("/v1/catalog/metrics"))

    def methods(self) -> list[CatalogItem]:
        """Return every optimisation method and its options."""
        return list(self._transport.items("/v1/catalog/methods"))

    def signals(self) -> list[CatalogItem]:
        """Return every command signal and its parameters."""
        return list(self._transport.items("/v1/catalog/signals"))


def connect(
    url: str = "http://127.0.0.1:8000",
    *,
    key: str | None = None,
    wait: float = 0.0,
    timeout: float = 120.0,
    attempts: int = 4,
) -> Client:
    """Return a client of the service at an address.

    Parameters
    ----------
    url : str
        Address of the service.
    key : str, optional
        API key; `servotune serve` prints the first one when it starts for the first time.
    wait : float
        How long to wait for a service that is still starting (s); 0 does not ask.
    timeout : float
        Longest silence of the service that is taken for work (s).
    attempts : int
        How often a request is sent before its failure is reported.

    Raises
    ------
    ServiceUnreachableError
        Not ready after `wait` seconds.
    """
    client = Client(Transport(url, key=key, timeout=timeout, attempts=attempts))
    if wait > 0.0:
        _wait_until_ready(client, wait)
    return client


def _wait_until_ready(client: Client, wait: float) -> None:
    deadline = time.monotonic() + wait
    while True:
        try:
            client.ready()
        except (ServiceUnreachableError, ApiError) as error:
            if time.monotonic() >= deadline:
                client.close()
                message = f"the service is not ready after {wait:g} s: {error}"
                raise ServiceUnreachableError(message) from error
            time.sleep(0.1)
        else:
            return


def _given(**fields: Any) -> dict[str, Any]:
    """Return the fields that the caller gave: the service has its own defaults."""
    return {name: value for name, value in fields.items() if value is not None}
