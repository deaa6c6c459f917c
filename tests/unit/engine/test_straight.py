"""Laws that say they are straight lines are, and systems stepped by linear maps are those that Newton's method steps."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from engine.diagram.diagram import compile_system
from engine.elements import catalogue
from engine.elements._nonlinear import Moment, NonlinearElement, slopes, stacked
from engine.exact.laws.straight import Maps
from engine.exact.nonlinear import response as nonlinear
from engine.exact.nonlinear.integrate import Integration
from engine.signals import make
from tests.unit.engine.diagrams import block, document

LAWS = [kind for kind, element in catalogue().items() if issubclass(element, NonlinearElement)]

mp = mpmath.mp.clone()
mp.dps = 40


def complete(kind):
    element = catalogue()[kind]
    return element, {p.name: p.default for p in element.parameters} | dict(element.example)


@pytest.mark.parametrize("kind", LAWS)
def test_a_law_that_says_it_is_a_line_is_one(kind):
    element, values = complete(kind)
    ports, rng = element.ports(values), np.random.default_rng(7)
    lines = [mode for mode in element.modes if element.affine(mode, values)]
    for mode in lines:
        x, z = rng.normal(size=(len(element.initial(values)), 3)), rng.normal(size=(len(ports.inputs), 3))

        def at(t, x, z, mode=mode):
            m = Moment(t=np.full((1, x.shape[1]), t), x=list(x[:, None]), z=list(z[:, None]))
            f, g = element.rates(m, mode, values), element.outputs(m, mode, values)
            return stacked([*f, *g], (1, x.shape[1]))[0].T

        origin = at(0.0, 0 * x, 0 * z)
        m = Moment(t=np.zeros((1, 1)), x=[np.zeros((1, 1))] * len(x), z=[np.zeros((1, 1))] * len(z))
        part = slopes(element, m, mode, values)
        slope = np.block([[part.fx[0], part.fz[0]], [part.gx[0], part.gz[0]]])
        np.testing.assert_allclose(at(2.5, x, z), origin + slope @ np.concatenate([x, z]), rtol=1e-12, atol=1e-12)
        other = slopes(element, m, element.alike(mode), values)
        np.testing.assert_array_equal(part.gz, other.gz)


def test_laws_that_bend_do_not_say_so():
    for kind in ("mr_damper_spencer", "orifice_valve", "multiplication", "pneumatic_cylinder"):
        element, values = complete(kind)
        assert not any(element.affine(mode, values) for mode in element.modes), kind
    element, values = complete("friction")
    assert not element.affine(1, values)  # a Stribeck curve
    assert element.affine(1, values | {"stribeck_velocity": None})


MOTOR = block("dc_motor", resistance=1.0, inductance=1e-3, torque_constant=0.5, back_emf_constant=0.5, inertia=0.01,
              viscous_friction=0.01)  # fmt: skip


def sampled():
    """Return a servo drive with a sampled controller, a quantized angle and a limited voltage."""
    controller = block("sampled_pid", kp=40.0, ki=20.0, kd=2.0, filter_frequency=500.0, sample_time=2e-3, delay=6e-4)
    return compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "c": controller, "s": block("saturation", lower=-9.0, upper=9.0),
             "q": block("quantizer", step=5e-3), "m": MOTOR},
            ["r -> e.in1", "q -> e.in2", "e -> c", "c -> s", "s -> m.voltage", "m.angle -> q"],
            {"y": "m.angle", "u": "s"},
        )
    )  # fmt: skip


def sticking():
    """Return a mass that a spring pulls over dry ground."""
    return compile_system(
        document(
            {"r": block("input"), "n": block("sum", signs="+--"), "k": block("gain", gain=40.0), "v": block("integrator"),
             "x": block("integrator"), "f": block("friction", coulomb=1.0, viscous=0.2)},
            ["r -> n.in1", "x -> k", "k -> n.in2", "f -> n.in3", "n -> v", "v -> x", "v -> f.velocity"],
            {"y": "x", "u": "v"},
        )
    )  # fmt: skip


@pytest.mark.parametrize(
    ("made", "command", "end"),
    [
        (sampled, make("step", {"amplitude": 0.05}), 0.04),
        (sampled, make("ramp", {"slope": 0.4, "start": 0.003}), 0.04),
        (sticking, make("step", {"amplitude": 8.0}), 3.0),
        (sticking, make("trapezoid", {"distance": 6.0, "max_velocity": 10.0, "max_acceleration": 40.0}), 3.0),
    ],
)
def test_steps_by_maps_are_those_by_newtons_method(monkeypatch, made, command, end):
    times = np.linspace(0.0, end, 501)

    def curves(lanes):
        steps = {"x.gain": 1e-30} if made is sticking else {"c.kp": 40e-30}
        run = Integration(made().laws(None, steps if lanes else None), {"r": command})
        return run.advance(end)

    by_maps, with_lanes = curves(lanes=False), curves(lanes=True)
    assert by_maps.events > 0
    monkeypatch.setattr(Maps, "map", lambda *_: None)
    newton, newton_lanes = curves(lanes=False), curves(lanes=True)
    assert by_maps.events == newton.events
    for k in range(2):
        scale = np.abs(newton.output(k).sample(times)).max()
        np.testing.assert_allclose(by_maps.output(k).sample(times), newton.output(k).sample(times), atol=1e-9 * scale)
    ends = [outcome.record.y[-1][-1, 0].imag for outcome in (with_lanes, newton_lanes)]
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-7, atol=1e-7 * float(np.abs(ends[1]).max()))


def test_a_state_at_rest_stays_exactly_where_it_is():
    """Sampled states are what they were, whatever the number of cuts between two samples."""
    run = Integration(sampled().laws(), {"r": make("step", {"amplitude": 0.05})})
    outcome = run.advance(0.0999)
    held = outcome.record.u[-1]
    assert np.ptp(held) == 0.0
    system = sampled().laws()
    straight = system.straight(outcome.modes)
    assert straight is not None
    names = system.states - system.linear_states
    assert set(range(system.linear_states, system.linear_states + names)) <= set(straight.still.tolist())


def test_a_slow_tail_behind_fast_dynamics_takes_few_steps():
    # Poles from 0.05 to 500 rad/s: what rounding leaves of the fast ones looked like something that moves.
    diagram = compile_system(
        document(
            blocks={
                "r": block("input"), "error": block("sum", signs="+-"),
                "law": block("pid", kp=20.0, ki=1.0, kd=1.0, filter_frequency=500.0),
                "limit": block("saturation", lower=-1e4, upper=1e4),
                "drive": block("transfer_function", numerator=[20.0], denominator=[0.02, 1.2, 4.0]),
                "position": block("integrator"),
            },
            wires=["r -> error.in1", "error -> law", "law -> limit", "limit -> drive", "drive -> position",
                   "position -> error.in2"],
            outputs={"y": "position"},
        )
    )  # fmt: skip
    found = nonlinear.respond(diagram.laws(), {"r": make("step", {})}, 700.0, 700.0)
    assert found.outcome.steps < 400
    linear = diagram.realize()
    times = np.geomspace(1e-3, 600.0, 60)
    joint = np.block([[linear.a, linear.b1], [np.zeros((1, len(linear.a) + 1))]])
    poles, right = mp.eig(mp.matrix(joint.tolist()))  # an exponential in doubles is off by up to 2e-11 here
    forced = (right**-1)[:, len(joint) - 1]
    seen = mp.matrix([[*linear.c1[0].tolist(), 0.0]]) * right
    expected = [
        float(mp.re(sum(seen[k] * mp.exp(pole * mp.mpf(t)) * forced[k] for k, pole in enumerate(poles))))
        for t in times.tolist()
    ]
    assert found.output("y").sample(times) == pytest.approx(expected, abs=1e-11)
