"""`python -m examples.demo` runs the demonstration and writes its report."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import servotune
from examples.demo import analysing, measuring, report, tuning
from examples.demo.findings import PLACES, DemoError, Estimate, Findings, Recording, Search, Understanding
from examples.demo.systems import VARIABLES
from examples.demo.units import MILLISECONDS, measured, parameter, signed, words

PARTS = {
    "valve.flow_gain": "flow gain",
    "valve.time_constant": "lag",
    "transport.time": "delay",
    "recording.time": "delay",
}
"""What is estimated, in a word."""

SHORT = {
    "response_time": "t_resp",
    "max_velocity": "v_max",
    "max_acceleration": "a_max",
    "critical_frequency": "f_crit",
    "bandwidth": "bandw.",
    "sensitivity_peak": "Ms",
    "gain_margin": "gain m.",
    "phase_margin": "phase m.",
    "delay_margin": "delay m.",
    "overshoot": "oversh.",
}
"""Heads of the columns on the terminal."""

NEXT = """\
What to try next
  the report    open {report}
  the service   make serve        (it prints its first key; the API's pages are at http://127.0.0.1:8000/docs)
  a curl line   curl -H "Authorization: Bearer $KEY" http://127.0.0.1:8000/v1/catalog/elements
  a script      .venv/bin/python examples/step_response.py --key $KEY
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration and return its exit code."""
    options = _options(arguments)
    began = time.monotonic()
    step = Narrator()
    try:
        for old in options.workdir.glob("servotune.db*"):
            old.unlink()
        with servotune.local(options.workdir) as client:
            findings = improve(client, understand(client, options.recording, step), step)
        step("h", "report")
        report.write(findings, options.report)
    except (DemoError, servotune.ServotuneError) as error:
        sys.stderr.write(f"The demonstration stopped at step {step.letter} ({step.title}): {error}\n")
        return 1
    step.tell(f"{options.report}, {options.report.stat().st_size / 1e6:.1f} MB, opens offline")
    sys.stdout.write(f"\nDone in {time.monotonic() - began:.1f} s.\n\n{NEXT.format(report=options.report)}")
    return 0


def understand(client: servotune.Client, recording_file: Path, step: Narrator) -> Understanding:
    """Do steps a to e over HTTP and return what was learnt."""
    step("a", "recording")
    recording = measuring.import_recording(client, recording_file, measuring.DATA / "import.json")
    _tell_recording(step, recording)

    step("b", "identification")
    estimates = measuring.identify(client, recording)
    scenarios = measuring.choose(estimates)
    base = tuple(estimate for estimate in scenarios if estimate.place == scenarios[0].place)
    _tell_estimates(step, estimates, scenarios)
    measuring.require_bars(base)

    step("c", "validation")
    checks = measuring.validate(client, recording, base)
    for check in checks:
        reply = check.reply["outputs"]["measured"]
        other = check.published["outputs"]["measured"]
        step.tell(
            f"{check.half.name} half: FIT {reply['fit_percent']:.2f} % (published model {other['fit_percent']:.2f} %, "
            f"output = command {reply['baselines']['input']['fit_percent']:.1f} %), relative error "
            f"{reply['relative_error_percent']:.2f} %, worst between {reply['worst_interval'][0]:.2f} and "
            f"{reply['worst_interval'][1]:.2f} s: {check.reply['verdict']}"
        )

    step("d", "starting point")
    start = analysing.behaviour(client, "P", {}, scenarios)
    for index, scenario in enumerate(scenarios):
        shown = ("response_time", "overshoot", "max_acceleration", "bandwidth", "sensitivity_peak", "phase_margin")
        values = ", ".join(f"{words(m)} {measured(m, analysing.metric(start, m, index))}" for m in shown)
        step.tell(f"{scenario.name}: {values}")

    step("e", "influence")
    influence = analysing.influence(client, "P", scenarios[0])
    _tell_influence(step, influence)
    return Understanding(
        recording=recording,
        estimates=estimates,
        scenarios=scenarios,
        checks=checks,
        start=start,
        influence=influence,
    )


def improve(client: servotune.Client, understood: Understanding, step: Narrator) -> Findings:
    """Do steps f and g over HTTP and return all that was learnt."""
    scenarios = understood.scenarios
    step("f", "optimisation")
    bounds = tuning.limits(understood.start)
    jobs = tuning.start_searches(client, scenarios, bounds)
    told = [_told(step, tuning.finished(*job)) for job in jobs]
    searches = tuple(
        sorted(told, key=lambda search: (list(VARIABLES).index(search.law), list(tuning.AIMS).index(search.aim)))
    )
    _tell_agreement(step, searches)

    step("g", "proof")
    for search in searches:
        if search.method == "gradient":
            _tell_certificate(step, search)
    tuned = {
        f"{search.law} {search.aim}": analysing.behaviour(client, search.law, search.reply["best"], scenarios)
        for search in searches
        if search.method == "gradient"
    }
    return Findings(
        **vars(understood),
        limits=bounds,
        searches=searches,
        tuned=tuned,
        catalog={item["kind"]: dict(item) for item in client.catalog.metrics()},
    )


class Narrator:
    """Tells on the terminal which step is on and what it found."""

    def __init__(self) -> None:
        self.letter, self.title = "0", "starting the service"
        self._head = ""

    def __call__(self, letter: str, title: str) -> None:
        """Begin a step."""
        self.letter, self.title = letter, title
        self._head = f"{letter}  {title}"

    def tell(self, text: str) -> None:
        """Print one finding of the present step, the first one beside its name."""
        sys.stdout.write(f"{self._head:<18} {text}\n")
        sys.stdout.flush()
        self._head = ""


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m examples.demo", description=sys.modules["examples.demo"].__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--report", type=Path, default=Path("demo-report.html"), help="where the report goes")
    parser.add_argument("--recording", type=Path, default=measuring.DATA / "0A.txt", help="another recording like it")
    parser.add_argument("--workdir", type=Path, default=Path(".demo"), help="folder of the database and the log")
    return parser.parse_args(arguments)


def _tell_recording(step: Narrator, recording: Recording) -> None:
    start, end = recording.active
    channels = ", ".join(channel["name"] for channel in recording.dataset.get("channels", ()))
    step.tell(f"{recording.file}, {recording.size / 1e6:.1f} MB: {channels}; active from {start:.3f} to {end:.3f} s")


def _tell_estimates(step: Narrator, estimates: Sequence[Estimate], scenarios: Sequence[Estimate]) -> None:
    for estimate in estimates:
        values = ", ".join(
            f"{PARTS[path]} {parameter(path, entry['value'])}" for path, entry in estimate.reply["parameters"].items()
        )
        step.tell(
            f"{estimate.name}: {values}; FIT {estimate.own_fit:.2f} %, of the other half {estimate.other_fit:.2f} %"
        )
    if len({estimate.place for estimate in scenarios}) == len(PLACES):
        step.tell(
            f"the places of the delay differ by less than {measuring.INDISTINCT} points of FIT, so the recording cannot tell: "
            f"all {len(scenarios)} estimates are scenarios"
        )
        step.tell(f"from here on, and the base is the {PLACES[scenarios[0].place]}, which is harder to control")
    else:
        step.tell(f"{PLACES[scenarios[0].place]} fits best; both of its estimates are scenarios from here on")
    for sentence in scenarios[0].reply["indistinguishable"]:
        step.tell(str(sentence))


def _tell_influence(step: Narrator, influence: servotune.replies.Influence) -> None:
    strongest = influence["strongest"]
    names = analysing.existing(influence)
    step.tell("elasticities of the metrics (columns) in the parameters (rows); > strongest of its row, ^ of its column")
    step.tell(" " * 26 + "".join(f"{SHORT[name]:>11}" for name in names))
    for path in analysing.parameters(influence):
        row = ""
        for name in names:
            mark = ">" * (strongest["by_parameter"].get(path) == name) + "^" * (strongest["by_metric"][name] == path)
            row += f"{mark + signed(influence['elasticities'][name][path]['value']):>11}"
        step.tell(f"{path:<26}{row}")
    step.tell(f"influence coefficients C of eq. (4), each parameter changed by {analysing.CHANGE:+.0%}")
    for path in analysing.parameters(influence):
        row = "".join(f"{signed(influence['coefficients'][name][path]['value']):>11}" for name in names)
        step.tell(f"{path:<26}{row}")
    step.tell(
        "by columns, the strongest lever on " + ", ".join(f"{words(n)}: {strongest['by_metric'][n]}" for n in names)
    )
    for name in sorted(set(influence["elasticities"]) - set(names)):
        step.tell(f"{words(name)} has no relative change: {measured(name, influence['base'][name])} to begin with")


def _told(step: Narrator, search: Search) -> Search:
    reply = search.reply
    best = ", ".join(f"{path.partition('.')[2]} {parameter(path, value)}" for path, value in reply["best"].items())
    aim = reply["goals"][0]
    step.tell(
        f"{search.law:<3} {words(search.aim):<16} {search.method:<8} {measured(search.aim, aim['before'])} -> "
        f"{measured(search.aim, aim['after'])}  ({best}); {reply['evaluations']} evaluations, {reply['seconds']:.1f} s, "
        f"{reply['status']}"
    )
    return search


def _tell_agreement(step: Narrator, searches: Sequence[Search]) -> None:
    found = {(s.law, s.aim, s.method): s.reached for s in searches}
    for law in VARIABLES:
        for aim in tuning.AIMS:
            grid, gradient = found[law, aim, "grid"], found[law, aim, "gradient"]
            apart = abs(grid - gradient) / abs(gradient)
            step.tell(f"{law:<3} {words(aim):<16} grid and gradient agree within {apart:.2%}")


def _tell_certificate(step: Narrator, search: Search) -> None:
    certificate = search.reply["certificate"]
    values = []
    for entry in certificate["goals"]:
        goal = search.reply["goals"][entry["goal"]]
        shown = measured(goal["metric"], {"value": entry["value"], "verdict": "absent"})
        at = entry.get("at") or {}
        where = f" at {MILLISECONDS(at['time'])}" if at.get("time") is not None else ""
        where = f" at {at['frequency']:.1f} rad/s" if at.get("frequency") is not None else where
        values.append(f"{words(goal['metric'])} {shown}{where}")
    verdict = "holds" if certificate["valid"] else "does not hold"
    step.tell(f"{search.law:<3} {words(search.aim):<16} {verdict} in all scenarios: {', '.join(values)}")


if __name__ == "__main__":
    sys.exit(main())
