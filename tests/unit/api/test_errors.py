"""One table: what each exception leaves the service as."""

from __future__ import annotations

import pytest
from numpy.linalg import LinAlgError
from sqlalchemy.exc import OperationalError

from api.http.handlers import _let_go
from api.problems.documents import Problem, at, invalid
from api.problems.exceptions import problem_of
from api.problems.faults import sentence
from engine.model.errors import DiagramError, ExpressionError, IllPosedError, SignalError
from optimizers.problem import ProblemError
from storage import errors as storage


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (DiagramError("x", at=("blocks", "a")), 422),
        (ExpressionError("x"), 422),
        (SignalError("x"), 422),
        (IllPosedError("x", ports=("a.out",)), 422),
        (ProblemError("x", at=("goals", 0)), 422),
        (storage.NotFoundError("system", "sys_1"), 404),
        (storage.RevisionConflictError("sys_1", expected=1, actual=2), 412),
        (storage.StateError("x"), 409),
        (storage.MissingSegmentsError("ds_1", ["a"]), 409),
        (storage.ChecksumError("x", expected="a", actual="b"), 422),
        (storage.InvalidCursorError("x"), 422),
        (storage.IdempotencyMismatchError("x"), 422),
        (storage.IdempotencyRunningError("x"), 409),
        (storage.DocumentError("x"), 422),
        (LinAlgError("Singular matrix"), 422),
        (OperationalError("SELECT 1", {}, Exception("gone")), 503),
    ],
)
def test_every_foreseen_exception_has_a_problem(error, status) -> None:
    problem = problem_of(error)
    assert problem is not None
    document = problem.document()
    assert document["status"] == problem.status == status
    assert document["type"].startswith("urn:servotune:problem:")
    assert document["title"]
    assert document["detail"]


@pytest.mark.parametrize(
    "error",
    [storage.IdempotencyRunningError("x"), OperationalError("SELECT 1", {}, Exception("gone"))],
)
def test_what_passes_by_itself_says_when_to_come_again(error) -> None:
    problem = problem_of(error)
    assert problem is not None
    assert int(problem.headers["Retry-After"]) > 0


def test_an_unforeseen_exception_has_none() -> None:
    assert problem_of(ZeroDivisionError()) is None


def test_the_database_error_does_not_show_the_statement() -> None:
    problem = problem_of(OperationalError("SELECT secret", {}, Exception("gone")))
    assert problem is not None
    assert "secret" not in str(problem.document())


def test_a_place_in_the_system_becomes_a_pointer_from_the_root_of_the_body() -> None:
    with pytest.raises(Problem) as caught, at("system"):
        raise DiagramError("area must be > 0 m**2, got -1", at=("blocks", "motor", "area"))
    assert caught.value.document()["errors"] == [
        {"pointer": "/system/blocks/motor/area", "detail": "area must be > 0 m**2, got -1"}
    ]


def test_an_ill_posed_loop_names_its_ports() -> None:
    problem = problem_of(IllPosedError("no solution", at=("blocks", "a"), ports=("a.out", "b.out")))
    assert problem is not None
    assert problem.document()["ports"] == ["a.out", "b.out"]


def test_places_nest() -> None:
    assert invalid("x", "b").within("a").document()["errors"][0]["pointer"] == "/a/b"


def test_what_was_got_is_shown_without_writing_all_of_it() -> None:
    """A field that is missing in a large body comes with that body, fifty times: each writing of it all was a part of a second."""

    class Counted(dict):
        asked = 0

        def items(self):
            for item in super().items():
                Counted.asked += 1
                yield item

        __repr__ = None

    got = Counted((f"k{number}", [number]) for number in range(10_000))
    said = sentence("gain", {"type": "float_type", "msg": "", "input": got})
    assert said == "gain must be a number, got " + repr(dict(got))[:77] + "..."
    assert sentence("gain", {"type": "missing", "msg": "", "input": got}) == "gain must be given"
    assert Counted.asked < 100


@pytest.mark.parametrize(
    "value", [{"a": [1, {"b": None}], "c": {}}, [], "it's", 0.5, True, "x" * 79, [[1, 2], ["y" * 200]]]
)
def test_a_value_is_shown_as_it_is_or_by_its_beginning(value) -> None:
    whole = repr(value)
    shown = whole if len(whole) <= 80 else whole[:77] + "..."
    assert sentence("gain", {"type": "other", "msg": "no", "input": value}) == f"gain: no, got {shown}"


def test_an_error_that_is_its_own_cause_by_a_way_round_is_let_go_too() -> None:
    """A refusal that was raised again from what it had caused held its thread for ever."""
    first, second = Problem(422, "x", "x"), ValueError("y")
    first.__cause__, second.__cause__ = second, first
    _let_go(first)
    assert first.__traceback__ is None
