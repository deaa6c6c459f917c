"""Every element and signal keeps the promises that the API, the docs and the engine rely on."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import engine.elements
import engine.signals
from api.units.conversion import factor
from engine.elements import Element, Realization
from engine.elements._nonlinear import Moment, NonlinearElement
from engine.model.parameters import Param
from engine.signals import Signal, make

ELEMENTS = engine.elements.catalogue()
SIGNALS = engine.signals.catalogue()
STEP = 1e-30
ARRAYS = ("a", "b", "c", "d", "delays", "d12", "d21", "initial")


def files_of(package: Any) -> set[str]:
    return {path.stem for path in Path(package.__path__[0]).glob("*.py") if not path.stem.startswith("_")}


def example(element: type[Element]) -> dict[str, Any]:
    return {param.name: param.default for param in element.parameters} | dict(element.example)


def test_one_file_is_one_element():
    assert {kind: element.__module__ for kind, element in ELEMENTS.items()} == {
        name: f"engine.elements.{name}" for name in files_of(engine.elements)
    }


def test_one_file_is_one_signal():
    assert {kind: signal.__module__ for kind, signal in SIGNALS.items()} == {
        name: f"engine.signals.{name}" for name in files_of(engine.signals)
    }


@pytest.mark.parametrize("entry", [*ELEMENTS.values(), *SIGNALS.values()], ids=lambda entry: entry.kind)
def test_words(entry):
    assert entry.title[0].isupper()
    assert len(entry.title) <= 40
    assert entry.equation
    assert entry.source.endswith(".")
    assert entry.__doc__
    names = [param.name for param in entry.parameters]
    assert len(set(names)) == len(names)
    assert set(entry.example) <= set(names)


@pytest.mark.parametrize(
    "param",
    [pytest.param(p, id=f"{e.kind}.{p.name}") for e in (*ELEMENTS.values(), *SIGNALS.values()) for p in e.parameters],
)
def test_parameters(param: Param):
    assert param.symbol
    assert len(param.doc) > 5
    assert not param.doc.endswith(".")
    assert param.lower <= param.upper
    assert param.shape == "text" or not param.choices
    if param.shape == "scalar" and param.default is not None:
        assert isinstance(param.default, float)
        assert param.admits(param.default)
    if param.choices and param.default is not None:
        assert param.default in param.choices
    assert "Hz" not in param.unit
    assert param.unit in ("", "1") or factor(param.unit, param.unit) == 1


@pytest.mark.parametrize("element", ELEMENTS.values(), ids=ELEMENTS)
def test_realization_fits_the_ports(element: type[Element]):
    values = example(element)
    element.check(frozenset(element.example), values)
    ports, r = element.ports(values), element.realize(values)
    n, m = len(r.a), len(r.delays)
    assert r.a.shape == (n, n)
    assert r.b.shape == (n, len(ports.inputs))
    assert r.c.shape == (len(ports.outputs), n)
    assert r.d.shape == (len(ports.outputs), len(ports.inputs))
    assert len(ports.output_units) == len(ports.outputs)
    assert (r.d12 is None, r.d21 is None) == (m == 0, m == 0)
    assert all(array.dtype == np.float64 and np.isfinite(array).all() for array in coefficients(r).values())


def coefficients(r: Realization) -> dict[str, np.ndarray]:
    return {name: getattr(r, name) for name in ARRAYS if getattr(r, name) is not None}


def laws(element: type[NonlinearElement], values: dict[str, Any], *, deciding: bool = True) -> dict[str, np.ndarray]:
    """Return what a nonlinear element computes in each of its modes, at one arbitrary moment.

    Where it decides, as at samples, all lanes follow the first: they share their real part.
    """
    values = {name: v[:, None] if isinstance(v, np.ndarray) else v for name, v in values.items()}
    ports = element.ports(values)

    def signals(count: int, scale: float) -> list[np.ndarray]:
        return [np.full((1, 1), scale * (0.7 + 0.31 * k)) for k in range(count)]

    states = [np.full((1, 1), 1.02 * float(v)) for v in element.initial(example(element))]
    m = Moment(
        t=np.full((1, 1), 0.4),
        x=[given if np.any(given) else probe for given, probe in zip(states, signals(len(states), 0.5), strict=True)],
        z=signals(len(ports.inputs), 0.9), slope=signals(len(ports.inputs), -0.3), y=signals(len(ports.outputs), 0.6),
    )  # fmt: skip
    period = element.period(values)
    found = {
        "initial": element.initial(values),
        "sampling": [] if period is None else [period, element.latency(values), element.offset(values)],
    }
    if period is not None and deciding:
        found["sampled"], found["unrest"] = element.sample(m, 0, values), element.unrest(m, 0, values)
    found["limits"] = [limit for pair in element.limits(values) for limit in pair if np.isfinite(limit).all()]
    for mode in element.modes:
        found[f"rates {mode}"] = element.rates(m, mode, values)
        found[f"outputs {mode}"] = element.outputs(m, mode, values)
        found[f"guards {mode}"] = element.guards(m, mode, values)
        for guard in range(len(found[f"guards {mode}"])):
            found[f"after {guard} of {mode}"] = element.switch(guard, m, mode, values).x or []
    return {f"{name} {k}": np.asarray(v).ravel() for name, entries in found.items() for k, v in enumerate(entries)}


def computed(element: type[Element], values: dict[str, Any], *, deciding: bool = True) -> dict[str, np.ndarray]:
    if issubclass(element, NonlinearElement):
        return laws(element, values, deciding=deciding)
    return coefficients(element.realize(values))


@pytest.mark.parametrize(
    "element", [e for e in ELEMENTS.values() if issubclass(e, NonlinearElement)], ids=lambda e: e.kind
)
def test_a_law_fits_the_ports(element: type[NonlinearElement]):
    values = example(element)
    ports = element.ports(values)
    count = len(element.initial(values))
    assert len(element.states) in {0, count}
    assert element.feed_through(values).shape == (len(ports.outputs), len(ports.inputs))
    found = laws(element, values)
    for mode in element.modes:
        assert sum(name.startswith(f"rates {mode} ") for name in found) == count
        assert sum(name.startswith(f"outputs {mode} ") for name in found) == len(ports.outputs)
    assert all(np.isfinite(array).all() for array in found.values())


SCALARS = [
    pytest.param(element, param.name, id=f"{element.kind}.{param.name}")
    for element in ELEMENTS.values()
    for param in element.parameters
    if param.shape == "scalar" and element.law(frozenset({param.name})) is element  # limits make another law of it
]


def varied(element: type[Element], name: str) -> tuple[dict[str, Any], float]:
    """Return the example with ``name`` present and not 0, what it needs beside it, alternatives left out, and its value."""
    values = example(element)
    alternatives = {
        "integral_time": ("ki",), "derivative_time": ("kd",), "time_constant": ("natural_frequency", "damping_ratio"),
    }  # fmt: skip
    for other in values.keys() & set(alternatives.get(name, ())):
        values[other] = next(p.default for p in element.parameters if p.name == other)
    lead = {"design": "lead_lag", "frequency": None, "zero_frequency": 20.0, "pole_frequency": 180.0}
    needs = {
        ("ball_screw", "damping"): {"stiffness": 1e8},
        ("sampled_pid", "tracking_time"): {"upper": 1.0, "anti_windup": "back_calculation"},
    } | {("discrete_filter", own): lead for own in ("gain", "zero_frequency", "pole_frequency")}  # fmt: skip
    value = values[name] or 0.7
    return values | needs.get((element.kind, name), {}) | {name: value}, value


@pytest.mark.parametrize(("element", "name"), SCALARS)
def test_the_infinitesimal_of_a_parameter_is_the_derivative_of_its_coefficients(element: type[Element], name: str):
    values, value = varied(element, name)
    stepped = computed(element, values | {name: value * (1 + STEP * 1j)})
    h = 1e-5
    up, down = (computed(element, values | {name: value * (1 + sign * h)}) for sign in (1, -1))
    changed = 0
    for key, array in stepped.items():
        difference = (up[key] - down[key]) / (2 * h)
        np.testing.assert_allclose(
            array.imag / STEP,
            difference,
            rtol=1e-7,
            atol=1e-9 * max(1e-300, abs(difference).max(initial=0)) + 1e-10 * abs(up[key]).max(initial=0),
        )
        changed += int(np.count_nonzero(array.imag))
    assert changed, f"{name} moves no coefficient"


@pytest.mark.parametrize(("element", "name"), SCALARS)
def test_a_batch_of_a_parameter_is_its_single_values(element: type[Element], name: str):
    values, value = varied(element, name)
    batch = computed(element, values | {name: value * np.array([1.0, 1.5])}, deciding=False)
    for member, scaled in enumerate((value, 1.5 * value)):
        for key, array in computed(element, values | {name: scaled}, deciding=False).items():
            picked = batch[key][member] if batch[key].size > array.size else batch[key]
            np.testing.assert_allclose(picked, array, rtol=1e-14)


@pytest.mark.parametrize("signal", SIGNALS.values(), ids=SIGNALS)
def test_signals_know_where_they_break_and_end(signal: type[Signal]):
    made = make(signal.kind, signal.example)
    points = made.breakpoints()
    assert points
    assert list(points) == sorted(set(points))
    assert points[0] >= 0
    times = np.linspace(0.0, 30.0, 1001)
    values = made.value(times)
    assert values.dtype == np.float64
    assert values.shape == times.shape
    assert np.isfinite(values).all()
    end, final = made.end(), made.final()
    assert (end is None) == (final is None)
    if end is not None:
        assert final is not None
        assert np.all(made.value(end + np.array([0.0, 1.0, 1e3])) == final)
    degree = made.degree()
    if degree is not None:
        assert degree >= 0
        edges = [*points, points[-1] + 1.0]
        for left, right in itertools.pairwise(edges):
            # A polynomial of that degree has no higher differences.
            inside = made.value(np.linspace(left, math.nextafter(right, left), 9))
            np.testing.assert_allclose(np.diff(inside, n=degree + 1), 0.0, atol=1e-9)
