"""`python -m examples.demo_lab` measures, identifies, validates, re-optimises and measures again, on a simulated rig."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import servotune
from examples.demo_lab.axis import CHIRP, DRIVERS, HIDDEN, IDENTIFIED, START_GAIN, STEP, TEXTBOOK, TRUTH, axis
from examples.demo_lab.figure import draw
from examples.demo_lab.processes import Lab, LabError, lab

CHANNELS: dict[str, Any] = {"inputs": {"reference": "reference"}, "outputs": {"position": "position"}}
GOALS: list[dict[str, Any]] = [
    {"metric": "response_time", "experiment": "step", "output": "position", "sense": "minimize"},
    {"metric": "overshoot", "experiment": "step", "output": "position", "upper": 0.02},
    {"metric": "sensitivity_peak", "open_at": "error", "upper": 1.6},
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A step of the axis as it was measured."""

    time: list[float]
    position: list[float]

    @property
    def response_time(self) -> float:
        """Time (s) from the step to the last entry into 5 % of the way."""
        final = self.position[-1]
        outside = [t for t, y in zip(self.time, self.position, strict=True) if abs(y - final) > 0.05 * abs(final)]
        return max(outside)

    @property
    def overshoot(self) -> float:
        """Beyond the end of the way, as a share of it."""
        return max(self.position) / self.position[-1] - 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Late:
    """What comes between command and motion, s: a recording tells the sum better than its parts."""

    lag: float
    delay: float
    correlation: float

    @property
    def total(self) -> float:
        """Lag and delay together."""
        return self.lag + self.delay


@dataclass(frozen=True, slots=True, kw_only=True)
class Swing:
    """What the identified model does not explain although the reference does: Hz, m rms."""

    frequency: float
    damping_ratio: float
    rms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What the day brought."""

    textbook: Mapping[str, Any]
    identified: Mapping[str, Any]
    parameters: Mapping[str, float]
    late: Late
    swings: list[Swing]
    gain: float
    before: Measured
    after: Measured
    predicted: Mapping[str, float]

    @property
    def errors(self) -> tuple[float, float]:
        """Relative error (%) of the textbook's model and of the identified one."""
        return tuple(
            float(v["outputs"]["position"]["relative_error_percent"]) for v in (self.textbook, self.identified)
        )  # type: ignore[return-value] # there are two


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration and return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m examples.demo_lab", description=sys.modules[__name__].__doc__)
    parser.add_argument("--figure", type=Path, default=Path("demo-lab.png"), help="where the figure goes")
    parser.add_argument("--workdir", type=Path, default=Path(".demo-lab"), help="folder of database, samples and logs")
    parser.add_argument(
        "--driver",
        choices=list(DRIVERS),
        default="nidaqmx",
        help="how the rig is reached: NI modules, or a PLC (opcua)",
    )
    given = parser.parse_args(arguments)
    began = time.monotonic()
    try:
        with lab(given.workdir, driver=given.driver) as running:
            findings = run(running)
    except (LabError, servotune.ServotuneError) as error:
        sys.stderr.write(f"The demonstration stopped: {error}\n")
        return 1
    draw(findings, given.figure)
    print(f"\n{given.figure}: measured and simulated, before and after. Done in {time.monotonic() - began:.0f} s.")
    print("The rig was simulated: it stands in for hardware, and proves nothing about a module, a cable or a driver.")
    return 0


def run(running: Lab) -> Findings:
    """Do a day's work, and return what it brought."""
    client = running.client
    running.set_law(axis(TRUTH, gain=START_GAIN))
    running.start_agent()
    rig = next(iter(client.acquisitions.rigs()))
    print(f"rig          {rig['name']}: {', '.join(d['model'] for d in rig['document']['devices'])} (simulated)")

    model = axis(TEXTBOOK, gain=START_GAIN)
    acquisition = _measured(client, model)
    attempt = acquisition["attempts"][-1]
    facts = attempt["facts"] or {}
    print(
        f"measured     {facts['samples']} samples of 2 channels at {facts['actual_rate']:.2f}/s "
        f"({facts['requested_rate']:.0f} were asked for)"
    )
    textbook = client.validate(
        model, dataset=str(acquisition["dataset"]), limit_percent=5.0, diagnose="never", points=4000, **CHANNELS
    )
    identification, validation = attempt["then"]
    for step in (identification, validation):
        if step["status"] != "done":
            raise LabError(f"the {step['kind']} that follows the recording must succeed: {step['detail']}")
    identified = client.jobs.get(str(validation["job"])).wait(progress=False)
    parameters = dict((identification["result"] or {})["parameters"])
    errors = [reply["outputs"]["position"]["relative_error_percent"] for reply in (textbook, identified)]
    print(
        f"validated    textbook {errors[0]:.1f} %: {textbook['verdict']}; identified {errors[1]:.2f} %: {identified['verdict']}"
    )
    print(
        "identified   "
        + ", ".join(f"{name} {value:.4g} (textbook {TEXTBOOK[name]:.4g})" for name, value in parameters.items())
    )
    late = _late(client, str(identification["job"]))
    print(
        f"             lag and delay {1e3 * late.total:.2f} ms together; one by one {1e3 * late.lag:.2f} and "
        f"{1e3 * late.delay:.2f} ms (correlation {late.correlation:.2f}: this recording tells their sum)"
    )

    swings = _swings(identified)
    for swing in swings:
        print(
            f"not modelled {swing.frequency:.1f} Hz, damping ratio {swing.damping_ratio:.2f}: {1e6 * swing.rms:.1f} um rms that follow the "
            f"reference and no parameter explains (the simulator has a mode of the frame at {HIDDEN:g} Hz)"
        )

    before = _step(client)
    better = axis({**TEXTBOOK, **parameters}, gain=START_GAIN)
    optimum = _optimized(client, better)
    gain = float(optimum["best"]["kp"])
    predicted = {goal["metric"]: goal["after"]["value"] for goal in optimum["goals"]}
    print(
        f"optimised    kp {START_GAIN:g} -> {gain:.4g} 1/s; the certificate {'holds' if optimum['certificate']['valid'] else 'fails'}"
    )
    running.set_law(axis(TRUTH, gain=gain))
    after = _step(client)
    print(
        f"measured     response time {before.response_time:.3f} -> {after.response_time:.3f} s (predicted "
        f"{predicted['response_time']:.3f}), overshoot {before.overshoot:.1%} -> {after.overshoot:.1%}"
    )
    return Findings(
        textbook=textbook, identified=identified, parameters=parameters, late=late, swings=swings, gain=gain, before=before,
        after=after, predicted=predicted,
    )  # fmt: skip


def _measured(client: servotune.Client, model: Mapping[str, Any]) -> servotune.acquisitions.Acquisition:
    """Let a schedule start a measurement with the steps that follow it."""
    then = [
        {
            "kind": "identification",
            "body": {"system": model, **CHANNELS, "parameters": IDENTIFIED, "offsets": "estimate"},
        },
        {
            "kind": "validation",
            "body": {
                "system": model,
                **CHANNELS,
                "offsets": "estimate",
                "limit_percent": 5.0,
                "diagnose": "never",
                "points": 4000,
            },
        },
    ]
    nightly = client.schedules.create("every night", cron="0 3 * * *", kind="acquisition", body=CHIRP | {"then": then})
    run_ = client.schedules.trigger(nightly["id"])
    print(f"scheduled    every night at 3; now: job {run_['job']}")
    found = next(entry for entry in client.acquisitions.list() if entry["name"] == CHIRP["name"])
    return client.acquisitions.wait(found["id"], timeout=180)


def _late(client: servotune.Client, job: str) -> Late:
    found = client.jobs.get(job).wait(progress=False)
    lag, delay = (found["parameters"][name]["value"] for name in ("valve_lag", "delay"))
    names = list(found["parameters"])
    correlation = found["correlations"][names.index("valve_lag")][names.index("delay")]
    return Late(lag=lag, delay=delay, correlation=correlation)


def _swings(validation: Mapping[str, Any]) -> list[Swing]:
    """Return the modes of the machine that the model lacks, as its validation has found them."""
    return [
        Swing(
            frequency=band["mode"]["frequency"] / (2 * math.pi),
            damping_ratio=band["mode"]["damping_ratio"],
            rms=band["rms"],
        )
        for band in validation["outputs"]["position"]["unmodelled"]
        if band["mode"] is not None
    ]


def _step(client: servotune.Client) -> Measured:
    acquisition = client.acquisitions.wait(client.acquisitions.start(**STEP)["id"], timeout=60)
    dataset, facts = str(acquisition["dataset"]), acquisition["attempts"][-1]["facts"] or {}
    found = client.datasets.channel(dataset, "position")
    start = facts["repeats"]["first"] / facts["actual_rate"]
    # Before the soft stop brings the axis home.
    kept = [(t - start, y) for t, y in zip(found["time"], found["values"], strict=True) if 0.0 <= t - start <= 1.9]
    final = sum(y for t, y in kept if t > 1.7) / sum(1 for t, _ in kept if t > 1.7)
    return Measured(time=[t for t, _ in kept] + [1.9], position=[y for _, y in kept] + [final])


def _optimized(client: servotune.Client, model: Mapping[str, Any]) -> Any:
    job = client.optimize(
        model,
        variables=[{"parameter": "kp"}],
        experiments=[{"name": "step", "input": {"port": "reference", "signal": {"kind": "step", "amplitude": 0.02}}}],
        goals=GOALS,
        method={"kind": "gradient", "starts": 4, "seed": 1},
    )
    return job.wait(progress=False)


if __name__ == "__main__":
    sys.exit(main())
