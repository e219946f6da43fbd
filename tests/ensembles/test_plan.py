import numpy as np
import pytest

from gough.ensembles import Column, Coordinate, Plan
from gough.ensembles.plan import differences
from gough.errors import ConfigurationError


def make(rows=20, chunk=6, column=None, coords=None, origin=None):
    columns = {"x": column or Column((2,), dims=("leg",))}
    return Plan(rows, chunk, columns, coords or {}, origin or {})


@pytest.mark.parametrize(("rows", "chunk"), [(1, 1), (7, 3), (9, 3), (5, 100)])
def test_chunks_cover_all_rows_once(rows, chunk):
    plan = make(rows, chunk)
    seen = [row for k in range(plan.chunks) for row in range(*plan.bounds(k))]
    assert seen == list(range(rows))


@pytest.mark.parametrize(
    "other",
    [
        {"rows": 21},
        {"chunk": 7},
        {"column": Column((3,), dims=("leg",))},
        {"column": Column((2,), "f4", dims=("leg",))},
        {"column": Column((2,), unit="m", dims=("leg",))},
        {"column": Column((2,), dims=("arm",))},
        {"coords": {"leg": Coordinate([0, 1])}},
        {"origin": {"seed": 1}},
        {"origin": {"seed": 1.0}},
        {"origin": {"seed": True}},
    ],
)
def test_the_digest_tells_apart_what_gives_other_numbers(other):
    assert make(**other).digest != make().digest
    assert make(origin={"seed": 1}).digest != make(origin={"seed": 1.0}).digest


def test_the_digest_sees_values_of_coordinates():
    first, second = ({"leg": Coordinate([0.0, x])} for x in (1.0, np.nextafter(1.0, 2.0)))
    assert make(coords=first).digest != make(coords=second).digest


def test_the_digest_ignores_words_order_and_containers():
    plain = make(column=Column((2,), dims=("leg",)), origin={"a": [1, 2], "b": 0.5})
    other = make(
        column=Column((2,), dims=("leg",), about="x"),
        origin={"b": np.float64(0.5), "a": (1, np.int32(2))},
    )
    assert plain.digest == other.digest


def test_a_plan_can_not_be_changed():
    given = {"deep": [1]}
    values = np.zeros(2)
    plan = make(coords={"leg": Coordinate(values)}, origin=given)
    before = plan.digest
    given["deep"].append(2)
    values[0] = 1
    assert (
        plan.digest
        == before
        == make(coords={"leg": Coordinate([0.0, 0.0])}, origin={"deep": [1]}).digest
    )
    with pytest.raises(TypeError):
        plan.columns["y"] = Column()
    with pytest.raises(ValueError, match="read-only"):
        plan.coords["leg"].array[0] = 1
    with pytest.raises(AttributeError):
        plan.rows = 3


@pytest.mark.parametrize(
    ("origin", "words"),
    [
        ({"tol": {"x": float("nan")}}, "origin.tol.x is nan"),
        ({"list": [1, object()]}, r"origin.list\[1\] is a object"),
        ({1: 2}, "key 1"),
    ],
)
def test_an_origin_is_json(origin, words):
    with pytest.raises(ConfigurationError, match=words):
        make(origin=origin)


@pytest.mark.parametrize("name", ["", "a/b", "a b", "..", ".x", "done", "zarr.json/", "__x.", "1x"])
def test_names_fit_folders(name):
    with pytest.raises(ConfigurationError, match="can not name"):
        Plan(3, 1, {name: Column()})


@pytest.mark.parametrize(
    ("make_it", "words"),
    [
        (lambda: Plan(0, 1, {"x": Column()}), "0 rows"),
        (lambda: Plan(3, 0, {"x": Column()}), "chunks of 0"),
        (lambda: Plan(3, 1, {}), "no columns"),
        (lambda: Plan(3, 1, {"x": Column()}, {"x": Coordinate([1])}), "both a column"),
        (lambda: make(coords={"leg": Coordinate([1, 2, 3])}), r"shape \(3,\)"),
        (lambda: make(coords={"arm": Coordinate([1, 2])}), "no column has it"),
        (lambda: Plan(3, 1, {"x": Column((3,), dims=("row",))}), "can not have a dimension"),
        (
            lambda: Plan(3, 1, {"x": Column((3,), dims=("a",)), "y": Column((2,), dims=("a",))}),
            "has 2 entries, elsewhere 3",
        ),
        (lambda: Column((0,)), "sizes from 1"),
        (lambda: Column((2, 2), dims=("a",)), "do not fit"),
        (lambda: Column((), "O"), "can not hold object"),
        (lambda: Coordinate([None]), "can not hold object"),
    ],
)
def test_refusals(make_it, words):
    with pytest.raises(ConfigurationError, match=words):
        make_it()


def test_differences_name_entries():
    there = {"a": {"tol": 1e-6, "old": 1}, "list": [1, 2], "same": 0}
    here = {"a": {"tol": 1e-8}, "list": [1, 3], "same": 0, "new": "x"}
    assert list(differences(there, here)) == [
        "a.old: 1 there, nothing here",
        "a.tol: 1e-06 there, 1e-08 here",
        "list[1]: 2 there, 3 here",
        'new: nothing there, "x" here',
    ]
