"""Systems to python-control and back, and as MATLAB files; python-control and scipy say what is right."""

from __future__ import annotations

import io
import json
from itertools import pairwise

import control
import numpy as np
import pytest
from scipy.io import loadmat

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.interop.from_python_control import from_control
from engine.interop.matlab import mat
from engine.interop.matrices import Matrices, numbered, realized
from engine.interop.python_control import to_state_space, to_transfer_function
from engine.model.errors import DiagramError
from engine.model.linear_system import LinearSystem

FREQUENCIES = np.logspace(-2, 3, 60)


def loop(*, delay: float = 0.0) -> Diagram:
    """r -> (+-) -> PID -> [delay] -> 4/(s^2 + 0.8 s + 4) -> 1/(0.01 s + 1) -> y, y fed back; the plant's output is read too."""
    middle = {"line": Block(kind="delay", values={"time": delay})} if delay else {}
    chain = ["error", "controller", *middle, "plant", "sensor"]
    wires = [("r", "error.in1"), ("sensor", "error.in2"), *pairwise(chain)]
    gains = {"kp": "=kp", "ki": 0.8, "kd": 0.3, "filter_frequency": 50.0}
    return compile_system(
        System(
            name="loop",
            parameters={"kp": Parameter(value=1.5)},
            blocks={
                "r": Block(kind="input"),
                "d": Block(kind="input", values={"role": "disturbance"}),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "controller": Block(kind="pid", values=gains),
                **middle,
                "plant": Block(
                    kind="state_space",
                    values={
                        "A": [[0.0, 1.0], [-4.0, -0.8]],
                        "B": [[0.0, 0.0], [4.0, 1.0]],
                        "C": [[1.0, 0.0]],
                        "D": [[0.0, 0.0]],
                        "inputs": ["drive", "load"],
                    },
                ),
                "sensor": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [0.01, 1.0]}),
            },
            connections=tuple(
                Connection(source=s, target="plant.drive" if t == "plant" else t)
                for s, t in [*wires, ("d", "plant.load")]
            ),
            outputs={"y": "sensor", "position": "plant"},
        )
    )


def by_hand(w: np.ndarray, *, delay: float = 0.0) -> np.ndarray:
    """Return the responses (y, position) x (r, d) from the block equations."""
    s = 1j * w
    pid = 1.5 + 0.8 / s + 0.3 * s / (1 + s / 50)
    plant = 1 / (s**2 + 0.8 * s + 4)
    sensor = 1 / (0.01 * s + 1)
    line = np.exp(-s * delay)
    closed = 1 / (1 + pid * line * 4 * plant * sensor)
    position = np.array([pid * line * 4 * plant * closed, plant * closed])
    return np.array([position * sensor, position])


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found / expected - 1).max())


def test_a_state_space_keeps_names_and_response():
    system = to_state_space(realized(loop()))
    assert system.input_labels == ["r", "d"]
    assert system.output_labels == ["y", "position"]
    assert system.state_labels == [
        "controller_x1", "controller_x2", "plant_x1", "plant_x2", "sensor_x1",
    ]  # fmt: skip
    assert difference(system(1j * FREQUENCIES), by_hand(FREQUENCIES)) < 1e-12


def test_a_transfer_function_has_the_response_and_no_leading_noise():
    system = to_transfer_function(realized(loop()))
    assert difference(system(1j * FREQUENCIES), by_hand(FREQUENCIES)) < 1e-10
    assert system.input_labels == ["r", "d"]
    assert len(system.den[0][0]) == 6
    # r to the position: two integrations of the plant over the direct path of the controller; d to y: the sensor more.
    assert [len(system.num[1][0]), len(system.num[1][1]), len(system.num[0][1])] == [4, 4, 3]


def test_a_static_system_converts():
    gain = LinearSystem.delay_free(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[3.0]]))
    assert to_state_space(numbered(gain))(0.0) == 3.0
    assert to_transfer_function(numbered(gain))(0.0) == 3.0


def test_the_round_trip_through_python_control_is_exact():
    back = compile_system(from_control(to_state_space(realized(loop()))))
    assert back.inputs == ("r", "d")
    assert back.outputs == ("y", "position")
    assert difference(to_state_space(realized(back))(1j * FREQUENCIES), by_hand(FREQUENCIES)) < 1e-12


def test_twenty_states_three_inputs_and_a_direct_path_survive_every_format():
    rng = np.random.default_rng(20)
    a = rng.normal(size=(20, 20))
    a -= (np.linalg.eigvals(a).real.max() + 0.3) * np.eye(20)
    given = control.ss(
        a, rng.normal(size=(20, 3)), rng.normal(size=(2, 20)), rng.normal(size=(2, 3)),
        inputs=["u", "v", "w"], outputs=["y", "z"], name="plant",
    )  # fmt: skip
    expected = given(1j * FREQUENCIES)
    matrices = realized(compile_system(from_control(given)))
    assert (matrices.document()["inputs"], matrices.document()["outputs"]) == (["u", "v", "w"], ["y", "z"])
    assert difference(to_state_space(matrices)(1j * FREQUENCIES), expected) < 1e-11
    for kept in (from_mat(matrices), json.loads(json.dumps(matrices.document()))):
        again = control.ss(*(np.array(kept[name]) for name in "ABCD"))
        assert difference(again(1j * FREQUENCIES), expected) < 1e-11


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (control.tf([1.0, 0.0, 0.0], [1.0, 1.0]), "must be at most of the order"),
        (control.ss([[np.nan]], [[1.0]], [[1.0]], [[0.0]]), "must be finite"),
        (control.ss([[-1.0]], [[np.inf]], [[1.0]], [[0.0]]), "must be finite"),
    ],
)
def test_what_is_improper_or_not_finite_is_refused(given, message):
    with pytest.raises(DiagramError, match=message):
        compile_system(from_control(given))


def test_a_delay_is_refused_by_name_or_approximated_when_asked():
    matrices = realized(loop(delay=0.05))
    assert matrices.channels == ("line.w1",)
    with pytest.raises(DiagramError, match=r"free of delays.*got line\.w1 of 0\.05 s: ask for a pade_order"):
        to_state_space(matrices)
    slow = FREQUENCIES[FREQUENCIES < 10]
    errors = [
        difference(to_state_space(matrices, pade_order=order)(1j * slow), by_hand(slow, delay=0.05))
        for order in (1, 2, 4)
    ]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-9
    system = to_state_space(matrices, pade_order=2)
    assert system.state_labels[-2:] == ["line_w1_1", "line_w1_2"]


@pytest.mark.parametrize("order", [0, 11])
def test_an_order_out_of_bounds_is_refused(order):
    with pytest.raises(DiagramError, match=f"pade_order must be 1 to 10, got {order}"):
        to_state_space(realized(loop(delay=0.05)), pade_order=order)


def test_an_approximation_of_one_delay_is_that_of_python_control():
    """e^(-0.2 s)/(s + 1) against control.pade, with a delay that is fed through to the output."""
    diagram = compile_system(
        System(
            blocks={
                "u": Block(kind="input"),
                "line": Block(kind="delay", values={"time": 0.2}),
                "lag": Block(kind="transfer_function", values={"numerator": [1.0, 2.0], "denominator": [1.0, 1.0]}),
            },
            connections=(Connection(source="u", target="line"), Connection(source="line", target="lag")),
            outputs={"y": "lag"},
        )
    )
    expected = control.tf(*control.pade(0.2, 3)) * control.tf([1.0, 2.0], [1.0, 1.0])
    found = to_transfer_function(realized(diagram), pade_order=3)
    assert difference(found(1j * FREQUENCIES), expected(1j * FREQUENCIES)) < 1e-10


def test_a_transfer_matrix_becomes_blocks():
    given = control.tf(
        [[[1.0], [2.0, 1.0]], [[0.0], [3.0]]],
        [[[1.0, 1.0], [1.0, 2.0, 3.0]], [[1.0], [1.0, 4.0]]],
        inputs=["Force", "u[1]"],
        outputs=["x", "F"],
        name="M",
    )
    document = from_control(given)
    assert document.name == "M"
    assert list(document.blocks) == ["Force", "u_1", "M_1_1", "M_1_2", "x", "M_2_2"]
    assert document.outputs == {"x": "x", "F": "M_2_2"}
    back = to_state_space(realized(compile_system(document)))
    np.testing.assert_allclose(back(1j * FREQUENCIES), given(1j * FREQUENCIES), rtol=0, atol=1e-13)


def test_an_interconnection_keeps_its_blocks():
    plant = control.tf([4.0], [1.0, 0.8, 4.0], inputs="u", outputs="y", name="plant")
    law = control.ss([[-2.0]], [[1.0]], [[3.0]], [[0.5]], inputs="e", outputs="u", name="law")
    error = control.summing_junction(["r", "-y"], "e", name="error")
    given = control.interconnect(
        [plant, law, error],
        connections=[["plant.u", "law.u"], ["law.e", "error.e"], ["error.r", ("plant", "y", 0.25)]],
        inplist=["error.r", "error.y"],
        inputs=["r", "noise"],
        outlist=["plant.y", "error.e", ["plant.y", "-law.u"]],
        outputs=["y", "e", "mix"],
        name="rig",
    )
    document = from_control(given)
    assert {"r", "noise", "plant", "law", "error"} <= set(document.blocks)
    assert {document.blocks[name].kind for name in ("plant", "law", "error")} == {"state_space"}
    diagram = compile_system(document)
    assert diagram.inputs == ("r", "noise")
    assert diagram.outputs == ("y", "e", "mix")
    found = to_state_space(realized(diagram))
    np.testing.assert_allclose(found(1j * FREQUENCIES), given(1j * FREQUENCIES), rtol=1e-12, atol=1e-14)


def test_an_output_that_nothing_reaches_is_zero():
    given = control.tf([[[0.0]]], [[[1.0]]], inputs="u", outputs="y", name="nothing")
    back = compile_system(from_control(given)).realize()
    assert back.d11.tolist() == [[0.0]]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (control.tf([1.0], [1.0, 0.5], dt=0.1), "continuous in time, got one sampled with dt = 0.1"),
        (control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], dt=True), "got one sampled with dt = True"),
        (control.nlsys(None, lambda t, x, u, params: u, inputs=1, outputs=1), "got NonlinearIOSystem"),
    ],
)
def test_what_is_not_linear_and_continuous_is_refused(given, message):
    with pytest.raises(DiagramError, match=message):
        from_control(given)


def from_mat(matrices: Matrices) -> dict[str, np.ndarray]:
    return loadmat(io.BytesIO(mat(matrices)))


def test_a_mat_file_holds_matrices_and_names():
    found = from_mat(realized(loop()))
    system = control.ss(found["A"], found["B"], found["C"], found["D"])
    assert difference(system(1j * FREQUENCIES), by_hand(FREQUENCIES)) < 1e-12
    assert [cell[0] for cell in found["inputs"].ravel()] == ["r", "d"]
    assert [cell[0] for cell in found["states"].ravel()][:2] == ["controller.x1", "controller.x2"]
    assert found["delays"].size == 0
    assert found["x0"].shape == (5, 1)


def test_a_mat_file_with_a_delay_holds_the_linear_fractional_form():
    """Closed by hand: w = e^(-s T) z."""
    found = from_mat(realized(loop(delay=0.05)))
    assert "B" not in found
    assert found["delays"].tolist() == [[0.05]]
    expected = by_hand(FREQUENCIES, delay=0.05)
    for k, w in enumerate(FREQUENCIES):
        inverse = np.linalg.inv(1j * w * np.eye(5) - found["A"])
        g11, g12 = (found["C1"] @ inverse @ found[b] + found[d] for b, d in (("B1", "D11"), ("B2", "D12")))
        g21, g22 = (found["C2"] @ inverse @ found[b] + found[d] for b, d in (("B1", "D21"), ("B2", "D22")))
        line = np.diag(np.exp(-1j * w * found["delays"].ravel()))
        closed = g11 + g12 @ line @ np.linalg.solve(np.eye(1) - g22 @ line, g21)
        assert difference(closed, expected[:, :, k]) < 1e-12


def test_a_document_holds_json_numbers():
    document = realized(loop(), open_at="error").document()
    assert document["inputs"] == ["r", "d", "loop"]
    assert document["outputs"] == ["y", "position", "loop"]
    assert np.array(document["A"]).shape == (5, 5)
    assert all(isinstance(value, float) for row in document["D"] for value in row)


@pytest.mark.parametrize("seed", range(6))
def test_random_systems_come_back_digit_for_digit(seed):
    rng = np.random.default_rng(seed)
    n, m, p = (int(k) for k in rng.integers((0, 1, 1), (9, 4, 4)))
    given = control.ss(
        rng.normal(size=(n, n)), rng.normal(size=(n, m)), rng.normal(size=(p, n)), rng.normal(size=(p, m)),
        name="9 Ω", remove_useless_states=False,
    )  # fmt: skip
    matrices = realized(compile_system(from_control(given)))
    there, file, text = to_state_space(matrices), from_mat(matrices), json.loads(json.dumps(matrices.document()))
    for name in "ABCD":
        expected = getattr(given, name)
        assert np.array_equal(getattr(there, name), expected)
        assert np.array_equal(file[name], expected)
        assert np.array_equal(np.reshape(text[name], expected.shape), expected)
