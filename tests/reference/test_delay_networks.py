"""Random blocks of several ports whose delayed outputs come back to their inputs: several delays in several nested loops.

    x' = A x + B u,  z = C x + D u,  u = K w + e r,  w_i(t) = z_i(t - d_i h)

The curve is compared with the method of steps by Taylor series: on each interval of h a delayed signal is the very series that
entered its delay, so that nothing is interpolated; 60 digits. Stability is compared with the argument principle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import settings

from engine.analysis.study import frequency_response, simulate
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from tests.reference.measuring import step
from tests.reference.systems import block, system

Real = npt.NDArray[np.float64]

mp = mpmath.mp.clone()
mp.dps = 60

SEEDS = 60 if settings().max_examples > 1000 else 3
GRAIN = 2.0**-5
END = 2.0
TERMS = 24
ONE = 1 << 200
"""Whole numbers of this part: 60 digits without the cost of floating ones."""


@dataclass(frozen=True)
class Network:
    """One network, and how many grains each of its delays has."""

    a: Real
    b: Real
    c: Real
    d: Real
    gains: Real
    grains: tuple[int, ...]

    def diagram(self) -> Diagram:
        ports = len(self.grains)
        matrices = {
            name: values.tolist() for name, values in zip("ABCD", (self.a, self.b, self.c, self.d), strict=True)
        }
        blocks = {"r": block("input"), "plant": block("state_space", **matrices)}
        wires = ["r -> s0.in1"]
        for i in range(ports):
            blocks[f"d{i}"] = block("delay", time=self.grains[i] * GRAIN)
            blocks[f"s{i}"] = block("sum", signs="+" * (ports + (i == 0)))
            wires += [f"plant.out{i + 1} -> d{i}", f"s{i} -> plant.in{i + 1}"]
            for k in range(ports):
                blocks[f"g{i}{k}"] = block("gain", gain=float(self.gains[i, k]))
                wires += [f"d{k} -> g{i}{k}", f"g{i}{k} -> s{i}.in{k + 1 + (i == 0)}"]
        return system(blocks, wires, {f"y{i}": f"plant.out{i + 1}" for i in range(ports)})

    def unstable(self) -> float:
        """Return how many poles are unstable: how far det(I - G(jω) diag(e^{-jωτ}) K) turns clockwise."""
        s = 1j * np.concatenate([np.linspace(0, 60, 20_001), np.geomspace(60, 4000, 30_000)])
        plant = self.c @ np.linalg.solve(s[:, None, None] * np.eye(len(self.a)) - self.a, self.b[None]) + self.d
        delayed = np.exp(-s[:, None] * np.array(self.grains) * GRAIN)[:, :, None] * plant
        found = np.linalg.det(np.eye(len(self.grains)) - delayed @ self.gains)
        return float(-np.angle(found[1:] / found[:-1]).sum() / np.pi)


def network(seed: int) -> Network:
    generator = np.random.default_rng(seed)
    ports, states = int(generator.integers(2, 4)), int(generator.integers(2, 5))
    a = np.triu(generator.normal(size=(states, states)), 1) - np.diag(10 ** generator.uniform(-0.5, 0.8, states))
    direct = 0.3 * generator.normal(size=(ports, ports)) if seed % 3 == 2 else np.zeros((ports, ports))
    lengths = generator.integers(2, 30, ports) if seed % 2 else 4 * generator.integers(1, 6, ports)
    return Network(
        a=a, b=generator.normal(size=(states, ports)), c=generator.normal(size=(ports, states)), d=direct,
        gains=0.5 * generator.normal(size=(ports, ports)), grains=tuple(int(n) for n in lengths),
    )  # fmt: skip


def whole(values: Real, scale: Any = 1) -> Any:
    return np.array([[int(mp.mpf(v) * scale * ONE) for v in row] for row in values.tolist()], dtype=object)


def steps(net: Network, intervals: int) -> Real:
    """Return the outputs in the middle of the intervals, where no echo jumps, shape (intervals, outputs)."""
    a, b = whole(net.a, mp.mpf(GRAIN)), whole(net.b, mp.mpf(GRAIN))
    c, d, gains = whole(net.c), whole(net.d), whole(net.gains)
    ports, x = len(net.grains), np.array([0] * len(net.a), dtype=object)
    series: list[Any] = []
    middles = np.zeros((intervals, ports))
    for interval in range(intervals):
        states = [x]
        out = np.zeros((TERMS, ports), dtype=object)
        for term in range(TERMS):
            past = [series[interval - n][term, i] if interval >= n else 0 for i, n in enumerate(net.grains)]
            u = gains @ np.array(past, dtype=object) // ONE
            u[0] += ONE if term == 0 else 0
            out[term] = (c @ states[-1] + d @ u) // ONE
            states.append((a @ states[-1] + b @ u) // (ONE * (term + 1)))
        x = sum(states)
        series.append(out)
        halved = sum(out[term] // 2**term for term in range(TERMS))
        middles[interval] = [float(mp.mpf(value) / ONE) for value in halved]
    return middles


@pytest.mark.parametrize("seed", range(SEEDS))
def test_curves_of_several_delays_and_ports(seed: int) -> None:
    net = network(seed)
    intervals = int(END / GRAIN)
    exact = steps(net, intervals)
    done = simulate(net.diagram(), signals={"r": step()}, duration=END, samples=2 * intervals + 1, metrics=[])
    for i in range(len(net.grains)):
        assert np.abs(done.curves[f"y{i}"][1::2] - exact[:, i]).max() <= 1e-11 * np.abs(exact[:, i]).max()


@pytest.mark.parametrize("seed", [seed for seed in range(SEEDS) if seed % 3 != 2])
def test_stability_of_several_delays_and_ports(seed: int) -> None:
    net = network(seed)
    count = net.unstable()
    assert abs(count - round(count)) < 0.05
    study = frequency_response(net.diagram(), source="r", target="y0", metrics=[])
    assert (study.verdict is Verdict.UNSTABLE) == (round(count) > 0)
