"""What the service answers at once: responses, spectra, influence, validation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from servotune.documents import Document, SystemLike, given
from servotune.replies import FrequencyResponse, Influence, Simulation, Spectrum, Validation
from servotune.transport import Transport


class Studies:
    """The part of `Client` whose methods return what was computed."""

    _transport: Transport

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
        settling_band: Any = None,
        recovery_band: Any = None,
        derivative: int | None = None,
        variants: Sequence[Document] | None = None,
        keep: bool | None = None,
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
        settling_band : float or quantity, optional
            Half of the band of `settling_time`, a part of the way; 0.02 by default.
        recovery_band : float or quantity, optional
            Half of the band of `recovery_time`, in the unit of the output.
        derivative : int, optional
            How often outputs without a unit are differentiated for `max_velocity`, `max_acceleration` and `control_effort`.
        variants : sequence of mappings, optional
            Parameter values to compare, `[{"kp": 50}, {"kp": 200}]`.
        keep : bool, optional
            Remember it: `client.results` finds what is kept, under the `id` of the reply.
        """
        body = given(
            system=system,
            input=input,
            outputs=outputs,
            duration=duration,
            samples=samples,
            metrics=metrics,
            band=band,
            settling_band=settling_band,
            recovery_band=recovery_band,
            derivative=derivative,
            variants=variants,
            keep=keep,
        )
        return Simulation(self._transport.post("/v1/simulations", body))

    def frequency_response(
        self,
        system: SystemLike,
        *,
        from_: str | None = None,
        to: str | None = None,
        open_at: str | Sequence[str] | None = None,
        frequencies: Sequence[float] | None = None,
        metrics: Sequence[str] | None = None,
        operating_point: Document | None = None,
        noise_density: Any = None,
        paths: Sequence[Document] | None = None,
        variants: Sequence[Document] | None = None,
        keep: bool | None = None,
    ) -> FrequencyResponse:
        """Return the frequency response from an input to an output, or, with `open_at`, of the loop cut at that block.

        Of several places in `open_at`, opened together, the loop is cut at the first: the margins of an inner loop with the
        outer one open. Frequencies are in rad/s, phases in rad; margins and sensitivity peaks come with `open_at`. A nonlinear system is
        linearised where it rests under the constant inputs of `operating_point`, `{"reference": 0.1}`; 0 by default.
        `noise_density` is the one-sided power spectral density of the noise of `noise_rms`, (unit of the input)² per Hz.
        `paths` are further ones, `[{"from": "reference", "to": "control"}]`, each with its curve, metrics and zeros. With `keep` it
        is remembered: `client.results` finds it under the `id` of the reply.
        """
        body = given(
            system=system,
            to=to,
            open_at=open_at,
            frequencies=frequencies,
            metrics=metrics,
            operating_point=operating_point,
            noise_density=noise_density,
            paths=paths,
            variants=variants,
            keep=keep,
        ) | given(**{"from": from_})
        return FrequencyResponse(self._transport.post("/v1/frequency-responses", body))

    def influence(
        self,
        system: SystemLike,
        *,
        input: str,  # noqa: A002 -- the name of the field in the API
        output: str,
        parameters: Sequence[str],
        metrics: Sequence[str],
        change: float | None = None,
        open_at: str | Sequence[str] | None = None,
        from_: str | None = None,
        to: str | None = None,
        signal: Document | None = None,
        duration: float | None = None,
        settling_band: Any = None,
        recovery_band: Any = None,
        derivative: int | None = None,
        noise_density: Any = None,
        predict: Sequence[Document] | None = None,
        keep: bool | None = None,
    ) -> Influence:
        """Return how strongly each parameter moves each metric: exact elasticities, and eq. (4) at a finite change.

        `parameters` are paths of the system's, and `signals.<input>.<parameter>` of the command's. Where a nonlinear
        response cannot be differentiated, an elasticity comes from differences (`method`) with its estimated `error`.
        For each set of changes in `predict`, parameter -> new value or `{"change": 0.1}`, the reply tells what the
        elasticities predict for every metric, what it really becomes, and the error. Responses are followed until they settle,
        or to a `duration` (s), which bounds what takes long. The bands and the density are those of
        `settling_time`, `recovery_time` and `noise_rms`.
        """
        body = given(
            system=system,
            input=input,
            output=output,
            parameters=parameters,
            metrics=metrics,
            change=change,
            open_at=open_at,
            to=to,
            signal=signal,
            duration=duration,
            settling_band=settling_band,
            recovery_band=recovery_band,
            derivative=derivative,
            noise_density=noise_density,
            predict=predict,
            keep=keep,
        ) | given(**{"from": from_})
        return Influence(self._transport.post("/v1/influence", body))

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
        keep: bool | None = None,
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
        keep : bool, optional
            Remember it: `client.results` finds what is kept, under the `id` of the reply.
        """
        body = given(
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
            keep=keep,
        )
        return Spectrum(self._transport.post("/v1/spectra", body))

    def validate(
        self,
        system: SystemLike,
        *,
        dataset: str,
        inputs: Mapping[str, str | Document],
        outputs: Mapping[str, str],
        parameters: Mapping[str, Any] | None = None,
        offsets: Mapping[str, float] | str | None = None,
        window: Sequence[float] | None = None,
        limit_percent: float | None = None,
        identification: str | None = None,
        diagnose: str | None = None,
        movable: Sequence[str] | None = None,
        points: int | None = None,
    ) -> Validation:
        """Return measured against simulated: measures by name beside trivial models, the verdict, and what to try if it fails.

        Parameters
        ----------
        inputs, outputs : mapping
            Which channel drives which port, and which one measures which output. An input is a channel, or
            `{"channel": "u", "between_samples": "hold"}`, as for `identify`.
        parameters : mapping, optional
            Adjusted values; those of the document are the theory that they are compared with.
        identification : str, optional
            A finished identification (job) whose parameters and offsets are taken where none are given.
        offsets : mapping or {"none", "estimate"}, optional
            A constant for each output.
        window : (start, end), optional
            Part of the recording (s).
        limit_percent : float, optional
            Relative error up to which an output passes, 10 by default.
        diagnose : {"failed", "always", "never"}, optional
            When to look for what would make the error smaller.
        movable : sequence of str, optional
            Parameters that may move then.
        points : int, optional
            Most points of each curve; every sample by default.
        """
        body = given(
            system=system,
            dataset=dataset,
            inputs=inputs,
            outputs=outputs,
            parameters=parameters,
            offsets=offsets,
            window=window,
            limit_percent=limit_percent,
            identification=identification,
            diagnose=diagnose,
            movable=movable,
            points=points,
        )
        return Validation(self._transport.post("/v1/validations", body))
