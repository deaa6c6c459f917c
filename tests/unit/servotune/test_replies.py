"""Replies are dictionaries with attributes: whole for JSON, short in print, tables and plots where the libraries are."""

from __future__ import annotations

import copy
import json
import pickle
from typing import Any

import pytest

import servotune
from servotune import optional
from servotune.replies import ChannelData, FrequencyResponse, Influence, Metric, Optimization, Reply, Simulation
from servotune.replies.results import result_of
from servotune.replies.studies import SimulationVariant


def metric(value: float | None, unit: str = "", verdict: str = "ok") -> dict[str, Any]:
    return {"value": value, "unit": unit, "verdict": verdict}


def variant(gain: float) -> dict[str, Any]:
    return {
        "parameters": {"gain": gain}, "verdict": "ok", "time": [0.0, 0.5, 1.0], "outputs": {"position": [0.0, gain, gain]},
        "metrics": {"position": {"peak": metric(gain, "m"), "overshoot": metric(None, "", "too_short")}},
    }  # fmt: skip


ONE = {"variants": [variant(2.0)], "warnings": []}
TWO = {"variants": [variant(2.0), variant(3.0)], "warnings": []}


def test_a_reply_is_the_dictionary_that_came_and_its_parts_are_replies() -> None:
    reply = Simulation(ONE)
    assert reply == ONE
    assert json.loads(json.dumps(reply)) == ONE
    assert isinstance(reply.variants[0], SimulationVariant)
    assert reply["variants"][0]["metrics"]["position"]["peak"].unit == "m"
    assert reply.metrics["position"].peak.value == 2.0
    assert copy.deepcopy(reply) == pickle.loads(pickle.dumps(reply)) == ONE


def test_what_a_reply_may_leave_out_is_none_and_what_it_does_not_have_is_named() -> None:
    reply = Simulation(ONE)
    assert reply.variants[0].limit_cycle is None
    with pytest.raises(AttributeError, match="SimulationVariant has no 'overshoot'; it has parameters, verdict"):
        _ = reply.variants[0].overshoot


def test_keys_that_are_words_of_python_have_an_underscore_behind_them() -> None:
    assert Reply({"from": "reference", "values": [1.0]}).from_ == "reference"
    assert ChannelData({"unit": "m", "time": [0.0], "values": [1.0]}).values_ == [1.0]
    draws = {"share": 0.9, "lower95": 0.8, "upper95": 1.0, "samples": 10, "unstable": 0, "failures": []}
    assert Optimization({"yield": draws}).yield_.share == 0.9


def test_print_is_short() -> None:
    long = {
        "variants": [{**variant(2.0), "time": [0.1 * k for k in range(4000)], "outputs": {"position": [0.0] * 4000}}]
    }
    text = repr(Simulation(long))
    assert text == "<Simulation ok, position: 4000 samples to 399.9 s, 2 metrics>"
    assert "variant" in repr(Simulation({"variants": [variant(float(k)) for k in range(9)]}))
    assert len(repr(Optimization({"status": "converged", "goals": [], "best": {"kp": 1.0}}))) < 100


def test_a_metric_is_a_number_where_it_has_one() -> None:
    known, unknown = Metric(metric(0.0425, "m")), Metric(metric(None, "", "too_short"))
    assert float(known) == 0.0425
    assert f"{known:.1%}" == "4.2%"
    assert f"{known}" == "0.0425 m"
    assert f"{unknown:.3f}" == f"{unknown}" == "no value (too_short)"
    with pytest.raises(ValueError, match="too_short"):
        float(unknown)


def test_what_several_variants_have_is_not_that_of_one() -> None:
    with pytest.raises(ValueError, match=r"one variant, got 2: take \.variants\[k\]"):
        _ = Simulation(TWO).metrics


def test_a_notebook_shows_names_and_values_and_no_markup_of_users() -> None:
    odd = {"variants": [{**variant(2.0), "metrics": {"<b>": {"peak": metric(2.0, "m")}}}]}
    page = Simulation(odd)._repr_html_()
    assert "&lt;b&gt;: peak" in page
    assert "2 m" in page


def test_tables_have_units_in_their_index_and_nothing_is_nan() -> None:
    table = Simulation(ONE).to_pandas()
    assert table.index.name == "time (s)"
    assert table["position"].tolist() == [0.0, 2.0, 2.0]
    both = Simulation(TWO).to_pandas()
    assert both.index.names == ["variant", "time (s)"]
    assert both.loc[1]["position"].tolist() == [0.0, 3.0, 3.0]
    metrics = Simulation(ONE).metrics_to_pandas()
    assert metrics.loc["position", "peak"]["value"] == 2.0
    assert metrics["value"].isna().tolist() == [False, True]


def test_arrays_have_variants_and_time_as_dimensions() -> None:
    arrays = Simulation(TWO).to_xarray()
    assert dict(arrays.sizes) == {"variant": 2, "time": 3}
    assert arrays["position"].sel(variant=1, time=0.5) == 3.0
    assert (arrays["position"].attrs["units"], arrays["time"].attrs["units"]) == ("m", "s")


def test_curves_with_gaps_become_nan_in_tables() -> None:
    curves = {"magnitude": [1.0, None], "phase": [0.0, None], "real": [1.0, None], "imag": [0.0, None]}
    reply = FrequencyResponse(
        {
            "variants": [
                {"parameters": {}, "verdict": "ok", "frequency": [1.0, 2.0], "metrics": {}, "poles": [], **curves}
            ]
        }
    )
    assert reply.to_pandas()["magnitude"].isna().tolist() == [False, True]
    assert dict(reply.to_xarray().sizes) == {"frequency": 2}


def test_elasticities_are_a_table_of_metrics_by_parameters() -> None:
    elasticity = {"value": 0.5, "one_sided": False, "verdict": "ok"}
    reply = Influence({
        "base": {}, "coefficients": {}, "strongest": {"by_parameter": {}, "by_metric": {"peak": "kp"}},
        "elasticities": {"peak": {"kp": elasticity, "ki": {**elasticity, "value": None}}},
    })  # fmt: skip
    table = reply.to_pandas()
    assert table.index.name == "metric"
    assert table.loc["peak", "kp"] == 0.5
    assert table["ki"].isna().all()


def test_results_of_jobs_are_told_by_kind_and_by_what_they_have() -> None:
    assert type(result_of("optimization", {"best": {}})) is Optimization
    assert type(result_of("identification", {"order": 2})).__name__ == "BlackBox"
    assert type(result_of("something new", {"a": 1})) is Reply


def test_a_library_that_is_missing_is_named_with_its_remedy() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"to_pandas\(\) needs no_such_library: pip install no_such_library"):
        optional.needed("no_such_library.part", "to_pandas()")


def test_connect_reads_the_environment(monkeypatch) -> None:
    monkeypatch.setenv("SERVOTUNE_URL", "http://drives.example:9000/")
    monkeypatch.setenv("SERVOTUNE_KEY", "secret")
    with servotune.connect() as client:
        assert client._transport.url == "http://drives.example:9000"
        assert client._transport._http.headers["Authorization"] == "Bearer secret"
    with servotune.connect("https://own.example", key="mine") as client:
        assert client._transport.url == "https://own.example"
    with pytest.raises(ValueError, match="must begin with http:// or https://, got 'drives'"):
        servotune.connect("drives")
