"""What was recorded around a system, by the names of its diagram."""

from __future__ import annotations

from collections.abc import Mapping

from api.convert.signals import check_name
from api.pointers import Place
from api.problems import invalid
from api.services.datasets import read_recording
from api.units import UnitError, factor
from engine.diagram import Diagram
from optimizers.recording import Recording
from storage.session import Database


def recording_of(
    dataset: str,
    inputs: Mapping[str, str],
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
        Port of the diagram -> channel.
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
    for key, given, known, what in (
        ("inputs", inputs, diagram.inputs, "the system's inputs"),
        ("outputs", outputs, diagram.outputs, "the system's outputs"),
    ):
        for name, channel in given.items():
            check_name(name, known, name=key.removesuffix("s"), what=what, place=(*place, key, name))
            names[*place, key, name] = channel
    read = read_recording(database, workspace, dataset, names, place=(*place, "dataset"))
    check_lengths({channel: read.channels[channel].size for channel in names.values()}, names)
    for name, channel in outputs.items():
        expected, unit = diagram.output_units.get(name, ""), read.units[channel]
        try:
            if expected and unit:
                factor(unit, expected)
        except UnitError as error:
            raise invalid(
                f"channel {channel!r} must measure output {name} in a unit of {expected}, got {unit}",
                *place, "outputs", name,
            ) from error  # fmt: skip
    return Recording(
        inputs={name: read.channels[channel] for name, channel in inputs.items()},
        outputs={name: read.channels[channel] for name, channel in outputs.items()},
        sample_time=read.sample_time,
    )


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
