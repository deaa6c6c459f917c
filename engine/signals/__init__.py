"""The catalogue of command signals: one file is one signal, found by looking into this folder."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from engine.model.errors import SignalError
from engine.signals._base import Signal, checked

__all__ = ["Signal", "catalogue", "changed", "make"]


@cache
def catalogue() -> Mapping[str, type[Signal]]:
    """Return every kind of signal by name, in alphabetical order."""
    found: dict[str, type[Signal]] = {}
    for name in sorted(module.name for module in pkgutil.iter_modules(__path__) if not module.name.startswith("_")):
        module = importlib.import_module(f"{__name__}.{name}")
        for signal in vars(module).values():
            if isinstance(signal, type) and issubclass(signal, Signal) and signal.__module__ == module.__name__:
                found[signal.kind] = signal
    return MappingProxyType(found)


def make(kind: str, parameters: Mapping[str, Any] | None = None) -> Signal:
    """Return a signal with checked parameters (SI).

    Raises
    ------
    SignalError
        If the kind is unknown or a parameter is wrong; ``at`` counts from the signal.

    Examples
    --------
    >>> import numpy as np
    >>> make("step", {"amplitude": 2.0, "start": 1.0}).value(np.array([0.0, 1.0])).tolist()
    [0.0, 2.0]
    """
    signal = catalogue().get(kind)
    if signal is None:
        raise SignalError(f"kind must be one of {', '.join(catalogue())}, got '{kind}'", at=("kind",))
    given = dict(parameters or {})
    for name in (param.name for param in signal.parameters if param.shape == "signal"):
        if isinstance(given.get(name), Mapping):
            given[name] = _inner(name, given[name])
    return signal.of(checked(signal.parameters, kind, given))


def _inner(name: str, document: Mapping[str, Any]) -> Signal:
    """Return the command that a signal is made of."""
    if not isinstance(document.get("kind"), str):
        raise SignalError(f"{name} must have a kind, one of {', '.join(catalogue())}, got none", at=(name, "kind"))
    try:
        return make(document["kind"], {key: value for key, value in document.items() if key != "kind"})
    except SignalError as error:
        raise error.within(name) from None


def changed(signal: Signal, path: str, value: Any) -> Signal:
    """Return a signal with another value of one parameter; ``command.max_velocity`` is one of the inner command's.

    Raises
    ------
    SignalError
        If there is no such parameter, or the value is wrong; ``at`` counts from the signal.
    """
    name, _, rest = path.partition(".")
    values = {param.name: getattr(signal, param.name) for param in signal.parameters}
    if rest:
        inner = values.get(name)
        if not isinstance(inner, Signal):
            held = ", ".join(key for key, held in values.items() if isinstance(held, Signal)) or "(none)"
            raise SignalError(f"{name} must be a command inside {signal.kind} ({held}), got '{path}'", at=(name,))
        try:
            value = changed(inner, rest, value)
        except SignalError as error:
            raise error.within(name) from None
    return make(signal.kind, {**values, name: value})
