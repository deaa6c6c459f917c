"""What is shown of a frequency response unasked: all that happens, little beyond, and nothing that has faded.

Corners, resonances and crossings come from the factors that are drawn, by closed forms and a grid of them.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st

from engine.analysis.study import frequency_response
from engine.diagram.diagram import Block, Diagram, compile_system
from tests.unit.engine.diagrams import block, document

_DECADES = 1.25
_FADED = 1e-5
_GRID = np.geomspace(1e-4, 1e8, 60_000)


@dataclass(frozen=True)
class Chain:
    """gain e^{-s τ} Π 1/(s/ω + 1) Π 1/(s²/ω² + 2 ζ s/ω + 1): lags, and pairs of (ω, ζ)."""

    gain: float
    lags: tuple[float, ...]
    pairs: tuple[tuple[float, float], ...]
    delay: float

    def diagram(self, *, closed: bool) -> Diagram:
        factors = [block("transfer_function", numerator=[1.0], denominator=[1 / w, 1.0]) for w in self.lags]
        factors += [
            block("transfer_function", numerator=[1.0], denominator=[1 / w**2, 2 * z / w, 1.0]) for w, z in self.pairs
        ]
        blocks: dict[str, Block] = {"k": block("gain", gain=self.gain)}
        blocks.update({f"f{i}": factor for i, factor in enumerate(factors)})
        if self.delay:
            blocks["late"] = block("delay", time=self.delay)
        names = list(blocks)
        wires = [f"{a} -> {b}" for a, b in itertools.pairwise(names)]
        begin = ["r -> e.in1", f"{names[-1]} -> e.in2", "e -> k"] if closed else ["r -> k"]
        blocks["r"] = block("input")
        if closed:
            blocks["e"] = block("sum", signs="+-")
        return compile_system(document(blocks, [*begin, *wires], {"y": names[-1]}))

    def magnitude(self, w: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        found = np.full(w.shape, self.gain)
        for corner in self.lags:
            found = found / np.hypot(1, w / corner)
        for corner, damping in self.pairs:
            found = found / np.hypot(1 - (w / corner) ** 2, 2 * damping * w / corner)
        return found

    @property
    def corners(self) -> npt.NDArray[np.float64]:
        return np.array([*self.lags, *(w for w, _ in self.pairs)])

    @property
    def resonances(self) -> npt.NDArray[np.float64]:
        return np.array([w * np.sqrt(1 - 2 * z * z) for w, z in self.pairs])

    @property
    def crossings(self) -> npt.NDArray[np.float64]:
        above = self.magnitude(_GRID) > 1
        return np.asarray(_GRID[:-1][above[1:] != above[:-1]])

    @property
    def summit(self) -> float:
        return float(_GRID[self.magnitude(_GRID).argmax()])


_FREQUENCIES = st.floats(-1, 4).map(lambda x: 10.0**x)
_CHAINS = st.builds(
    Chain,
    gain=st.floats(-2, 3).map(lambda x: 10.0**x),
    lags=st.lists(_FREQUENCIES, min_size=1, max_size=5).map(tuple),
    pairs=st.lists(st.tuples(_FREQUENCIES, st.floats(-3, -0.5).map(lambda x: 10.0**x)), max_size=2).map(tuple),
    delay=st.one_of(st.just(0.0), st.floats(-4, 0).map(lambda x: 10.0**x)),
)


@given(_CHAINS)
def test_a_path_is_shown_where_it_happens(chain: Chain) -> None:
    shown = frequency_response(chain.diagram(closed=False), source="r", target="y", metrics=()).frequency
    crossings = chain.crossings
    top = 1.0 if len(crossings) else chain.gain
    marks = np.concatenate([chain.corners, chain.resonances])
    marks = marks[chain.magnitude(marks) > 2 * _FADED * top]
    assert shown[0] < min(marks.min(initial=np.inf), crossings.min(initial=np.inf))
    assert shown[-1] > max(marks.max(initial=0.0), crossings.max(initial=0.0) * (1 - 1e-3))
    # not much more: one and a quarter decades on either side of all that happens
    everything = np.concatenate([chain.corners, crossings])
    summit = chain.summit
    everything = np.append(everything, summit) if summit > 2 * _GRID[0] else everything
    assert shown[0] > 10 ** -(_DECADES + 0.01) * everything.min()
    assert shown[-1] < 10 ** (_DECADES + 0.01) * everything.max()


@given(_CHAINS)
def test_a_delay_does_not_widen_the_picture_of_a_path(chain: Chain) -> None:
    prompt = Chain(chain.gain, chain.lags, chain.pairs, 0.0)
    ends = [
        frequency_response(one.diagram(closed=False), source="r", target="y", metrics=()).frequency[[0, -1]]
        for one in (chain, prompt)
    ]
    # where the end is that of the fading, the two scans place it on points of their own
    assert np.abs(np.log10(ends[0] / ends[1])).max() < 0.1


@given(_CHAINS)
def test_a_loop_is_shown_with_its_margins(chain: Chain) -> None:
    study = frequency_response(chain.diagram(closed=True), open_at="e", metrics=())
    shown, margins = study.frequency, study.margins
    assert margins is not None
    for crossing in chain.crossings:
        assert shown[0] < crossing * (1 + 1e-3)
        assert shown[-1] > crossing * (1 - 1e-3)
    if margins.gain:
        nearest = min(margins.gain, key=lambda one: abs(np.log(one[1])))[0]
        assert shown[0] <= nearest <= shown[-1]
    told = [w for w, _ in (*margins.gain, *margins.phase) if w > 0]
    everything = np.concatenate([chain.corners, told, np.abs(study.poles[np.abs(study.poles) > 0])])
    assert np.log10(shown[-1] / shown[0]) < np.log10(everything.max() / everything.min()) + 2 * _DECADES + 0.01


def test_the_resonance_of_a_late_loop_is_shown() -> None:
    # K e^-sT / s leaves its edge of stability at K T = π/2, ω T = π/2: at 0.9 of that the closed loop swings nearly so
    blocks = {"r": block("input"), "e": block("sum", signs="+-"), "k": block("gain", gain=45 * np.pi)}
    blocks |= {"i": block("integrator"), "late": block("delay", time=0.01)}
    wires = ["r -> e.in1", "late -> e.in2", "e -> k", "k -> i", "i -> late"]
    study = frequency_response(compile_system(document(blocks, wires, {"y": "i"})), source="r", target="y", metrics=())
    assert study.frequency[0] < 50 * np.pi / 10 < 50 * np.pi * 10 < study.frequency[-1] < 50 * np.pi * 100
