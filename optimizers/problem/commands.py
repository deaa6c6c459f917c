"""Numbers of commands as variables: ``signals.<experiment>.<port>.<parameter>``, of one experiment's command only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from engine.analysis.commanded import CommandParameter
from engine.model.parameters import ParameterInfo
from engine.signals import Signal, changed

if TYPE_CHECKING:
    from optimizers.problem import Experiment

Commands = Mapping[str, Signal]
"""Port -> command."""

PREFIX = "signals."


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandPath:
    """Where a command's number is: in which experiment, at which port, under which name."""

    experiment: str
    port: str
    parameter: str

    @classmethod
    def of(cls, path: str, experiments: Sequence[Experiment]) -> CommandPath | None:
        """Return the place that a path names, None where it names none."""
        for experiment in experiments:
            for port in experiment.signals:
                prefix = f"{PREFIX}{experiment.name}.{port}."
                if path.startswith(prefix):
                    return cls(experiment=experiment.name, port=port, parameter=path.removeprefix(prefix))
        return None


def info_of(path: str, place: CommandPath, experiments: Sequence[Experiment]) -> ParameterInfo:
    """Return what is known of a command's number.

    Raises
    ------
    SignalError
        If the command has no such number.
    """
    signal = next(e for e in experiments if e.name == place.experiment).signals[place.port]
    found = CommandParameter(signal=signal, path=place.parameter)
    param = found.param
    return ParameterInfo(
        path=path,
        value=found.value,
        unit=param.unit,
        lower=param.lower,
        upper=param.upper,
        scale=param.scale,
        doc=param.doc,
        bound=False,
        lower_open=param.lower_open,
    )


def commands_at(
    values: Mapping[str, float], places: Mapping[str, CommandPath], experiments: Sequence[Experiment]
) -> dict[str, Commands]:
    """Return experiment -> its commands at these values; values of other paths are passed over.

    Raises
    ------
    SignalError
        If a command refuses its value.
    """
    found: dict[str, dict[str, Signal]] = {experiment.name: dict(experiment.signals) for experiment in experiments}
    for path, place in places.items():
        if path in values:
            commands = found[place.experiment]
            commands[place.port] = changed(commands[place.port], place.parameter, values[path])
    return dict(found)
