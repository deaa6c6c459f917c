"""A recording has a sample rate that instants can be made of, whichever way it comes in."""

from __future__ import annotations

import doctest
import re

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

import engine.recordings.sample_rates
from api.formats import FormatError, Recording, Series
from api.schemas.acquisitions import AcquisitionRequest, AttemptDatasetRequest
from api.schemas.datasets import DatasetRequest
from api.schemas.processing import ResampleStep
from api.services.recordings.importing import settle
from api.services.recordings.sampling import TimeAxis
from engine.recordings.sample_rates import LEAST_RATE

WRONG = [1e-320, 1e-300, 9e-7, 1.1e12, 1e300]
RIGHT = [LEAST_RATE, 51_200.0, 8e6]
REQUESTS = {
    "raw samples": (DatasetRequest, lambda rate: {"name": "x", "format": "raw", "sample_rate": rate}),
    "an import": (DatasetRequest, lambda rate: {"name": "x", "import": {"sample_rate": rate}}),
    "an import that resamples": (DatasetRequest, lambda rate: {"name": "x", "import": {"uneven": {"resample": {"rate": rate}}}}),
    "a processing": (ResampleStep, lambda rate: {"kind": "resample", "rate": rate}),
    "a measurement": (AcquisitionRequest, lambda rate: {"sample_rate": rate}),
    "an agent": (AttemptDatasetRequest, lambda rate: {"agent": "agt_1", "start_time": "2026-01-01T00:00:00Z", "sample_rate": rate, "channels": [{"name": "x"}]}),
}  # fmt: skip


@pytest.mark.parametrize("case", REQUESTS)
def test_requests_are_bounded_in_one_way(case):
    model, document = REQUESTS[case]
    for rate in RIGHT:
        TypeAdapter(model).validate_python(document(rate))
    for rate in WRONG:
        with pytest.raises(ValidationError) as caught:
            TypeAdapter(model).validate_python(document(rate))
        assert any(
            error["loc"][-1] in {"sample_rate", "rate"} and error["input"] == rate for error in caught.value.errors()
        )


def stating(rate):
    return Recording(series=[Series(name="x", index=0, count=9, sample_rate=rate)], read=lambda _: iter(()))


@pytest.mark.parametrize("rate", [*WRONG, np.inf])
def test_a_file_that_states_another_rate_is_refused_and_another_may_be_given(rate):
    said = f"sample_rate must be 1e-06 ... 1e+12 samples/s, got {rate:g}: say in import"
    with pytest.raises(FormatError, match=re.escape(said)):
        settle("hdf5", stating(rate), {})
    assert settle("hdf5", stating(rate), {"sample_rate": 100.0}).sample_rate == 100.0


def test_instants_that_tell_another_rate_are_refused():
    for step in (1e-300, 1e-13, 1e7):
        axis = TimeAxis()
        axis.add(np.arange(9) * step)
        with pytest.raises(FormatError, match="by the instants of the file: is the unit of time right"):
            _ = axis.rate


def test_the_example_in_the_documentation_runs():
    assert doctest.testmod(engine.recordings.sample_rates).failed == 0
