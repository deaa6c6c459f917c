"""/v1/simulations and /v1/frequency-responses: numbers of the reference loop, shapes, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from api.schemas.replies import FrequencyReply, SimulationReply
from tests.integration.api.documents import LAG, PNEUMATIC, STEP, pneumatic

#: The pneumatic loop with PID 100/20/5, N = 100 in the units of the paper: the 40-digit reference of tests/reference.
RISE, SETTLING, OVERSHOOT, PEAK_TIME = 1.12926550584625, 10.2149965109608, 0.0873231787804261, 3.0654123189545
GAIN_MARGIN, PHASE_MARGIN, BANDWIDTH = 2.93536534998578, 1.47325789684602, 1.70918875182118


def simulate(client, **fields):
    return client.post("/v1/simulations", json={"system": PNEUMATIC, "input": STEP} | fields)


def test_the_reference_loop_has_its_metrics(client) -> None:
    reply = simulate(client, outputs=["position"])
    assert reply.status_code == 200, reply.text
    SimulationReply.model_validate(reply.json())
    (variant,) = reply.json()["variants"]
    assert variant["parameters"] == {}
    assert variant["verdict"] == "ok"
    assert list(variant["outputs"]) == ["position"]
    assert len(variant["time"]) == len(variant["outputs"]["position"]) == 1000
    metrics = variant["metrics"]["position"]
    assert metrics["rise_time"] == {"value": pytest.approx(RISE, rel=1e-9), "unit": "s", "verdict": "ok"}
    assert metrics["settling_time"]["value"] == pytest.approx(SETTLING, rel=1e-9)
    assert metrics["overshoot"]["value"] == pytest.approx(OVERSHOOT, rel=1e-9)
    assert metrics["peak_time"]["value"] == pytest.approx(PEAK_TIME, rel=1e-9)


def test_samples_change_the_curve_and_no_metric(client) -> None:
    few, many = (simulate(client, outputs=["position"], samples=n).json()["variants"][0] for n in (10, 10_000))
    assert len(few["time"]) == 10
    assert few["time"][-1] == many["time"][-1]
    for name, metric in few["metrics"]["position"].items():
        assert metric["value"] == pytest.approx(many["metrics"]["position"][name]["value"], rel=1e-9), name


def test_variants_come_in_order_with_their_parameters(client) -> None:
    variants = [
        {"kp": {"value": 50, "unit": "cm**2/s"}},
        {},
        {"kp": 0.02, "motor.area": {"value": 80, "unit": "cm**2"}},
    ]
    reply = simulate(client, variants=variants, outputs=["position"], metrics=["rise_time"], samples=5)
    listed = reply.json()["variants"]
    assert [variant["parameters"] for variant in listed] == variants
    assert list(listed[0]["metrics"]["position"]) == ["rise_time"]
    rises = [variant["metrics"]["position"]["rise_time"]["value"] for variant in listed]
    assert rises[1] == pytest.approx(RISE, rel=1e-9)
    assert rises[0] > rises[1]


def test_a_stored_system_answers_as_its_document_does_and_names_its_revision(client) -> None:
    stored = client.post("/v1/systems", json=PNEUMATIC).json()
    by_id = simulate(client, system=stored["id"], samples=20).json()
    inline = simulate(client, samples=20).json()
    assert by_id["variants"] == inline["variants"]
    assert by_id["system"] == {"id": stored["id"], "revision": 1}
    assert inline["system"] is None


def test_several_inputs_add_up(client) -> None:
    load = {"port": "load", "signal": {"kind": "step", "amplitude": {"value": 10, "unit": "daN"}}}
    options = {"outputs": ["position"], "duration": 5, "samples": 50, "metrics": []}
    alone, other, both = (
        np.array(simulate(client, input=inputs, **options).json()["variants"][0]["outputs"]["position"])
        for inputs in ([STEP], load, [STEP, load])
    )
    assert both == pytest.approx(alone + other, abs=1e-12)


def test_a_kept_simulation_can_be_read_again(client) -> None:
    stored = client.post("/v1/systems", json=PNEUMATIC).json()
    reply = simulate(client, system=stored["id"], samples=30, keep=True).json()
    kept = client.get(f"/v1/results/{reply['id']}").json()
    assert kept["result"]["variants"] == reply["variants"]
    assert kept["system"] == {"id": stored["id"], "revision": 1}
    assert kept["request"]["samples"] == 30
    assert set(kept["versions"]) >= {"servotune", "numpy"}
    assert reply["id"] in [row["id"] for row in client.get("/v1/results?kind=simulation").json()["items"]]
    assert client.get("/v1/results/res_nothing").status_code == 404


UNSTABLE = {
    "blocks": {"u": {"kind": "input"}, "p": {"kind": "transfer_function", "numerator": [1], "denominator": [1, -1]}},
    "connections": [{"from": "u", "to": "p"}],
    "outputs": {"y": "p"},
}
INTEGRATOR = UNSTABLE | {"blocks": {"u": {"kind": "input"}, "p": {"kind": "integrator"}}}


def step_of(client, document, **fields):
    body = {"system": document, "input": {"port": "u", "signal": {"kind": "step"}}} | fields
    reply = client.post("/v1/simulations", json=body)
    assert reply.status_code == 200, reply.text
    return reply.json()["variants"][0]


def test_an_unstable_system_says_so_and_still_shows_its_curve(client) -> None:
    variant = step_of(client, UNSTABLE, duration=3)
    assert variant["verdict"] == "unstable"
    assert variant["outputs"]["y"][-1] == pytest.approx(math.exp(3) - 1, rel=1e-9)
    rise = variant["metrics"]["y"]["rise_time"]
    assert rise["value"] is None
    assert rise["verdict"] == "unstable"
    assert rise["advice"]


def test_what_grows_beyond_every_number_is_null_and_never_nan(client) -> None:
    reply = client.post(
        "/v1/simulations",
        json={"system": UNSTABLE, "input": {"port": "u", "signal": {"kind": "step"}}, "duration": 1000},
    )
    assert "NaN" not in reply.text
    curve = reply.json()["variants"][0]["outputs"]["y"]
    assert curve[0] == pytest.approx(0.0, abs=1e-12)
    assert curve[-1] is None


def test_an_integrating_path_is_told_from_an_unstable_one(client) -> None:
    variant = step_of(client, INTEGRATOR, duration=2, metrics=["rise_time", "peak"])
    assert variant["metrics"]["y"]["rise_time"]["verdict"] == "integrating"
    assert variant["outputs"]["y"][-1] == pytest.approx(2.0)


def test_a_variant_without_a_solution_is_ill_posed_and_the_others_are_computed(client) -> None:
    loop = {
        "parameters": {"k": {"value": 0.5}},
        "blocks": {"u": {"kind": "input"}, "s": {"kind": "sum", "signs": "++"}, "g": {"kind": "gain", "gain": "=k"}},
        "connections": [{"from": "u", "to": "s.in1"}, {"from": "s", "to": "g"}, {"from": "g", "to": "s.in2"}],
        "outputs": {"y": "g"},
    }
    body = {
        "system": loop,
        "input": {"port": "u", "signal": {"kind": "step"}},
        "variants": [{"k": 1.0}, {"k": 0.5}],
        "samples": 3,
        "duration": 1,
    }
    ill, sound = client.post("/v1/simulations", json=body).json()["variants"]
    assert ill["verdict"] == "ill_posed"
    assert sound["outputs"]["y"] == pytest.approx([1.0, 1.0, 1.0])


WRONG = {
    "no system": ({"system": None}, "/system"),
    "unknown system": ({"system": "sys_nothing"}, "/system"),
    "system is a number": ({"system": 5}, "/system"),
    "wrong block": (
        {"system": pneumatic(motor={"kind": "linear_pneumatic_motor", "area": -1})},
        "/system/blocks/motor",
    ),
    "no input": ({"input": None}, "/input"),
    "empty inputs": ({"input": []}, "/input"),
    "unknown port": ({"input": {"port": "ghost", "signal": {"kind": "step"}}}, "/input/port"),
    "port that is no input": ({"input": {"port": "motor.flow", "signal": {"kind": "step"}}}, "/input/port"),
    "port twice": ({"input": [STEP, STEP]}, "/input/1/port"),
    "unknown signal": ({"input": {"port": "reference", "signal": {"kind": "jump"}}}, "/input/signal/kind"),
    "wrong unit in a signal": (
        {"input": {"port": "reference", "signal": {"kind": "step", "start": {"value": 1, "unit": "m"}}}},
        "/input/signal/start",
    ),
    "amplitude in another unit than the input": (
        {"input": {"port": "reference", "signal": {"kind": "step", "amplitude": {"value": 1, "unit": "V"}}}},
        "/input/signal/amplitude",
    ),
    "negative start": (
        {"input": {"port": "reference", "signal": {"kind": "step", "start": -1}}},
        "/input/signal/start",
    ),
    "unknown output": ({"outputs": ["position", "smell"]}, "/outputs/1"),
    "no outputs": ({"outputs": []}, "/outputs"),
    "unknown metric": ({"metrics": ["rise_time", "beauty"]}, "/metrics/1"),
    "duration zero": ({"duration": 0}, "/duration"),
    "duration beyond any": ({"duration": 1e300}, "/duration"),
    "duration in metres": ({"duration": {"value": 1, "unit": "m"}}, "/duration"),
    "duration a word": ({"duration": "long"}, "/duration"),
    "one sample": ({"samples": 1}, "/samples"),
    "too many samples": ({"samples": 100_001}, "/samples"),
    "half a sample": ({"samples": 10.5}, "/samples"),
    "no variants": ({"variants": []}, "/variants"),
    "too many variants": ({"variants": [{}] * 1001}, "/variants"),
    "unknown parameter": ({"variants": [{}, {"ghost": 1}]}, "/variants/1/ghost"),
    "parameter in a wrong unit": ({"variants": [{"m": {"value": 1, "unit": "m"}}]}, "/variants/0/m"),
    "parameter given by an expression": ({"variants": [{"motor.mass": 1}]}, "/variants/0/motor.mass"),
    "parameter out of its bounds": ({"variants": [{"motor.area": -1}]}, "/variants/0"),
    "reply too large": ({"samples": 100_000, "variants": [{}] * 1000}, "/samples"),
    "unknown field": ({"sample": 5}, "/sample"),
    "keep is a word": ({"keep": "yes"}, "/keep"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_simulation_is_refused_at_its_place(client, case) -> None:
    fields, pointer = WRONG[case]
    reply = simulate(client, **fields)
    assert reply.status_code == 422, reply.text
    assert reply.headers["Content-Type"] == "application/problem+json"
    assert any(entry["pointer"].startswith(pointer) for entry in reply.json()["errors"]), reply.text


def test_limits_name_the_count_and_the_limit(client) -> None:
    detail = simulate(client, samples=100_001).json()["detail"]
    assert "100000" in detail
    assert "100001" in detail


def respond(client, **fields):
    return client.post("/v1/frequency-responses", json={"system": PNEUMATIC} | fields)


def test_the_open_loop_has_the_margins_of_the_reference(client) -> None:
    reply = respond(client, open_at="error")
    assert reply.status_code == 200, reply.text
    FrequencyReply.model_validate(reply.json())
    (variant,) = reply.json()["variants"]
    metrics = variant["metrics"]
    assert metrics["gain_margin"]["value"] == pytest.approx(GAIN_MARGIN, rel=1e-9)
    assert metrics["phase_margin"]["value"] == pytest.approx(PHASE_MARGIN, rel=1e-9)
    assert metrics["phase_margin"]["unit"] == "rad"
    assert GAIN_MARGIN in [pytest.approx(crossing["value"], rel=1e-9) for crossing in variant["margins"]["gain"]]
    assert variant["margins"]["smallest_loop_gain"] == 1e-3
    # stable with a stable open loop: the curve does not go round -1
    assert variant["nyquist"] == {"encirclements": 0, "open_loop_unstable_poles": 0, "closed_loop_unstable_poles": 0}
    # L is signed so that 1 + L = 0 is the characteristic equation: at low frequencies it is large and positive real-ish
    response = np.array(variant["real"]) + 1j * np.array(variant["imag"])
    assert np.abs(response) == pytest.approx(np.array(variant["magnitude"]))
    assert len(variant["poles"]) == 5


def test_a_path_has_its_bandwidth_and_no_margins(client) -> None:
    (variant,) = respond(client, **{"from": "reference", "to": "position"}).json()["variants"]
    assert variant["metrics"]["bandwidth"]["value"] == pytest.approx(BANDWIDTH, rel=1e-9)
    assert "margins" not in variant


def test_compliance_is_the_path_from_the_load(client) -> None:
    # static: the integral action holds the position, so that the compliance falls to 0 at low frequencies
    body = {"from": "load", "to": "position", "frequencies": [1e-6, {"value": 1, "unit": "Hz"}]}
    (variant,) = respond(client, **body).json()["variants"]
    assert variant["frequency"] == [1e-6, 2 * math.pi]
    assert variant["magnitude"][0] < 1e-8


def test_given_together_the_loop_is_the_curve_and_the_path_is_beside_it(client) -> None:
    together = {"open_at": "error", "from": "reference", "to": "position", "frequencies": [1.0, 2.0]}
    (variant,) = respond(client, **together).json()["variants"]
    (alone,) = respond(client, open_at="error", frequencies=[1.0, 2.0]).json()["variants"]
    assert variant["magnitude"] == alone["magnitude"]
    assert variant["metrics"]["bandwidth"]["value"] == pytest.approx(BANDWIDTH, rel=1e-9)
    assert variant["metrics"]["gain_margin"]["value"] == pytest.approx(GAIN_MARGIN, rel=1e-9)


WRONG_PATHS = {
    "nothing asked": ({}, "/from"),
    "only from": ({"from": "reference"}, "/to"),
    "only to": ({"to": "position"}, "/from"),
    "from together with open_at": ({"open_at": "error", "from": "reference"}, "/to"),
    "unknown input": ({"from": "ghost", "to": "position"}, "/from"),
    "unknown output": ({"from": "reference", "to": "ghost"}, "/to"),
    "unknown loop": ({"open_at": "ghost"}, "/open_at"),
    "unknown metric": ({"open_at": "error", "metrics": ["beauty"]}, "/metrics/0"),
    "no frequencies": ({"open_at": "error", "frequencies": []}, "/frequencies"),
    "negative frequency": ({"open_at": "error", "frequencies": [-1.0]}, "/frequencies/0"),
    "falling frequencies": ({"open_at": "error", "frequencies": [2.0, 1.0]}, "/frequencies/1"),
    "frequency in metres": ({"open_at": "error", "frequencies": [{"value": 1, "unit": "m"}]}, "/frequencies/0"),
    "frequency a word": ({"open_at": "error", "frequencies": ["low"]}, "/frequencies"),
    "unknown parameter": ({"open_at": "error", "variants": [{"ghost": 1}]}, "/variants/0/ghost"),
    "unknown field": ({"open_at": "error", "freq": 1}, "/freq"),
}


@pytest.mark.parametrize("case", WRONG_PATHS)
def test_a_wrong_frequency_response_is_refused_at_its_place(client, case) -> None:
    fields, pointer = WRONG_PATHS[case]
    reply = respond(client, **fields)
    assert reply.status_code == 422, reply.text
    assert any(entry["pointer"].startswith(pointer) for entry in reply.json()["errors"]), reply.text


def test_warnings_of_a_stored_system_name_their_place(client) -> None:
    document = LAG | {"parameters": LAG["parameters"] | {"unused": {"value": 1}}}
    stored = client.post("/v1/systems", json=document).json()["id"]
    body = {"input": {"port": "u", "signal": {"kind": "step"}}, "samples": 2}
    (inline,) = client.post("/v1/simulations", json=body | {"system": document}).json()["warnings"]
    (by_id,) = client.post("/v1/simulations", json=body | {"system": stored}).json()["warnings"]
    assert inline["pointer"] == "/system/parameters/unused"
    assert by_id["pointer"] == "/system"
    assert by_id["detail"].startswith("/parameters/unused")


def test_at_rest_a_frequency_response_is_the_static_gain_or_null_with_a_verdict(client) -> None:
    """The position follows its reference; the open loop integrates: C P = (kp + ki/s + ...) / (... s)."""
    together = {"open_at": "error", "from": "reference", "to": "position", "frequencies": [0, 1.0]}
    (loop,) = respond(client, **together).json()["variants"]
    assert [loop["magnitude"][0], loop["phase"][0], loop["real"][0], loop["imag"][0]] == [None] * 4
    assert loop["unbounded"] == [
        {"frequency": 0.0, "verdict": "integrating", "advice": "there is a pole at 0 rad/s: ask beside it"}
    ]
    (path,) = respond(client, **{"from": "reference", "to": "position", "frequencies": [0, 1.0]}).json()["variants"]
    assert path["magnitude"][0] == pytest.approx(1.0, rel=1e-14)
    assert path["phase"][0] == 0.0
    assert path.get("unbounded") is None
