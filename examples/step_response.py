"""A first script: describe a position loop, look at its step response, and ask what would make it faster.

Start a service with `make serve`, then

    .venv/bin/python examples/step_response.py --key KEY

where KEY is the key that the service printed when it started for the first time.
"""

from __future__ import annotations

import argparse
import sys

import servotune

PNEUMATIC_LOOP = {
    "name": "Pneumatic position loop",
    "parameters": {
        "kp": {"value": 0.01, "lower": 1e-4, "upper": 0.1, "scale": "log", "doc": "m³/s of air per m of error"},
    },
    "blocks": {
        "reference": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "controller": {"kind": "pid", "kp": "=kp", "ki": 0, "kd": "=kp/20", "filter_frequency": 100},
        "motor": {
            "kind": "linear_pneumatic_motor",
            "area": {"value": 65, "unit": "cm**2"},
            "volume": {"value": 750, "unit": "cm**3"},
            "pressure": {"value": 5, "unit": "daN/cm**2"},
            "adiabatic_index": 1.4,
            "leakage": {"value": 0.4, "unit": "cm**5/(daN*s)"},
            "mass": {"value": 0.3, "unit": "daN*s**2/cm"},
            "viscous_friction": {"value": 1.2, "unit": "daN*s/cm"},
        },
    },
    "connections": [
        {"from": "reference", "to": "error.in1"},
        {"from": "motor.position", "to": "error.in2"},
        {"from": "error", "to": "controller"},
        {"from": "controller", "to": "motor.flow"},
    ],
    "outputs": {"position": "motor.position", "control": "controller"},
}
STEP = {"kind": "step", "amplitude": {"value": 1, "unit": "cm"}}


def main() -> int:
    """Run the script and return its exit code."""
    parser = argparse.ArgumentParser(description=sys.modules[__name__].__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--key", required=True)
    options = parser.parse_args()
    try:
        with servotune.connect(options.url, key=options.key) as client:
            compare_gains(client)
            find_levers(client)
    except servotune.ServotuneError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


def compare_gains(client: servotune.Client) -> None:
    """Simulate the loop with three gains."""
    reply = client.simulate(
        PNEUMATIC_LOOP,
        input={"port": "reference", "signal": STEP},
        metrics=["rise_time", "response_time", "overshoot"],
        variants=[{"kp": kp} for kp in (0.005, 0.01, 0.02)],
    )
    for variant in reply["variants"]:
        values = (f"{name} {show(metric)}" for name, metric in variant["metrics"]["position"].items())
        print(f"kp = {variant['parameters']['kp']:g}: {', '.join(values)}; {variant['verdict']}")


def find_levers(client: servotune.Client) -> None:
    """Ask which parameter moves the response time most."""
    parameters = ["kp", "motor.area", "motor.volume", "motor.mass", "motor.leakage", "motor.viscous_friction"]
    study = client.influence(
        PNEUMATIC_LOOP,
        input="reference",
        output="position",
        signal=STEP,
        parameters=parameters,
        metrics=["response_time"],
    )
    print("1 % more of a parameter changes the response time by")
    for path, elasticity in study["elasticities"]["response_time"].items():
        value = "no number" if elasticity["value"] is None else f"{elasticity['value']:+.3f} %"
        print(f"  {path:<24}{value}" + (" (one-sided)" if elasticity["one_sided"] else ""))
    print(f"The strongest lever: {study['strongest']['by_metric']['response_time']}")


def show(metric: servotune.replies.Metric) -> str:
    """Return a metric as text: its value, or the verdict why there is none."""
    return metric["verdict"] if metric["value"] is None else f"{metric['value']:.4g} {metric['unit']}"


if __name__ == "__main__":
    sys.exit(main())
