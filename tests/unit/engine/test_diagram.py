"""Documents: what is refused and where, what is warned of, and which parameters can be addressed."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Any

import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.model.errors import DiagramError, EngineError, ExpressionError, IllPosedError
from tests.unit.engine.diagrams import block, document, subsystem


def loop(**parameters: Any) -> System:
    """r -> error -> controller -> plant -> y, with the names that the tests below break."""
    return document(
        {
            "r": block("input"),
            "error": block("sum", signs="+-"),
            "controller": block("pi", kp="=kp", ki=1.0),
            "plant": block("transfer_function", numerator=[1], denominator=[0.5, 1]),
        },
        ["r -> error.in1", "plant -> error.in2", "error -> controller", "controller -> plant"],
        {"y": "plant"},
        **({"kp": 2.0} | parameters),
    )


def with_block(name: str, added: Block) -> System:
    system = loop()
    return replace(system, blocks={**system.blocks, name: added})


def with_wire(wire: str) -> System:
    system = loop()
    source, target = wire.split(" -> ")
    return replace(system, connections=(*system.connections, Connection(source=source, target=target)))


def refusal(system: System) -> EngineError:
    with pytest.raises(EngineError) as caught:
        compile_system(system)
    return caught.value


def test_what_is_known_of_a_diagram():
    diagram = compile_system(
        document(
            {
                "command": block("input"),
                "load": block("input", role="disturbance"),
                "motor": block("linear_pneumatic_motor"),
                "sum": block("sum", signs="+-"),
            },
            ["command -> sum.in1", "motor.position -> sum.in2", "sum -> motor.flow", "load -> motor.force"],
            {"position": "motor.position", "pressure": "motor.pressure_difference", "flow": "sum"},
        )
    )
    assert diagram.inputs == ("command", "load")
    assert diagram.references.roles == {"command": "reference", "load": "disturbance"}
    assert diagram.outputs == ("position", "pressure", "flow")
    assert diagram.output_units == {"position": "m", "pressure": "Pa", "flow": ""}
    assert diagram.warnings == ()


def test_every_scalar_has_a_path():
    inner = document({"u": block("input"), "g": block("gain", gain="=k")}, ["u -> g"], {"y": "g"}, k=3.0)
    diagram = compile_system(
        document(
            {"u": block("input"), "motor": block("linear_pneumatic_motor", mass=200.0), "inner": subsystem(inner)},
            ["u -> motor.flow", "motor.position -> inner"],
            {"y": "inner"},
        )
    )
    motor = ("area", "volume", "pressure", "adiabatic_index", "leakage", "mass", "viscous_friction")
    assert set(diagram.parameters) == {*(f"motor.{name}" for name in motor), "inner.k", "inner.g.gain"}
    mass = diagram.parameters["motor.mass"]
    assert (mass.path, mass.value, mass.unit, mass.lower, mass.lower_open) == ("motor.mass", 200.0, "kg", 0.0, True)
    assert (mass.scale, mass.bound) == ("log", False)
    assert diagram.parameters["motor.leakage"].value == 0.4e-11
    assert diagram.parameters["inner.g.gain"].bound
    assert diagram.parameters["inner.g.gain"].value == 3.0


def test_optional_parameters_that_are_absent_have_no_path():
    diagram = compile_system(loop())
    assert set(diagram.parameters) == {"kp", "controller.kp", "controller.ki"}


def test_a_parameter_inherits_from_the_one_that_it_gives():
    blocks = {"motor": block("linear_pneumatic_motor", mass="=m", leakage="=leak")}
    given = {"m": Parameter(value=300.0, upper=600.0), "leak": "=base", "base": 1e-11}
    diagram = compile_system(document(blocks, [], {"x": "motor.position"}, **given))
    m, base = diagram.parameters["m"], diagram.parameters["base"]
    assert (m.unit, m.lower, m.lower_open, m.upper, m.scale) == ("kg", 0.0, True, 600.0, "log")
    assert (base.unit, base.lower, base.lower_open, base.upper) == ("m**3/(s*Pa)", 0.0, False, math.inf)
    assert diagram.parameters["leak"].bound


def test_what_a_parameter_says_of_itself_goes_first():
    blocks = {"motor": block("linear_pneumatic_motor", mass="=m")}
    own = Parameter(value=300.0, unit="t", lower=100.0, scale="linear", doc="moved mass")
    m = compile_system(document(blocks, [], {"x": "motor.position"}, m=own)).parameters["m"]
    assert (m.unit, m.lower, m.lower_open, m.scale, m.doc) == ("t", 100.0, False, "linear", "moved mass")


def test_parameters_may_depend_on_each_other_in_any_order():
    diagram = compile_system(loop(kp="=a*b", a="=b+1", b=2.0))
    assert diagram.parameters["controller.kp"].value == 6.0
    assert [diagram.parameters[name].bound for name in ("kp", "a", "b")] == [True, True, False]


def test_lists_follow_expressions():
    system = with_block("lag", block("transfer_function", numerator=["=kp"], denominator=["=kp/4", 1.0]))
    system = replace(system, outputs={"z": "lag"})
    assert compile_system(system).realize().a[-1, -1] == -2.0


# Warnings


def test_unconnected_inputs_and_unused_parameters_are_warned_of():
    inner = document({"u": block("input"), "g": block("gain", gain=1.0)}, ["u -> g"], {"y": "g"}, spare=1.0)
    diagram = compile_system(
        document(
            {"r": block("input"), "motor": block("linear_pneumatic_motor"), "inner": subsystem(inner)},
            ["inner -> motor.flow"],
            {"x": "motor.position"},
            unused=1.0,
        )
    )
    assert [(w.at, w.detail) for w in diagram.warnings] == [
        (("blocks", "motor"), "input motor.force is not connected and stays 0"),
        (("blocks", "inner"), "input inner.u is not connected and stays 0"),
        (("blocks", "r"), "input r drives nothing"),
        (("parameters", "unused"), "parameter unused is not used"),
        (("blocks", "inner", "system", "parameters", "spare"), "parameter inner.spare is not used"),
    ]
    assert not diagram.realize().b1.any()


# Refusals: (document, path, words)


@pytest.mark.parametrize(
    ("added", "at", "message"),
    [
        (block("magic"), ("kind",), "kind of new must be one of .*delay, .*gain, .*subsystem, got 'magic'"),
        (block("gain"), ("gain",), "new.gain must be given"),
        (block("gain", gain=1.0, size=2.0), ("size",), r"parameter of new \(gain\) must be one of gain, got 'size'"),
        (block("gain", gain=math.nan), ("gain",), "new.gain must be finite, got nan"),
        (block("gain", gain=math.inf), ("gain",), "new.gain must be finite, got inf"),
        (block("gain", gain=10**400), ("gain",), "new.gain must be finite, got inf"),
        (block("gain", gain=True), ("gain",), "new.gain must be a number or an expression '=...', got 'True'"),
        (block("gain", gain="2"), ("gain",), "new.gain must be a number or an expression"),
        (block("gain", gain=[1.0]), ("gain",), "new.gain must be a number or an expression"),
        (block("gain", gain="=2*"), ("gain",), "cannot be read"),
        (block("gain", gain="=kp*speed"), ("gain",), r"parameters of its system \(kp\), got 'speed'"),
        (block("gain", gain="=1/(kp-2)"), ("gain",), "divides by zero"),
        (block("gain", gain="=plant.gain"), ("gain",), "got 'plant.gain'"),
        (block("sum", signs=3), ("signs",), r"new.signs must be a text \(.*\), got .3."),
        (block("sum", signs="+?"), ("signs",), r"new: signs must be 1 to 64 characters \+ or -"),
        (block("input", role="boss"), ("role",), "new.role must be one of reference, disturbance, got 'boss'"),
        (block("delay", time=-1.0), ("time",), "new.time must be >= 0 s, got -1"),
        (block("linear_pneumatic_motor", mass=0.0), ("mass",), "new.mass must be > 0 kg, got 0"),
        (block("linear_pneumatic_motor", mass="=kp-3"), ("mass",), "new.mass must be > 0 kg, got -1"),
        (block("transfer_function", numerator=1.0, denominator=[1.0]), ("numerator",), "must be a list, got '1.0'"),
        (block("transfer_function", numerator=[1.0] * 300, denominator=[1.0]), ("numerator",), "at most 201 long, got 300"),
        (block("transfer_function", numerator=[1.0], denominator=[1.0, "x"]), ("denominator", 1), r"denominator\[1\] must"),
        (block("transfer_function", numerator=[1.0, 1.0], denominator=[1.0]), ("numerator",), "new: .*improper"),
        (block("zero_pole_gain", poles=[[1.0, 2.0, 3.0]]), ("poles", 0), r"a number or \[re, im\], got 3"),
        (block("zero_pole_gain", poles=[[-1.0, 2.0]]), ("poles",), "conjugate of -1"),
        (block("state_space", A=[[1.0, 2.0], [3.0]], B=[], C=[], D=[]), ("A", 1), "rows of equal length, got 2 and 1"),
        (block("state_space", A=[1.0], B=[[1.0]], C=[[1.0]], D=[[1.0]]), ("A", 0), r"A\[0\] must be a list"),
        (block("pi", kp=1.0, lower=2.0, upper=1.0), ("upper",), "upper must be > lower .2., got 1"),
        (block("pi", kp=1.0, anti_windup="clamping"), ("anti_windup",), "lower or upper must be given for clamping"),
        (block("pi", kp=1.0, upper=1.0, tracking_time=1.0), ("tracking_time",), "must be absent unless anti_windup is"),
        (block("pi", kp=0.0, ki=1.0, upper=1.0, anti_windup="back_calculation"), ("tracking_time",), "kp/ki is not > 0 s"),
        (block("p", kp=1.0, anti_windup="none"), ("anti_windup",), "parameter of new .p. must be one of"),
        (block("subsystem"), ("system",), "system of new must be given"),
        (Block(kind="subsystem", system=document({}), values={"k": 1}), ("k",), "keeps its parameters inside"),
        (Block(kind="gain", values={"gain": 1}, system=document({})), ("system",), "only a subsystem has one"),
    ],
)  # fmt: skip
def test_refuses_a_block(added, at, message):
    error = refusal(with_block("new", added))
    assert error.at == ("blocks", "new", *at)
    with pytest.raises(EngineError, match=message):
        raise error


def test_a_derivative_without_a_filter_gets_one_and_a_warning():
    diagram = compile_system(with_block("new", block("pid", kp=1.0, kd=0.1)))
    assert diagram.parameters["new.filter_frequency"].value == 100.0
    told = {remark.at: remark.detail for remark in diagram.warnings}
    assert told["blocks", "new", "filter_frequency"] == (
        "filter_frequency of new is taken to be 100 rad/s, since it is not given: a derivative needs a filter"
    )
    for given in (block("pid", kp=1.0), block("pid", kp=1.0, kd=0.1, filter_frequency=10.0)):
        quiet = compile_system(with_block("new", given)).warnings
        assert not any("filter_frequency" in remark.at for remark in quiet)


@pytest.mark.parametrize("name", ["2nd", "a-b", "a.b", "", "_x", "é", "a" * 65])
@pytest.mark.parametrize("section", ["blocks", "parameters", "outputs"])
def test_refuses_names(name, section):
    added = {"blocks": block("gain", gain=1.0), "parameters": Parameter(value=1.0), "outputs": "plant"}[section]
    system = loop()
    error = refusal(replace(system, **{section: {**getattr(system, section), name: added}}))
    assert isinstance(error, DiagramError)
    assert error.at == (section, name)
    assert "name must be a letter" in error.message


@pytest.mark.parametrize("name", ["J", "R_a", "Ka", "T", "wN2"])
@pytest.mark.parametrize("section", ["blocks", "parameters", "outputs"])
def test_names_may_have_capitals(name, section):
    added = {"blocks": block("gain", gain=1.0), "parameters": Parameter(value=1.0), "outputs": "plant"}[section]
    system = loop()
    diagram = compile_system(replace(system, **{section: {**getattr(system, section), name: added}}))
    known = {
        "blocks": {path.partition(".")[0] for path in diagram.parameters},
        "parameters": diagram.parameters,
        "outputs": diagram.outputs,
    }
    assert name in known[section]
    assert name.swapcase() not in known[section]


@pytest.mark.parametrize("section", ["blocks", "parameters", "outputs"])
def test_refuses_names_that_differ_in_case_only(section):
    added = {"blocks": block("gain", gain=1.0), "parameters": Parameter(value=1.0), "outputs": "plant"}[section]
    system = loop()
    error = refusal(replace(system, **{section: {**getattr(system, section), "r_a": added, "R_a": added}}))
    assert error.at == (section, "R_a")
    assert error.message == "names must differ in more than case, got 'r_a' and 'R_a'"


def test_refuses_ports_that_differ_in_case_only():
    given = {"A": [[-1.0]], "B": [[1.0, 1.0]], "C": [[1.0]], "D": [[0.0, 0.0]], "inputs": ["f", "F"]}
    error = refusal(with_block("new", Block(kind="state_space", values=given)))
    assert error.at == ("blocks", "new", "inputs", 1)
    assert "'f' and 'F'" in error.message


@pytest.mark.parametrize("name", ["pi", "sqrt", "exp", "log", "sin", "cos", "Pi", "PI", "Exp"])
def test_refuses_parameters_named_like_functions(name):
    error = refusal(loop(**{name: 1.0}))
    assert error.at == ("parameters", name)
    assert f"got '{name}'" in error.message


@pytest.mark.parametrize(
    ("wire", "side", "message"),
    [
        ("nothing -> error.in1", "from", "begin with a block (r, error, controller, plant), got 'nothing'"),
        ("r -> nothing", "to", "begin with a block"),
        ("r -> error", "to", "one of the inputs error.in1, error.in2, got 'error'"),
        ("r -> error.in3", "to", "one of the inputs error.in1, error.in2, got 'error.in3'"),
        ("error.in1 -> plant", "from", "one of the outputs error.out, got 'error.in1'"),
        ("plant -> r", "to", "r has no inputs"),
        ("plant.out.x -> controller", "from", "got 'plant.out.x'"),
        ("r -> plant", "to", "input plant.in must be driven once, got 'controller' and 'r' (add them in a sum)"),
        ("r -> plant.in", "to", "input plant.in must be driven once"),
    ],
)
def test_refuses_a_connection(wire, side, message):
    error = refusal(with_wire(wire))
    assert isinstance(error, DiagramError)
    assert error.at == ("connections", 4, side)
    assert message in error.message


@pytest.mark.parametrize("endpoint", ["nothing", "plant.in", "plant.state", "", "."])
def test_refuses_an_output(endpoint):
    error = refusal(replace(loop(), outputs={"y": endpoint}))
    assert error.at == ("outputs", "y")


def test_single_ports_are_also_called_in_and_out():
    blocks = {"r": block("input"), "valve": block("proportional_valve", flow_gain=1.0, time_constant=0.1)}
    for source, target, read in [
        ("r", "valve", "valve"),
        ("r.out", "valve.in", "valve.out"),
        ("r", "valve.command", "valve.flow"),
    ]:
        diagram = compile_system(document(blocks, [f"{source} -> {target}"], {"y": read}))
        assert diagram.realize().b1[0, 0] == pytest.approx(10.0, rel=1e-15)


@pytest.mark.parametrize(
    ("parameters", "at", "message"),
    [
        ({"kp": "=kp+1"}, ("parameters", "kp", "value"), "kp -> kp"),
        ({"kp": "=td*2", "td": "=kp"}, ("parameters", "kp", "value"), "kp -> td -> kp"),
        ({"kp": 1.0, "a": "=b", "b": "=c", "c": "=a"}, ("parameters", "a", "value"), "a -> b -> c -> a"),
        ({"kp": "=speed"}, ("parameters", "kp", "value"), "got 'speed'"),
        ({"kp": math.nan}, ("parameters", "kp", "value"), "kp must be finite"),
        ({"kp": "=log(a)", "a": 0.0}, ("parameters", "kp", "value"), "log needs a value > 0, got 0"),
        ({"kp": Parameter(value=5.0, upper=4.0)}, ("parameters", "kp", "value"), "kp must be <= 4, got 5"),
        (
            {"kp": Parameter(value=5.0, lower=6.0, upper=4.0)},
            ("parameters", "kp", "lower"),
            "must be <= upper 4, got 6",
        ),
        ({"kp": Parameter(value=5.0, lower=math.nan)}, ("parameters", "kp", "lower"), "lower of kp must be a number"),
    ],
)
def test_refuses_parameters(parameters, at, message):
    error = refusal(loop(**parameters))
    assert error.at == at
    assert message in error.message


def test_own_bounds_hold_for_the_document_and_physical_ones_always():
    diagram = compile_system(loop(kp=Parameter(value=2.0, lower=1.0, upper=4.0)))
    assert diagram.realize({"kp": 5.0}).d11.shape == (1, 1)  # a study may look beyond them


def test_expressions_see_their_own_system_only():
    inner = document({"u": block("input"), "g": block("gain", gain="=kp")}, ["u -> g"], {"y": "g"})
    error = refusal(with_block("inner", subsystem(inner)))
    assert isinstance(error, ExpressionError)
    assert error.at == ("blocks", "inner", "system", "blocks", "g", "gain")


def test_errors_inside_subsystems_have_the_whole_path():
    inner = document({"u": block("input")}, ["u -> v"], {})
    assert refusal(with_block("inner", subsystem(inner))).at == ("blocks", "inner", "system", "connections", 0, "to")


def test_a_subsystem_is_addressed_from_outside_by_its_ports_only():
    inner = document({"u": block("input"), "g": block("gain", gain=1.0)}, ["u -> g"], {"y": "g"})
    system = with_block("inner", subsystem(inner))
    wires = (*system.connections, Connection(source="inner.g", target="inner"))
    error = refusal(replace(system, connections=wires))
    assert error.at == ("connections", 4, "from")
    assert "inner.y" in error.message


def test_a_port_of_a_subsystem_goes_before_a_block_of_that_name():
    inner = document(
        {"u": block("input"), "y": block("gain", gain=2.0), "z": block("gain", gain=3.0)},
        ["u -> y", "u -> z"],
        {"y": "z"},
    )
    diagram = compile_system(
        document(
            {"u": block("input"), "s": subsystem(inner)},
            ["u -> s"],
            {"port": "s.y", "block": "s.y.out", "other": "s.z"},
        )
    )
    assert diagram.realize().d11[:, 0].tolist() == [3.0, 2.0, 3.0]


def test_a_loop_of_connections_alone_is_refused():
    inner = document({"u": block("input")}, [], {"y": "u"})
    error = refusal(document({"s": subsystem(inner)}, ["s.y -> s.u"], {"y": "s"}))
    assert isinstance(error, IllPosedError)
    assert "must contain a block" in error.message


def test_sizes_are_limited():
    gains = {f"g{i}": block("gain", gain=1.0) for i in range(501)}
    assert "blocks must be at most 500" in refusal(document(gains)).message
    inner = document({f"g{i}": block("gain", gain=1.0) for i in range(300)})
    both = document({"a": subsystem(inner), "b": subsystem(inner)})
    assert "blocks must be at most 500" in refusal(both).message
    long = {f"t{i}": block("transfer_function", numerator=[1.0], denominator=[1.0] * 102) for i in range(2)}
    assert "states must be at most 200, got 202" in refusal(document(long)).message
    delays = {f"d{i}": block("delay", time=1.0) for i in range(51)}
    assert "delays must be at most 50, got 51" in refusal(document(delays)).message


def test_an_empty_document_is_a_system():
    system = compile_system(System()).realize()
    assert system.a.shape == (0, 0)
    assert system.d11.shape == (0, 0)


def test_a_diagram_travels_to_another_process():
    diagram = compile_system(loop())
    copy = pickle.loads(pickle.dumps(diagram))
    assert copy.realize({"kp": 3.0}).b1.tolist() == diagram.realize({"kp": 3.0}).b1.tolist()
