"""300 simulated tests of plants whose parameters are known: what labs record, good and bad, from 500 to 500,000 samples.

    G(s) = k e^(-s L) / ((T s + 1) (s²/w² + 2 d s/w + 1)),   of order 1 without the second factor, of order 2 without the first

Computed without the engine: the modes of G one by one, from sample to sample, under an input that is held and arrives L later, between
two samples. Each of 30 kinds (order, delay, signal) is recorded ten times: five good ones, then outliers, a clipped sensor, a
wrong sign, a wrong unit, and a fault by another method.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.signal import chirp, lfilter

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.between_samples import BetweenSamples
from optimizers.problem import Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording

Signal = npt.NDArray[np.float64]

SIGNALS: Final = ("one step", "several steps", "chirp", "multisine", "closed loop")
TREATMENTS: Final = (
    ("", "told"), ("", "auto"), ("", "told"), ("", "offsets"), ("", "transfer_function"), ("outliers", "auto"),
    ("saturation", "told"), ("sign", "auto"), ("unit", "told"), ("outliers", "transfer_function"),
)  # fmt: skip
"""What is wrong with the recording, and how it is identified."""
CASES: Final = 300


@dataclass(frozen=True, kw_only=True)
class Case:
    """One recording and the plant behind it."""

    number: int
    order: int
    signal: str
    fault: str
    way: str
    samples: int
    sample_time: float
    truth: dict[str, float]
    u: Signal
    y: Signal
    clean: Signal | None = None
    """The output without noise; None in a closed loop, which feeds the noise back."""


def case(number: int) -> Case:
    """Return one of the 300 cases; the same one every time."""
    rng = np.random.default_rng([29, number])
    order, delayed, signal = list(product((1, 2, 3), (False, True), SIGNALS))[number // len(TREATMENTS)]
    fault, way = TREATMENTS[number % len(TREATMENTS)]
    samples = round(math.exp(rng.uniform(math.log(500), math.log(500_000))))
    slowest = 0.05 * 10 ** rng.uniform(0, 1)
    truth = {"k": rng.uniform(0.5, 5.0)}
    if order != 2:
        truth["T"] = slowest * (1.0 if order == 1 else rng.uniform(0.5, 1.5))
    if order > 1:
        truth |= {"w": 1 / slowest, "d": rng.uniform(0.3, 0.8)}
    if delayed:
        truth["L"] = slowest * rng.uniform(0.1, 0.5)
    if signal == "one step":
        h = slowest * rng.uniform(10.0, 40.0) / samples
    else:
        h = slowest / math.exp(rng.uniform(math.log(5.0), math.log(max(6.0, samples / 30))))
    plant = _Modes(truth, h)
    noise = rng.uniform(0.01, 0.1)
    if signal == "closed loop":
        u, y = _in_a_loop(plant, slowest, samples, noise, rng)
        clean = None
    else:
        u = _moving(signal, slowest, samples, h, rng)
        clean = plant.answer(u)
        y = clean + noise * clean.std() * rng.normal(size=samples)
    return Case(
        number=number, order=order, signal=signal, fault=fault, way=way, samples=samples, sample_time=h, truth=truth, u=u,
        y=_spoilt(y, fault, rng), clean=clean,
    )  # fmt: skip


def problem(one: Case) -> Identification:
    """Return the question that a user of the plant's structure asks, begun within a factor of two."""
    rng = np.random.default_rng([30, one.number])
    starts = {name: value * 2 ** rng.uniform(-1, 1) for name, value in one.truth.items()}
    diagram = structure(one.order, starts)
    return Identification(
        diagram=diagram,
        experiments=(experiment(one),),
        parameters=tuple(Variable(parameter=name) for name in one.truth),
        offsets=one.way == "offsets",
    )


def experiment(one: Case) -> RecordedExperiment:
    """Return the recording; a held input, or one of which nobody knows it."""
    told = {} if one.way in {"auto", "offsets"} else {"u": BetweenSamples.HOLD}
    recording = Recording(
        inputs={"u": one.u}, outputs={"y": one.y}, sample_time=one.sample_time, between_samples=told,
        undecided=() if told else ("u",),
    )  # fmt: skip
    return RecordedExperiment(recording=recording, split=0.7 if one.way == "transfer_function" else 1.0)


def structure(order: int, values: dict[str, float]) -> Diagram:
    """Return the plant as a diagram."""
    denominator: dict[int, list[float | str]] = {
        1: ["=T", 1.0], 2: ["=1/w**2", "=2*d/w", 1.0], 3: ["=T/w**2", "=2*d*T/w+1/w**2", "=T+2*d/w", 1.0],
    }  # fmt: skip
    blocks = {
        "u": Block(kind="input"),
        "plant": Block(kind="transfer_function", values={"numerator": ["=k"], "denominator": denominator[order]}),
    }
    wires = [Connection(source="u", target="plant")]
    if "L" in values:
        blocks["late"] = Block(kind="delay", values={"time": "=L"})
        wires.append(Connection(source="plant", target="late"))
    return compile_system(
        System(
            name="plant",
            parameters={
                name: Parameter(value=value, lower=0.0 if name == "L" else value / 100, upper=100 * value)
                for name, value in values.items()
            },
            blocks=blocks,
            connections=tuple(wires),
            outputs={"y": "late" if "L" in values else "plant"},
        )
    )


class _Modes:
    """G as a sum of modes r/(s - p): held inputs, exactly, the delay between two samples included."""

    def __init__(self, truth: dict[str, float], h: float) -> None:
        w, d, time = truth.get("w"), truth.get("d", 1.0), truth.get("T")
        poles = [] if w is None else list(np.roots([1 / w**2, 2 * d / w, 1.0]))
        self.poles = np.array([*poles, *([] if time is None else [-1 / time])], dtype=complex)
        self.gain, self.h = truth["k"], h
        others = [np.prod(1 - p / np.delete(self.poles, i)) for i, p in enumerate(self.poles)]
        self.parts = self.gain / np.array(others)  # of the static gain
        self.whole, rest = divmod(truth.get("L", 0.0) / h, 1.0)
        self.whole = int(self.whole)
        self.advance = np.exp(self.poles * h)
        # from the arrival to the next sample with the new value, until there with the one before
        late = np.exp(self.poles * h * (1 - rest))
        self.new, self.old = 1 - late, late - self.advance

    def answer(self, u: Signal) -> Signal:
        moved = np.concatenate([np.zeros(self.whole + 1), (u - u[0])])[: u.size]
        before = np.concatenate([[0.0], moved])[: u.size]
        y = np.full(u.size, self.gain * u[0])
        for part, advance, new, old in zip(self.parts, self.advance, self.new, self.old, strict=True):
            y += (part * lfilter([1.0], [1.0, -advance], new * moved + old * before)).real
        return y


def _moving(signal: str, slowest: float, samples: int, h: float, rng: np.random.Generator) -> Signal:
    time = h * np.arange(samples)
    if signal == "one step":
        return np.where(np.arange(samples) >= rng.integers(samples // 50, samples // 4), rng.uniform(0.5, 3.0), 0.0)
    if signal == "several steps":
        return _levels(slowest, samples, h, rng)
    if signal == "chirp":
        fastest = min(0.6 / slowest, 0.2 / h)
        return np.asarray(chirp(time, 0.01 / slowest, time[-1], fastest, phi=-90))
    lines = np.unique(np.round(np.geomspace(1, 24, 10))) / (40 * slowest)
    phases = rng.uniform(0, 2 * math.pi, size=lines.size)
    return np.asarray(np.sin(2 * math.pi * lines[:, None] * time + phases[:, None]).sum(axis=0))


def _levels(slowest: float, samples: int, h: float, rng: np.random.Generator) -> Signal:
    """Return steps of random size, each kept for one to four times the slowest time, from rest."""
    kept = np.maximum((slowest * rng.uniform(1, 4, size=1 + samples) / h).astype(int), 1)
    count = int(np.searchsorted(np.cumsum(kept), samples)) + 1
    levels = np.append(0.0, rng.normal(size=count - 1))
    return np.repeat(levels, kept[:count])[:samples]


def _in_a_loop(
    plant: _Modes, slowest: float, samples: int, noise: float, rng: np.random.Generator
) -> tuple[Signal, Signal]:
    """Return the command of a PI controller whose reference moves in steps, and what it measures."""
    reference = _levels(4 * slowest, samples, plant.h, rng)
    proportional, integral = 0.3 / plant.gain, 0.15 * plant.h / (plant.gain * slowest)
    errors = noise * rng.normal(size=samples)
    u, y = [0.0] * samples, [0.0] * samples
    modes = list(
        zip((plant.parts).tolist(), plant.advance.tolist(), plant.new.tolist(), plant.old.tolist(), strict=True)
    )
    states, total, late = [0j] * len(modes), 0.0, plant.whole
    for k in range(samples):
        new = u[k - 1 - late] if k - 1 - late >= 0 else 0.0
        old = u[k - 2 - late] if k - 2 - late >= 0 else 0.0
        value = 0.0
        for i, (part, advance, fresh, stale) in enumerate(modes):
            states[i] = advance * states[i] + fresh * new + stale * old
            value += (part * states[i]).real
        y[k] = value + errors[k]
        error = reference[k] - y[k]
        total += integral * error
        u[k] = proportional * error + total
    return np.array(u), np.array(y)


def _spoilt(y: Signal, fault: str, rng: np.random.Generator) -> Signal:
    if fault == "outliers":
        apart = rng.choice(y.size, size=max(2, y.size // 2000), replace=False)
        y = y.copy()
        y[apart] += 4 * y.std() * rng.choice([-1.0, 1.0], size=apart.size) * rng.uniform(0.8, 1.5, size=apart.size)
    elif fault == "saturation":
        low, high = float(y.min()), float(y.max())
        return np.clip(y, low + 0.15 * (high - low), high - 0.25 * (high - low))
    elif fault == "sign":
        return -y
    elif fault == "unit":
        return 1000.0 * y
    return y
