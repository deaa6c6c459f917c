"""What is made of recordings: new recordings step by step, and frequency response functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

from servotune.documents import Document, SystemLike, given
from servotune.jobs import Jobs
from servotune.replies import Dataset, Frf
from servotune.transport import Transport


class Measured:
    """The part of `Client` that looks at recordings."""

    _transport: Transport

    def process(
        self,
        sources: str | Sequence[str],
        steps: Sequence[Document] = (),
        *,
        name: str = "processed",
        combine: str | None = None,
    ) -> Dataset:
        """Return a new recording made from others, which stay as they are; a long one is waited for.

        Parameters
        ----------
        sources : str or sequence of str
            Recordings.
        steps : sequence of mappings
            `{"kind": "cut", "start": 0.5}`, `{"kind": "filter", "band": "low_pass", "frequency": {"value": 50, "unit": "Hz"}}`;
            also calibrate, decimate, detrend, differentiate, fill, integrate, resample and select.
        name : str
        combine : {"append", "side_by_side"}, optional
            How several sources become one: experiments after one another (the default), or channels beside one another.

        Raises
        ------
        JobFailedError
            A step of a long processing cannot be done.
        """
        listed = [sources] if isinstance(sources, str) else list(sources)
        body = {"name": name, "sources": listed, "steps": list(steps)} | given(combine=combine)
        made = cast("dict[str, Any]", self._transport.post("/v1/processings", body, creates=True))
        if made.get("job"):
            Jobs(self._transport).get(made["job"]["id"]).wait(progress=False)
            return Dataset(self._transport.get(f"/v1/datasets/{made['id']}"))
        return cast("Dataset", made)

    def frf(
        self,
        dataset: str,
        *,
        input: str,  # noqa: A002 -- the name of the field in the API
        output: str | Sequence[str],
        estimator: str | None = None,
        window: str | None = None,
        segment: float | None = None,
        overlap: float | None = None,
        removal: str | None = None,
        period: float | None = None,
        settle: float | None = None,
        steps: Sequence[Document] | None = None,
        part: Sequence[float] | None = None,
        band: Sequence[Any] | None = None,
        form: str | None = None,
        corrections: Mapping[str, Document] | None = None,
        confidence: float | None = None,
        system: SystemLike | None = None,
        from_: str | None = None,
        to: str | None = None,
        parameters: Document | None = None,
        between_samples: str | None = None,
        modes: Document | None = None,
        keep: bool | None = None,
    ) -> Frf:
        """Return measured frequency response functions with coherence, confidence bands and what is doubtful about them.

        Parameters
        ----------
        dataset : str
        input, output : str
            Channels; several outputs share their lines.
        estimator : {"H1", "H2", "Hv", "multisine", "stepped_sine", "measured"}, optional
            Averaged segments (noise on the output, the input, both), a periodic input on its own lines, one sine
            after the other, or the responses that a file holds between the points ``input`` and ``output``.
        window, segment, overlap, removal : optional
            Of averaged segments: shape, length (s), how much of one its neighbour shares, what is taken away first.
        period, settle, steps : optional
            Of a multisine (s); s that are left out; `{"frequency": rad/s, "start": s, "end": s}` of each sine.
        part, band : (low, high), optional
            Stretch of the recording (s); lines that are wanted (rad/s).
        form : {"receptance", "mobility", "accelerance"}, optional
        corrections : mapping, optional
            Channel -> what its sensor does: `{"delay": 1e-4}`, `{"coupling": 3}`, or a calibration.
        confidence : float, optional
            Probability of the bands, 0.95 by default.
        system, from_, to, parameters : optional
            A model that is held against the measurement.
        between_samples : {"auto", "hold", "linear", "band_limited"}, optional
            With `system`: what the input does between its samples; the model answers from sample to sample then.
        modes : mapping, optional
            `{}`: natural frequencies and damping ratios are wanted; `{"count": 3, "band": [..]}`.
        keep : bool, optional
            Remember it: `client.results` finds what is kept, under the `id` of the reply, and `universal_file` writes it.
        """
        body = given(
            dataset=dataset, input=input, output=output if isinstance(output, str) else list(output),
            estimator=estimator, window=window, segment=segment, overlap=overlap, removal=removal, period=period,
            settle=settle, steps=steps, part=part, band=band, form=form, corrections=corrections,
            confidence=confidence, system=system, to=to, parameters=parameters, between_samples=between_samples,
            modes=modes, keep=keep,
        ) | given(**{"from": from_})  # fmt: skip
        return Frf(self._transport.post("/v1/frfs", body))

    def universal_file(self, result: str) -> bytes:
        """Return kept frequency response functions as datasets 58 of a universal file, text."""
        return self._transport.send("GET", f"/v1/frfs/{result}/uff").content
