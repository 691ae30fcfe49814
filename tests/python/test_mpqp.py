"""eampc.mpqp: its call, its solution and file, its command."""

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Eampc
from eampc import mpqp
from eampc.errors import UserError
from eampc.mpqp import MpqpError, NotProvedError, Problem, Solution, TimeLimitError
from mpqp_problems import benchmark, random_problem


def solved(problem: Problem, **options: object) -> Solution:
    return mpqp.solve(*problem[:6], (problem.lower, problem.upper), **options)


def line(**changes: object) -> dict[str, object]:
    """min ½u² + p·u, |u| ≤ 1, |p| ≤ 2: u = clip(−p, −1, 1). As plain lists."""
    return {
        "H": [[1]],
        "F": [[1]],
        "f": [0],
        "G": [[1], [-1]],
        "w": [1, 1],
        "S": [[0], [0]],
        "box": ([-2], [2]),
        **changes,
    }


def test_a_saturated_line_as_by_hand() -> None:
    solution = mpqp.solve(**line())
    p = np.linspace(-2.0, 2.0, 41)[:, None]
    np.testing.assert_allclose(solution(p), np.clip(-p, -1.0, 1.0), atol=1e-12)
    assert solution([0.5]).tolist() == pytest.approx([-0.5])
    assert sorted(region.active_set for region in solution.regions) == [(), (0,), (1,)]
    middle = next(region for region in solution.regions if not region.active_set)
    assert middle.gain.tolist() == [[pytest.approx(-1.0)]]
    assert middle.facet_kinds == ("inner", "inner")
    assert all(len(neighbours) == 1 for neighbours in middle.neighbours)
    assert middle.radius == pytest.approx(0.5)
    outer = next(region for region in solution.regions if region.active_set == (0,))
    assert sorted(outer.facet_kinds) == ["box", "inner"]
    assert middle([[0.1], [0.2]]).tolist() == [[pytest.approx(-0.1)], [pytest.approx(-0.2)]]
    assert not solution.has_infeasible_parameters


def test_the_package_gives_the_solver_by_name() -> None:
    import eampc

    assert eampc.mpqp is mpqp
    assert "mpqp" in dir(eampc)


def test_parameters_without_a_solution_are_nan_or_an_error() -> None:
    # |u| ≤ 1 + p: nothing below p = −1.
    solution = mpqp.solve(**line(S=[[1], [1]]))
    assert solution.has_infeasible_parameters
    assert np.isnan(solution([-1.5])).all()
    assert np.isnan(solution([[-1.001], [-0.999]])).tolist() == [[True], [False]]
    assert solution.region_index([[-1.5], [0.0]])[0] == -1
    with pytest.raises(MpqpError, match=r"no solution at p = \[-1.5\] \(row 1\)"):
        solution([[0.0], [-1.5]], strict=True)
    kinds = [kind for region in solution.regions for kind in region.facet_kinds]
    assert kinds.count("infeasible") == 1


def test_a_row_without_u_bounds_the_parameters() -> None:
    solution = mpqp.solve(
        **line(G=[[1], [-1], [0]], w=[1, 1, 1.5], S=[[0], [0], [-1]])  # p ≤ 1.5
    )
    kinds = [kind for region in solution.regions for kind in region.facet_kinds]
    assert kinds.count("parameter row") == 1
    assert np.isnan(solution([[1.4], [1.6]])).tolist() == [[False], [True]]


def test_rows_may_be_missing_altogether() -> None:
    solution = mpqp.solve(**line(G=np.empty((0, 1)), w=[], S=np.empty((0, 1))))
    assert len(solution.regions) == 1
    assert solution([1.7]).tolist() == pytest.approx([-1.7])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"H": [[0]]}, "H must be positive definite"),
        ({"H": [[-1]]}, "H must be positive definite"),
        ({"H": [[1, 0]]}, r"H must have shape \(1, 1\)"),
        ({"H": 1.0}, "H must be an array, not a single number"),
        ({"H": [["a"]]}, "H must be an array of real numbers"),
        ({"f": [[0]]}, "f must be a vector"),
        ({"f": []}, "nothing to optimise"),
        ({"F": [[np.nan]]}, "F must hold finite numbers only"),
        ({"w": [1]}, r"G must have shape \(1, 1\)"),
        ({"w": [-1, -1]}, "no parameter of the box has a feasible solution"),
        ({"box": ([2], [-2])}, "lower must be below upper for every parameter, but parameter 0"),
        ({"box": ([0], [0])}, "leave out a parameter that is fixed"),
        ({"box": 3}, r"box must be a pair \(lower, upper\)"),
        ({"box": ([-2], [2, 3])}, r"upper must have shape \(1,\)"),
        ({"box": ([-1] * 9, [1] * 9)}, "box must have 1 to 8 parameters, not 9"),
        ({"threads": -1}, "threads must be at least 0"),
        ({"time_limit_s": 0.0}, "time_limit_s must be above zero"),
    ],
)
def test_what_does_not_make_a_problem_is_one_sentence(
    changes: dict[str, object], sentence: str
) -> None:
    with pytest.raises(MpqpError, match=sentence) as refusal:
        mpqp.solve(**line(**changes))
    assert isinstance(refusal.value, ValueError)
    assert isinstance(refusal.value, UserError)
    assert "\n" not in str(refusal.value)


def test_an_unsymmetric_or_semidefinite_H_is_refused() -> None:
    two = {"F": [[1], [0]], "f": [0, 0], "G": [[1, 0], [0, 1]]}
    with pytest.raises(MpqpError, match=r"symmetric; pass \(H \+ H.T\)/2"):
        mpqp.solve(**line(H=[[1, 1], [0, 1]], **two))
    with pytest.raises(MpqpError, match="positive definite"):
        mpqp.solve(**line(H=[[1, 1], [1, 1]], **two))


@pytest.mark.parametrize(
    ("p", "sentence"),
    [
        ([0.0, 1.0], "p must have 1 entries per row"),
        ([[[0.0]]], "p must have 1 entries per row"),
        ([np.inf], "p must hold finite numbers"),
        ([[0.0], [2.1]], r"p = \[2.1\] \(row 1\) lies outside the box"),
    ],
)
def test_what_is_no_parameter_is_one_sentence(p: object, sentence: str) -> None:
    solution = mpqp.solve(**line())
    with pytest.raises(MpqpError, match=sentence):
        solution(p)


@pytest.mark.parametrize(
    "problem",
    [benchmark("p5", 10, 2.0), benchmark("p5", 15, 2.0), random_problem(318), random_problem(5)],
    ids=["p5 N=10", "p5 N=15", "slivers", "dense"],
)
def test_threads_do_not_change_a_bit(problem: Problem) -> None:
    one, two, three = (solved(problem, threads=threads) for threads in (1, 2, 3))
    for key, array in one.arrays.items():
        assert array.tobytes() == two.arrays[key].tobytes(), key
        assert array.tobytes() == three.arrays[key].tobytes(), key


def test_saved_and_loaded_it_is_the_same(tmp_path: Path) -> None:
    solution = solved(benchmark("p3", 10, 2.0))
    solution.save(tmp_path / "solution.npz")
    loaded = mpqp.load(tmp_path / "solution.npz")
    assert loaded.statistics == solution.statistics
    for key, array in solution.arrays.items():
        assert array.tobytes() == loaded.arrays[key].tobytes(), key
    for mine, theirs in zip(solution.problem, loaded.problem, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    p = np.random.default_rng(1).uniform(loaded.problem.lower, loaded.problem.upper, (100, 3))
    np.testing.assert_array_equal(loaded(p), solution(p))
    assert len(loaded.regions[1:4]) == 3
    assert loaded.regions[-1].active_set == solution.regions[len(solution.regions) - 1].active_set
    with pytest.raises(IndexError):
        loaded.regions[len(loaded.regions)]


def spoil(path: Path, **changes: Callable[[np.ndarray], np.ndarray]) -> None:
    with np.load(path) as archive:
        arrays = dict(archive)
    for key, change in changes.items():
        arrays[key] = change(arrays[key])
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    "change",
    [
        {"neighbours": lambda a: a + 1000},
        {"facet_first": lambda a: a[:-1]},
        {"facet_first": lambda a: a[::-1]},
        {"facet_normals": lambda a: a[:, :1]},
        {"facet_kinds": lambda a: a[1:]},
        {"gain": lambda a: a[1:]},
        {"active_first": lambda a: a + 1},
        {"facet_offsets": lambda a: a * np.nan},
        {"problem_H": lambda a: -a[:1]},
        {"format": lambda a: np.array("other")},
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_damaged_solution_is_refused(
    tmp_path: Path, change: dict[str, Callable[[np.ndarray], np.ndarray]]
) -> None:
    path = tmp_path / "solution.npz"
    solved(benchmark("p3", 3, 2.0)).save(path)
    spoil(path, **change)
    with pytest.raises(MpqpError, match="solve it again") as refusal:
        mpqp.load(path)
    assert str(path) in str(refusal.value)


def test_progress_is_told_and_can_cancel() -> None:
    told: list[tuple[int, int, int]] = []
    problem = benchmark("p5", 20, 2.0)
    solved(problem, progress=lambda done, known: told.append((done, known, threading.get_ident())))
    assert told[-1][:2] == (2217, 2217)
    assert {ident for *_, ident in told} == {threading.get_ident()}
    with pytest.raises(mpqp.Cancelled):
        solved(problem, progress=lambda done, known: False)
    with pytest.raises(ZeroDivisionError):
        solved(problem, progress=lambda done, known: 1 // 0)


def test_other_threads_run_meanwhile() -> None:
    counted = 0
    stop = threading.Event()

    def count() -> None:
        nonlocal counted
        while not stop.is_set():
            counted += 1
            time.sleep(0.0)

    other = threading.Thread(target=count)
    other.start()
    before = counted
    solved(benchmark("p5", 20, 2.0), threads=1)
    during = counted - before
    stop.set()
    other.join()
    assert during > 0


def test_limits_are_kept() -> None:
    problem = benchmark("p5", 20, 2.0)
    with pytest.raises(TimeLimitError, match="the time limit is over with") as over:
        solved(problem, time_limit_s=1e-9)
    assert over.value.exit_code == 1
    with pytest.raises(NotProvedError, match="more than 100 critical regions"):
        solved(problem, max_regions=100)


def write_problem(path: Path, problem: Problem, **changes: object) -> None:
    np.savez(path, **{**problem._asdict(), **changes})


def test_command_solves_a_file(eampc: Eampc, tmp_path: Path) -> None:
    write_problem(tmp_path / "p.npz", benchmark("p3", 10, 2.0))
    run = eampc("mpqp", tmp_path / "p.npz", "-o", tmp_path / "s.npz", "--json", "--threads", 2)
    assert run.returncode == 0, run.stderr
    figures = json.loads(run.stdout)
    assert (figures["regions"], figures["parameters"], figures["rows"]) == (126, 3, 60)
    assert len(mpqp.load(tmp_path / "s.npz").regions) == 126
    run = eampc("mpqp", tmp_path / "p.npz")
    assert run.returncode == 0
    assert "regions" in run.stdout
    assert "126" in run.stdout


def test_command_tells_bad_input_in_one_sentence(eampc: Eampc, tmp_path: Path) -> None:
    problem = benchmark("p3", 3, 2.0)
    write_problem(tmp_path / "p.npz", problem, H=-problem.H)
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "short.npz", H=problem.H)
    np.savez(tmp_path / "pickled.npz", **{**problem._asdict(), "H": np.array([{}])})
    for arguments, code, sentence in [
        (["p.npz"], 2, "H must be positive definite"),
        (["none.npz"], 2, "there is no such file"),
        (["text.npz"], 2, "not an .npz archive"),
        (["pickled.npz"], 2, "not an .npz archive"),
        (["short.npz"], 2, "F, f, G, w, S, lower, upper missing"),
        (["p.npz", "-o", tmp_path / "no" / "s.npz"], 2, "does not exist; make it first"),
    ]:
        run = eampc("mpqp", tmp_path / arguments[0], *arguments[1:])
        assert run.returncode == code, run.stderr
        assert sentence in run.stderr
        assert len(run.stderr.strip().splitlines()) == 1
    write_problem(tmp_path / "p.npz", problem)
    run = eampc("mpqp", tmp_path / "p.npz", "--time-limit", "1e-9")
    assert run.returncode == 1
    assert "the time limit is over" in run.stderr
