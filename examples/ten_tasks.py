"""Ten tasks of every day with the library, each with its lines of code and its seconds.

Start a service with `make serve`, then

    .venv/bin/python examples/ten_tasks.py --key KEY

The textbook figure is that of K. Ogata, Modern Control Engineering, 5th ed., example 5-2: a servo with velocity feedback, whose gains are
wanted for an overshoot of 0.2 and a peak time of 1 s. The book finds K = 12.5 N m and Kh = 0.178 s. The recording is made by the script.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import random
import sys
import tempfile
import textwrap
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import servotune
from servotune import feedback, gain, quantity, tf

NAME = "Servo, Ogata example 5-2"
STEP = {"port": "reference", "signal": {"kind": "step"}}
MOTOR = tf([1], ["=J", "=B"], "motor").system("Motor", input="torque", output="velocity", J=0.5, B=0.5)
SIGNALS = {"inputs": {"torque": "torque"}, "outputs": {"velocity": "velocity"}}


class Work:
    """Ten tasks in the order of a working day; each says in a few words what came of it."""

    def __init__(self, client: servotune.Client, folder: Path) -> None:
        self.client, self.folder = client, folder

    def new_system(self) -> str:
        """Draw a new system from a textbook figure."""
        speed = feedback(gain("=K") >> tf([1], ["=J", "=B"], "motor"), gain("=Kh", "tachometer"))
        servo = feedback(speed >> tf([1], [1, 0], "position")).system(
            NAME,
            input="reference",
            output="position",
            K=quantity(5, lower=1, upper=12.5),
            Kh=quantity(0.1, lower=0.01, upper=1),
            J=1,
            B=1,
        )
        self.axis = self.client.systems.create(servo).id
        return repr(servo)

    def tune(self) -> str:
        """Tune it."""
        self.search = self.client.optimize(
            self.axis,
            variables=[{"parameter": "K"}, {"parameter": "Kh"}],
            experiments=[{"name": "step", "input": STEP}],
            goals=[{"metric": "peak_time", "sense": "minimize"}, {"metric": "overshoot", "upper": 0.2}],
        )
        self.optimum = self.search.wait(progress=False)
        return repr(self.optimum)

    def compare(self) -> str:
        """Compare two designs."""
        self.both = self.client.simulate(self.axis, input=STEP, variants=[{}, self.optimum.best])
        before, after = (variant.metrics["position"].overshoot for variant in self.both.variants)
        return f"overshoot {before} -> {after}"

    def identify(self) -> str:
        """Import a recording and identify the motor from it."""
        self.recording = self.client.datasets.upload({"name": "motor, run 1"}, self.folder / "run 1.csv").id
        fit = self.client.identify(MOTOR, dataset=self.recording, parameters=["J", "B"], **SIGNALS)
        self.found = {name: one.value for name, one in fit.wait(progress=False).parameters.items()}
        return ", ".join(f"{name} = {value:.4g}" for name, value in self.found.items())

    def validate(self) -> str:
        """Validate the model."""
        reply = self.client.validate(MOTOR, dataset=self.recording, parameters=self.found, **SIGNALS)
        return f"{reply.verdict}, relative error {reply.outputs['velocity'].relative_error_percent:.3g} %"

    def limit(self) -> str:
        """Find what limits the bandwidth."""
        asked = {"input": "reference", "output": "position", "from_": "reference", "to": "position"}
        levers = ["K", "Kh", "J", "B"]
        reply = self.client.influence(self.axis, parameters=levers, metrics=["bandwidth"], **asked)
        return f"{reply.strongest.by_metric['bandwidth']} moves it most"

    def export(self) -> str:
        """Export the numbers to pandas."""
        table = self.both.to_pandas()
        table.to_csv(self.folder / "curves.csv")
        return f"{len(table)} rows, {len(table.columns)} column"

    def plot(self) -> str:
        """Plot them, as in a notebook."""
        axes = self.both.plot()
        axes[0].figure.savefig(self.folder / "curves.png")
        return f"{len(axes)} diagram"

    def nightly(self) -> str:
        """Schedule the search for every night."""
        request = self.search.request()
        made = self.client.schedules.create(
            f"{NAME}: every night", cron="30 2 * * *", kind="optimization", body=request
        )
        return f"next at {made.next_at}"

    def last_week(self) -> str:
        """Find last week's result."""
        week = datetime.now(UTC) - timedelta(days=7)
        found = self.client.jobs.list(kind="optimization", status="succeeded", since=week)
        mine = next(job for job in found if job.request()["system"]["name"] == NAME)
        return ", ".join(f"{name} = {value:.4g}" for name, value in mine.result().best.items())


TASKS = (
    Work.new_system, Work.tune, Work.compare, Work.identify, Work.validate, Work.limit, Work.export, Work.plot, Work.nightly,
    Work.last_week,
)  # fmt: skip


def record(client: servotune.Client, path: Path) -> None:
    """Write what a measurement of the motor would have written: 4 s of a chirp, J = 1 kg m², B = 1 N m s, noise of 1 %."""
    chirp = {"kind": "chirp", "amplitude": 1, "start_frequency": 0.5, "end_frequency": 30, "duration": 4}
    torque = {**MOTOR, "outputs": {"torque": "torque", "velocity": MOTOR["outputs"]["velocity"]}}
    noise = random.Random(5)  # noqa: S311 -- noise, no secret
    move = {"port": "torque", "signal": chirp}
    reply = client.simulate(torque, input=move, duration=4.0, samples=2001, metrics=[], variants=[{"J": 1, "B": 1}])
    rows = zip(reply.time, reply.outputs["torque"], reply.outputs["velocity"], strict=True)
    lines = [f"{t:.6f},{u:.9g},{v + noise.gauss(0, 5e-3):.9g}" for t, u, v in rows]
    path.write_text("\n".join(["time [s],torque [N*m],velocity [rad/s]", *lines, ""]))


def lines_of(task: Callable[[Work], str]) -> int:
    """Return how many lines a task has, without its first one, its docstring and what it tells."""
    (function,) = ast.parse(textwrap.dedent(inspect.getsource(task))).body
    assert isinstance(function, ast.FunctionDef)
    return sum((one.end_lineno or one.lineno) - one.lineno + 1 for one in function.body[1:-1])


def run(client: servotune.Client) -> None:
    """Do the ten tasks and print what each took."""
    with tempfile.TemporaryDirectory() as folder:
        work = Work(client, Path(folder))
        record(client, Path(folder) / "run 1.csv")
        for number, task in enumerate(TASKS, 1):
            begin = time.perf_counter()
            told = task(work)
            taken = time.perf_counter() - begin
            title = (task.__doc__ or "").rstrip(".")
            print(f"{number:>2}. {title}: {lines_of(task)} lines, {taken:.2f} s\n    {told}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--key", required=True)
    options = parser.parse_args(arguments)
    try:
        with servotune.connect(options.url, key=options.key) as client:
            run(client)
    except servotune.ServotuneError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
