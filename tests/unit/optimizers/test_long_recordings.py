"""Long recordings: what is computed piece by piece is what numpy and scipy compute at once, and a search ends when it must."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, lfilter

from optimizers.black_box import black_box
from optimizers.black_box.continuous import Discrete
from optimizers.black_box.output_error import OutputError
from optimizers.estimation.tall import solved, triangle
from optimizers.problem import ProblemError
from optimizers.recorded.recording import RecordedExperiment, Recording
from optimizers.search.result import Status

H = 0.002


@pytest.mark.parametrize("rows", [5, 256, 257, 7000])
def test_triangles_solve_as_lstsq_does(rows):
    rng = np.random.default_rng(rows)
    table, wanted = rng.normal(size=(rows, 4)), rng.normal(size=(rows, 3))
    table[:, 3] = table[:, 0] - 2 * table[:, 1]  # a direction that is not seen
    corner = triangle(np.concatenate([table, wanted], axis=1))
    found, left = solved(corner, 4)
    expected = np.linalg.lstsq(table, wanted, rcond=1e-12)[0]
    np.testing.assert_allclose(table @ found, table @ expected, atol=1e-10)
    apart = wanted - table @ expected
    np.testing.assert_allclose(left.T @ left, apart.T @ apart, atol=1e-9)


@pytest.mark.parametrize("samples", [1, 255, 256, 1000])
def test_simulations_in_pieces_are_those_of_scipy(samples):
    rng = np.random.default_rng(1)
    a = np.array([[0.9, 0.3, 0.0], [-0.3, 0.9, 0.1], [0.0, 0.0, 0.5]])
    b, c, d = rng.normal(size=(3, 2)), rng.normal(size=(2, 3)), rng.normal(size=(2, 2))
    x0, u = rng.normal(size=3), rng.normal(size=(2, samples))
    _, expected, _ = dlsim((a, b, c, d, 1.0), u.T, x0=x0)
    np.testing.assert_allclose(Discrete(a=a, b=b, c=c, d=d, x0=x0).simulate(u), expected.T, atol=1e-11)


def recorded(samples: int, noise: float = 0.05) -> RecordedExperiment:
    """Return a resonance with a delay of 25 samples, by scipy's triangle hold: the input is in straight lines."""
    rng = np.random.default_rng(2)
    levels = np.append(0.0, rng.normal(size=samples // 20 + 1))
    u = np.interp(np.arange(samples), 20 * np.arange(levels.size), levels)
    b, a, _ = cont2discrete(([900.0], [1.0, 12.0, 900.0]), H, method="foh")
    y = lfilter(b[0], a, np.concatenate([np.zeros(25), u[:-25]])) + noise * rng.normal(size=samples)
    return RecordedExperiment(recording=Recording(inputs={"u": u}, outputs={"y": y}, sample_time=H), split=0.7)


def test_a_long_recording_is_fitted_whole_and_its_liveliest_part_begins():
    found = black_box(recorded(60_000), method="transfer_function", orders=(1, 2, 3), largest_delay=0.1)
    # of numerators with three terms those that begin earlier hold the later ones
    assert found.order == 2
    assert 23 <= round(found.delay / H) <= 25
    poles = np.sort_complex(found.system.poles)
    np.testing.assert_allclose(poles, np.sort_complex(np.roots([1.0, 12.0, 900.0])), rtol=5e-3)
    assert found.warnings == ()


def test_an_input_before_the_samples_is_known():
    """The delayed input of a stretch within a recording is not 0 before it."""
    rng = np.random.default_rng(3)
    u = rng.normal(size=600)
    y = lfilter([0.0, 0.5], [1.0, -0.5], np.concatenate([np.zeros(30), u[:-30]]))
    stretch = OutputError(u[70:600], y[100:600], offset=False, lead=30)
    assert stretch.left(np.array([-0.5]), 30) < 1e-12


class _Impatient:
    """A monitor that wants an end after so many questions."""

    def __init__(self, most: int) -> None:
        self.left = most

    def progress(self, fraction: float, message: str) -> None:
        pass

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        pass

    def cancelled(self) -> bool:
        self.left -= 1
        return self.left < 0


def test_a_search_that_is_ended_gives_the_orders_until_then():
    experiment = recorded(3000)
    whole = black_box(experiment, method="transfer_function", orders=(2, 5), largest_delay=0.1)
    counter = _Impatient(10**9)
    black_box(experiment, method="transfer_function", orders=(2,), largest_delay=0.1, monitor=counter)
    asked = 10**9 - counter.left
    ended = black_box(
        experiment, method="transfer_function", orders=(2, 5), largest_delay=0.1, monitor=_Impatient(asked + 10)
    )
    assert ended.status is Status.CANCELLED
    assert [one.order for one in ended.tried] == [2]
    assert ended.delay == whole.tried[0].delay
    with pytest.raises(ProblemError, match="ended before the first"):
        black_box(experiment, method="transfer_function", largest_delay=0.1, monitor=_Impatient(3))
