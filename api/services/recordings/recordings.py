"""What was recorded around a system, by the names of its diagram."""

from __future__ import annotations

from collections.abc import Mapping

from api.convert.signals import check_name
from api.problems.documents import invalid
from api.problems.pointers import Place
from api.schemas.jobs import RecordedInput
from api.services.recordings.datasets import read_recording
from api.units.conversion import UnitError, factor
from engine.diagram.diagram import Diagram
from engine.model.between_samples import BetweenSamples
from optimizers.recorded.recording import Recording
from storage.session import Database


def recording_of(
    dataset: str,
    inputs: Mapping[str, str | RecordedInput],
    outputs: Mapping[str, str],
    diagram: Diagram,
    *,
    database: Database,
    workspace: str,
    place: Place = (),
) -> Recording:
    """Return the recorded inputs and outputs in SI.

    Parameters
    ----------
    dataset : str
    inputs, outputs : mapping
        Port of the diagram -> channel; what an input does between its samples is tried out where it is not said.
    diagram : Diagram
    place : tuple
        Of the document that names them all, in the request.

    Raises
    ------
    Problem
        422 at a port, channel or dataset that does not exist, at samples that are missing, at a channel that measures
        something else than the output is; 409 for a dataset not ready.
    """
    names: dict[Place, str] = {}
    driving = {name: given if isinstance(given, str) else given.channel for name, given in inputs.items()}
    ways = {name: "auto" if isinstance(given, str) else given.between_samples for name, given in inputs.items()}
    for key, given, known, what in (
        ("inputs", driving, diagram.inputs, "the system's inputs"),
        ("outputs", outputs, diagram.outputs, "the system's outputs"),
    ):
        for name, channel in given.items():
            check_name(name, known, name=key.removesuffix("s"), what=what, place=(*place, key, name))
            names[*place, key, name] = channel
    read = read_recording(database, workspace, dataset, names, place=(*place, "dataset"))
    check_lengths({channel: read.channels[channel].size for channel in names.values()}, names)
    for key, channels, units in (
        ("inputs", driving, diagram.references.input_units),
        ("outputs", outputs, diagram.output_units),
    ):
        for name, channel in channels.items():
            check_unit(read.units[channel], units.get(name, ""), channel=channel, port=(key, name), place=place)
    return Recording(
        inputs={name: read.channels[channel] for name, channel in driving.items()},
        outputs={name: read.channels[channel] for name, channel in outputs.items()},
        sample_time=read.sample_time,
        between_samples={name: BetweenSamples(way) for name, way in ways.items() if way != "auto"},
        undecided=tuple(name for name, way in ways.items() if way == "auto"),
    )


def check_unit(unit: str, expected: str, *, channel: str, port: tuple[str, str], place: Place = ()) -> None:
    """Refuse a channel that measures something else than its port (``inputs`` or ``outputs``, and its name) is.

    Nothing is said where one of the units is not known.

    Raises
    ------
    Problem
        422 at the port.
    """
    key, name = port
    try:
        if expected and unit:
            factor(unit, expected)
    except UnitError as error:
        raise invalid(
            f"channel {channel!r} must measure {key.removesuffix('s')} {name} in a unit of {expected}, got {unit}",
            *place,
            key,
            name,
        ) from error


def check_lengths(sizes: Mapping[str, int], names: Mapping[Place, str]) -> None:
    """Refuse channels of different length: their samples do not belong to the same instants.

    Parameters
    ----------
    sizes : mapping
        Channel -> number of samples.
    names : mapping
        Place in the request -> channel.

    Raises
    ------
    Problem
        422 at the first channel that differs from the one named first.
    """
    first = next(iter(names.values()))
    for place, channel in names.items():
        if sizes[channel] != sizes[first]:
            raise invalid(
                f"channel {channel!r} must have {sizes[first]} samples as {first!r} has, got {sizes[channel]} "
                "(bring them to one rate and one stretch first)",
                *place,
            )
