"""Command signals of documents as signals of the core."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from api.convert.values import nested_si, si
from api.problems.documents import at, invalid
from api.problems.pointers import Place
from api.schemas.signals import MOST_POINTS, InputDocument, SampledSignal
from engine.analysis.commanded import CommandParameter
from engine.diagram.diagram import Diagram
from engine.model.errors import SignalError
from engine.signals import Signal, catalogue, changed, make

Channel = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
"""Time (s, from 0) and values (SI) of a recorded channel."""
ReadChannel = Callable[[str, str, Place], Channel]
"""Reads (dataset, channel); the place is where the request names them."""

_HEIGHTS = frozenset({"amplitude", "distance"})
"""Parameters of commands in the unit of the input that they drive."""


def signal_from_wire(document: Any, *, place: Place, read_channel: ReadChannel, unit: str = "") -> Signal:
    """Return the signal of the core; ``unit`` is that of the input that it drives, "" where it is not known.

    Raises
    ------
    Problem
        422 with the place of a parameter that is missing, out of bounds or in a wrong unit.
    """
    given = document.model_dump(exclude_unset=True, exclude={"kind"})
    if isinstance(document, SampledSignal) and document.dataset is not None and document.channel is not None:
        time, values = read_channel(document.dataset, document.channel, place)
        if values.size > MOST_POINTS:
            raise invalid(
                f"a sampled command must be at most {MOST_POINTS} points, got {values.size} (to compare a model with "
                "a whole recording, ask for a validation)",
                *place,
                "channel",
            )
        given = {"time": time, "values": values, "between_samples": document.between_samples}
    else:
        params = {param.name: param for param in catalogue()[document.kind].parameters}
        given = {
            name: signal_from_wire(getattr(document, name), place=(*place, name), read_channel=read_channel, unit=unit)
            if params[name].shape == "signal"
            else nested_si(value, unit if name in _HEIGHTS else params[name].unit, name=name, place=(*place, name))
            for name, value in given.items()
        }
    with at(*place):
        return make(document.kind, given)


def signals_from_wire(
    documents: InputDocument | Sequence[InputDocument], diagram: Diagram, *, place: Place, read_channel: ReadChannel
) -> dict[str, Signal]:
    """Return input port -> signal, every port checked against the diagram.

    Raises
    ------
    Problem
        422 for a port that is not there or commanded twice, or a wrong signal.
    """
    single = isinstance(documents, InputDocument)
    listed = [documents] if isinstance(documents, InputDocument) else list(documents)
    signals: dict[str, Signal] = {}
    for i, document in enumerate(listed):
        here = place if single else (*place, i)
        check_name(document.port, diagram.inputs, name="port", what="the system's inputs", place=(*here, "port"))
        if document.port in signals:
            raise invalid(f"port must be commanded once, got {document.port!r} twice", *here, "port")
        signals[document.port] = signal_from_wire(
            document.signal, place=(*here, "signal"), read_channel=read_channel,
            unit=diagram.references.input_units.get(document.port, ""),
        )  # fmt: skip
    return signals


def check_name(given: str, allowed: Sequence[str], *, name: str, what: str, place: Place) -> None:
    """Refuse a name that is not one of those that exist."""
    if given not in allowed:
        raise invalid(f"{name} must be one of {what} ({', '.join(allowed)}), got {given!r}", *place)


def is_command_path(path: str, diagram: Diagram) -> bool:
    """Say whether a path names a command's parameter (``signals.port.delay``) and none of the system's."""
    return path.startswith("signals.") and path not in diagram.parameters


def changed_signals(given: Mapping[str, Any], signals: Mapping[str, Signal], *, place: Place) -> dict[str, Signal]:
    """Return the commands with other values of some of their parameters.

    Parameters
    ----------
    given : mapping
        ``signals.<port>.<parameter>`` -> number or quantity; ``signals.reference.command.start`` is one of the command
        that the one at ``reference`` is made of.

    Raises
    ------
    Problem
        422 at a path that leads nowhere, or for a value that the command refuses.
    """
    found = dict(signals)
    for path, value in given.items():
        here = (*place, path)
        port, name = _command_place(path, found, place=here)
        try:
            number = si(value, unit_of_parameter(found[port], name), name=path, place=here)
            found[port] = changed(found[port], name, number)
        except SignalError as error:
            raise invalid(error.message, *here) from error
    return found


def command_parameter(path: str, signals: Mapping[str, Signal], *, place: Place) -> CommandParameter:
    """Return the number of a command that ``signals.<port>.<parameter>`` names.

    Raises
    ------
    Problem
        422 at a path that leads to no number.
    """
    port, name = _command_place(path, signals, place=place)
    try:
        return CommandParameter(signal=signals[port], path=name)
    except SignalError as error:
        raise invalid(error.message, *place) from error


def _command_place(path: str, signals: Mapping[str, Signal], *, place: Place) -> tuple[str, str]:
    """Return port and parameter of a command's path."""
    _, port, name = (*path.split(".", 2), "")[:3]
    check_name(port, tuple(signals), name="port", what="those that are commanded", place=place)
    return port, name


def unit_of_parameter(signal: Signal, path: str) -> str:
    """Return the unit of a command's parameter, "" where there is none of that name."""
    name, _, rest = path.partition(".")
    inner = getattr(signal, name, None)
    if rest and isinstance(inner, Signal):
        return unit_of_parameter(inner, rest)
    return next((param.unit for param in signal.parameters if param.name == path), "")
