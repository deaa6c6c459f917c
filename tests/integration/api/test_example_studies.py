"""The studies of drives, structures and dampers run as scripts, and what they print agrees with the physics."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from examples import (
    dc_motor_resistance,
    hydraulic_leakage,
    hydraulic_orifice,
    intelligent_damper,
    mechanical_correction,
    mr_damper,
    pneumatic_motor,
    velocity_limit,
)
from tests.integration.api.conftest import Service

Printed = Callable[[ModuleType], str]


@pytest.fixture(scope="module")
def service(sqlite_service: Service) -> Service:
    """One kind of database is enough for examples; the worker of the other tests works on its database."""
    return sqlite_service


@pytest.fixture
def printed(service: Service, worker: None, tmp_path, capsys) -> Printed:
    """Run a script, see that it writes its figure, and return what it prints."""

    def printed(script: ModuleType) -> str:
        figure = tmp_path / "figure.png"
        assert script.main(["--url", service.url, "--key", service.keys["admin"], "--figure", str(figure)]) == 0
        assert figure.read_bytes().startswith(b"\x89PNG")
        assert figure.stat().st_size < 100e3
        return capsys.readouterr().out

    return printed


def numbers(said: str, name: str) -> list[float]:
    """Return the numbers of the row that begins with this name, in the units of its table."""
    (row,) = re.findall(rf"^{re.escape(name)}  +(.*)$", said, flags=re.MULTILINE)
    return [float(cell.split()[0]) for cell in re.split(r"  +", row.strip()) if cell != "-"]


def test_armature_resistance(printed: Printed) -> None:
    said = printed(dc_motor_resistance)
    constant, inertia, inductance, friction = 0.2, 2e-3, 1e-3, 1e-3
    for resistance in (0.33, 0.5, 0.8):
        slowest, ideal, _, _, current, lost = numbers(said, f"{resistance:g} ohm")
        # ω/u = k / (L J s² + (R J + L b) s + R b + k²), G. F. Franklin et al., Feedback Control of Dynamic Systems, chapter 2.
        stiffness = resistance * friction + constant**2
        poles = np.roots([inductance * inertia, resistance * inertia + inductance * friction, stiffness])
        assert slowest == pytest.approx(-1e3 / poles.real.max(), rel=5e-3)
        assert ideal == pytest.approx(1e3 * resistance * inertia / constant**2, rel=5e-3)
        # At rest under a load M: ω = -R M / (R b + k²).
        assert lost == pytest.approx(2 * resistance / stiffness, rel=5e-3)
        assert current < 24 / resistance


def test_pneumatic_motor(printed: Printed) -> None:
    said = printed(pneumatic_motor)
    # ω² = (A² + a_m b_m) χ p / (V m), 2 ζ ω = b_m/m + a_m χ p/V: the bracket of eq. (2), values in cm, daN, s.
    stiffness = 1.4 * 5 / 750
    frequency = math.sqrt((65**2 + 0.4 * 1.2) * stiffness / 0.3)
    found, damping, *_ = numbers(said, "middle of all ranges")
    assert found == pytest.approx(frequency, rel=5e-3)
    assert damping == pytest.approx((1.2 / 0.3 + 0.4 * stiffness) / (2 * frequency), rel=5e-3)
    # Its elasticities in V and m are -1/2; eq. (4) at +40 % and +100 %: (1/sqrt(1.4) - 1)/0.4 and 1/sqrt(2) - 1.
    for name, coefficient in (
        ("volume +40 %", (1 / math.sqrt(1.4) - 1) / 0.4),
        ("mass +100 %", 1 / math.sqrt(2) - 1),
    ):
        (cell,) = re.findall(rf"^{re.escape(name)} .* (\S+ \(\S+\))$", said, flags=re.MULTILINE)
        assert cell == f"{coefficient:+.3f} (-0.500)"


def test_leakage_damps_and_slows_and_the_law_restores(printed: Printed) -> None:
    said = printed(hydraulic_leakage)
    tight, leaky = numbers(said, "9.1 cm⁵/(daN·s)"), numbers(said, "45 cm⁵/(daN·s)")
    chosen = numbers(said, "45 cm⁵/(daN·s), PD2")
    # ζ = (C b + m a_m)/(2 sqrt(C m (A² + a_m b))) with C = V/(4 β), H. E. Merritt, Hydraulic Control Systems, chapter 6;
    # overshoot exp(-π ζ/sqrt(1 - ζ²)). The valve's lag of 1 ms is small beside the motor's period of 41 ms.
    capacitance, area, mass, friction = 4e-3 / (4 * 1.4e9), 50e-4, 1500, 1200
    damping = [
        (capacitance * friction + mass * leakage) / (2 * math.sqrt(capacitance * mass * (area**2 + leakage * friction)))
        for leakage in (9.1e-11, 45e-11)
    ]
    assert damping[0] < 1 < damping[1]
    assert tight[0] == pytest.approx(100 * math.exp(-math.pi * damping[0] / math.sqrt(1 - damping[0] ** 2)), abs=1)
    assert leaky[0] == 0
    assert leaky[2] > 1.3 * tight[2]
    assert chosen[0] <= 2.01
    assert chosen[2] < 0.5 * tight[2]
    assert chosen[4] < 2.01
    assert "certificate valid" in said


def test_mechanical_correction(printed: Printed) -> None:
    said = printed(mechanical_correction)
    values = dict(mechanical_correction.VALUES)
    chosen = {name: float(value) for name, value in re.findall(r"(m3|h1|h2|k1|k3) ([\d.e+]+)", said.splitlines()[0])}
    assert len(chosen) == 5

    def remaining(k1: float, k2: float, k3: float, k4: float, **_: float) -> float:
        """Return 10 mm - x2 at rest, from the two balances of forces."""
        _, load = np.linalg.solve([[k1 + k2 + k3, -k3], [-k3, k3 + k4]], [10 * k1, 0])
        return 10 - float(load)

    without = numbers(said, "without correction")
    assert without[3] == pytest.approx(10 * values["k4"] / (values["k1"] + values["k4"]), rel=5e-3)
    assert numbers(said, "with correction")[3] == pytest.approx(remaining(**values), rel=5e-3)
    best = numbers(said, "with correction, chosen")
    assert best[3] == pytest.approx(remaining(**values | chosen), rel=0.02)
    assert best[0] <= 20.1
    assert best[1] < 0.2 * without[1]
    # The printed coefficients break the balance of forces wherever k2 differs from k3.
    assert numbers(said, "eq. (5) as printed")[3] > 2 * remaining(**values)


def test_velocity_limit(printed: Printed) -> None:
    said = printed(velocity_limit)
    (rule, best) = re.findall(r"one period at v = ([\d.]+) m/s|Best limit ([\d.]+) m/s", said)
    # No residual vibration where the ramp time h/v is a period, N. Singer and W. Seering, ASME J. Dyn. Syst. Meas. Control 112 (1990).
    assert float(best[1]) == pytest.approx(float(rule[0]), rel=0.02)
    free, limited = numbers(said, "1.000 m/s"), numbers(said, f"{float(best[1]):.3f} m/s")
    assert limited[0] < 0.01 * free[0]
    assert limited[1] < 0.05 * free[1]
    # So the slower command is there sooner.
    assert limited[2] < 0.1 * free[2]


def test_damper_loops(printed: Printed) -> None:
    said = printed(mr_damper)
    previous = 0.0
    for current in mr_damper.CURRENTS:
        force, energy, *fit = numbers(said, f"{current:.2f} A")
        # Fully yielded, z = sqrt(A/2γ) and y' = (α z + c0 v)/(c0 + c1), so f = c1 (α z + c0 v)/(c0 + c1) where it is fastest
        # (x = 0); B. Spencer et al., J. Eng. Mech. 123 (1997) 230-238, parameters of examples/data/mr_damper/SOURCE.md.
        gamma = 1.89407553e6 * math.exp(-3.65610854 * current)
        alpha = 15221.0961 + 41508.4056 * current - 38152.0043 * current**2
        c0, c1 = 924.911328 + 7625.96402 * current, 9867.12839 + 78336.6934 * current
        yielded = c1 * (alpha * math.sqrt(300 / (2 * gamma)) + c0 * 0.025 * math.pi) / (c0 + c1)
        assert force == pytest.approx(yielded, rel=0.15 if current == 0 else 0.02)
        # At most the rectangle that holds the loop, and most of it.
        assert 0.8 < energy / (4 * 0.025 * force) < 1
        assert energy > previous
        previous = energy
        assert bool(fit) == (current in mr_damper.RECORDINGS)
        if fit:
            assert fit[0] > 85
    # As published with the recordings.
    assert numbers(said, "1.00 A")[3] == pytest.approx(8.28, abs=0.3)


def test_leakage_and_law_with_orifices(printed: Printed) -> None:
    said = printed(hydraulic_orifice)
    rows = {
        (case, size): numbers(said, f"{name}, {size}")
        for case, name in (("tight", "9.1 cm⁵/(daN·s)"), ("leaky", "45 cm⁵/(daN·s)"), ("law", "45 cm⁵/(daN·s), PD2"))
        for size in ("small step", "large step", "linear")
    }
    # Orifices damp, the more the wider they are open: K_c = Q/(2 (p_s - p_L)), H. E. Merritt, Hydraulic Control Systems, chapter 5.
    assert 10 < rows["tight", "large step"][0] < rows["tight", "small step"][0] < rows["tight", "linear"][0]
    for case in ("leaky", "law"):
        assert rows[case, "small step"][0] < 2.1
        assert rows[case, "small step"][2] == pytest.approx(rows[case, "linear"][2], rel=0.1)
    assert rows["leaky", "small step"][2] > 1.5 * rows["tight", "small step"][2]
    assert rows["law", "small step"][2] < 0.5 * rows["tight", "small step"][2]
    # The spool's end: Q <= C_d w x_max sqrt(2 (p_s - p_a)/ρ), and p_a is never below p_s/2 while the piston is driven.
    largest = 1e3 * 0.62 * 0.015 * 1e-3 * math.sqrt(21e6 / 870)
    assert 0.95 * largest < rows["law", "large step"][3] < largest
    assert rows["law", "large step"][2] > 1.5 * rows["law", "small step"][2]
    assert "certificate valid" in said


def test_intelligent_damper(printed: Printed, monkeypatch: pytest.MonkeyPatch) -> None:
    # Fewer lines, a shorter look and a shorter search: what is held here does not need more.
    monkeypatch.setattr(intelligent_damper, "MOVING", 1.2)
    monkeypatch.setattr(intelligent_damper, "LINE", 5.0)
    monkeypatch.setattr(intelligent_damper, "PERIOD", 2 * math.pi / 5.0)
    monkeypatch.setattr(intelligent_damper, "LINES", range(1, 19))
    monkeypatch.setattr(intelligent_damper, "EVALUATIONS", 6)
    said = printed(intelligent_damper)
    off, on, skyhook, clipped = (numbers(said, name) for name in intelligent_damper.LAWS)
    for other in (on, skyhook, clipped):
        assert other[0] < 0.7 * off[0]
        assert other[3] < 0.7 * off[3]
    # The passive ones have the current that they are given, the others something between.
    assert off[5] == 0
    assert on[5] == 1
    assert 0.1 < clipped[5] < skyhook[5] < 1
    # What Karnopp showed: less is transmitted above the resonance than by a damper that is always hard.
    assert skyhook[4] < on[4]
    before, after = numbers(said, "before"), numbers(said, "after")
    assert after[0] < 0.7 * before[0]
    assert after[1] <= 5.3
    assert "certificate valid" in said


@pytest.mark.parametrize(
    "script",
    [
        dc_motor_resistance,
        pneumatic_motor,
        hydraulic_leakage,
        hydraulic_orifice,
        intelligent_damper,
        mechanical_correction,
        mr_damper,
        velocity_limit,
    ],
)
def test_it_says_in_one_line_that_no_service_answers(script: ModuleType, capsys) -> None:
    assert script.main(["--url", "http://127.0.0.1:1", "--key", "none"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
