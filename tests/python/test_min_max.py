"""Min-max MPC against what needs no cleverness: every vertex, simulated, and an online solver."""

from dataclasses import replace
from functools import cache
from itertools import product

import daqp
import numpy as np
import pytest
from eampc import DesignError, Law, Rig, design, load_rig
from eampc.reproduce.min_max_control import MinMaxControl
from eampc.reproduce.min_max_problem import MinMaxProblem
from eampc.reproduce.worst_disturbance import WorstDisturbance
from ready_rigs import RIGS

CASES = ("paper-case1", "paper-case2")


@cache
def rig_and_law(name: str, horizon: int, tightening: bool = True) -> tuple[Rig, Law]:
    overrides = {"control.horizon": horizon, "control.control_horizon": horizon}
    if not tightening:
        overrides |= {
            "tightening.kind": "none",
            "tightening.disturbance_max_rad_s2": "absent",
            "tightening.disturbance_rate_max_rad_s3": "absent",
        }
    rig = load_rig(RIGS / name, overrides=overrides)
    return rig, design(rig)


def problem_of(name: str, horizon: int, **changes: float) -> MinMaxProblem:
    return replace(MinMaxProblem.of_rig(*rig_and_law(name, horizon)), **changes)


def all_vertices(problem: MinMaxProblem) -> np.ndarray:
    """(2^N, N) disturbance sequences, rad/s²."""
    signs = np.array(list(product((-1.0, 1.0), repeat=problem.horizon)))
    return problem.disturbance_max_rad_s2 * signs


def simulated(problem: MinMaxProblem, state: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """(2^N, N, 2): the states of every vertex sequence."""
    sequences = all_vertices(problem)
    x = np.tile(state, (len(sequences), 1))
    states = []
    for i in range(problem.horizon):
        x = x @ problem.A_star.T + problem.B_star * moves[min(i, problem.moves - 1)]
        x = x + sequences[:, [i]] * problem.disturbance_column
        states.append(x)
    return np.stack(states, axis=1)


def vertex_costs(problem: MinMaxProblem, state: np.ndarray, moves: np.ndarray) -> np.ndarray:
    angles = simulated(problem, state, moves)[:, :, 0]
    held = np.minimum(np.arange(problem.horizon), problem.moves - 1)
    of_angles = (angles - problem.reference_rad) ** 2
    return (
        problem.weight_angle * (of_angles.sum(axis=1) + (state[0] - problem.reference_rad) ** 2)
        + problem.weight_control * (moves[held] ** 2).sum()
    )


def states_near_the_reference(problem: MinMaxProblem, count: int, seed: int) -> np.ndarray:
    """Where the signs of the worst vertex are mixed, and further off."""
    random = np.random.default_rng(seed)
    spread = 10.0 ** random.uniform(-4.0, -0.3, size=(count, 1))
    offsets = spread * random.normal(size=(count, 2)) * np.array([1.0, 3.0])
    return offsets + np.array([problem.reference_rad, 0.0])


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("horizon", [1, 4, 9, 12])
def test_worst_case_is_the_maximum_over_every_vertex(name: str, horizon: int) -> None:
    problem = problem_of(name, horizon)
    worst_disturbance = WorstDisturbance(problem)
    nominal = np.zeros(horizon)
    random = np.random.default_rng(5)
    seen = set()
    for state in states_near_the_reference(problem, 12, seed=horizon):
        moves = random.uniform(-1.0, 1.0, horizon) * problem.control_max
        angles = problem.undisturbed_angles(state, moves)
        worst = worst_disturbance.at(angles - problem.reference_rad)
        costs = vertex_costs(problem, state, moves)
        base = problem.cost(state, moves, nominal)
        assert base + worst.excess == pytest.approx(costs.max(), rel=1e-10)
        sequence = problem.disturbance_max_rad_s2 * worst.signs
        assert problem.cost(state, moves, sequence) == pytest.approx(costs.max(), rel=1e-10)
        seen.add(tuple(worst.signs))
    assert len(seen) > 1, "every state had the same worst vertex: nothing was chosen"


def test_no_point_inside_the_box_is_worse_than_the_vertex() -> None:
    problem = problem_of("paper-case1", 8)
    random = np.random.default_rng(6)
    control = MinMaxControl(problem)
    for state in states_near_the_reference(problem, 10, seed=8):
        step = control.step(state)
        base = problem.cost(state, step.moves, np.zeros(8))
        for _ in range(200):
            inside = problem.disturbance_max_rad_s2 * random.uniform(-1.0, 1.0, 8)
            excess = problem.cost(state, step.moves, inside) - base
            assert excess <= step.worst.excess + 1e-12


def full_epigraph(problem: MinMaxProblem, state: np.ndarray) -> tuple[float, np.ndarray]:
    """(worst cost, moves) by DAQP with a row for each of the 2^N vertices and no slack.

    Hessian and slopes come from `cost` at unit moves: a quadratic is known by its values.
    """
    n, zero = problem.moves, np.zeros(problem.moves)
    unit, still = np.eye(n), np.zeros(problem.horizon)

    def cost(moves: np.ndarray) -> float:
        return problem.cost(state, moves, still)

    base = cost(zero)
    single = np.array([cost(unit[i]) for i in range(n)])
    hessian = np.array(
        [[cost(unit[i] + unit[j]) - single[i] - single[j] + base for j in range(n)]
         for i in range(n)]
    )  # fmt: skip
    slope = single - base - 0.5 * np.diag(hessian)
    at_zero = vertex_costs(problem, state, zero) - base
    rows = np.array(
        [vertex_costs(problem, state, unit[i]) - single[i] - at_zero for i in range(n)]
    ).T
    H = np.block([[hessian, np.zeros((n, 1))], [np.zeros((1, n)), 1e-9 * np.ones((1, 1))]])
    A = np.hstack([rows, -np.ones((len(rows), 1))])
    limits = np.append(np.full(n, problem.control_max), 1e30)
    upper = np.concatenate([limits, -at_zero])
    lower = np.concatenate([-limits, np.full(len(rows), -1e30)])
    solution, _, exit_flag, _ = daqp.solve(
        H, np.append(slope, 1.0), A, upper, lower, np.zeros(len(upper), dtype=np.int32)
    )
    assert exit_flag == 1
    moves = solution[:n]
    return float(vertex_costs(problem, state, moves).max()), moves


@pytest.mark.parametrize("name", CASES)
def test_is_the_solution_with_every_vertex_at_once(name: str) -> None:
    """States where the state bounds do not matter; half of them have several active vertices."""
    problem = problem_of(name, 7)
    control = MinMaxControl(problem)
    compared = 0
    for state in states_near_the_reference(problem, 60, seed=3):
        step = control.step(state)
        expected, moves = full_epigraph(problem, state)
        reached = vertex_costs(problem, state, step.moves).max()
        assert reached == pytest.approx(expected, rel=1e-6, abs=1e-9)
        assert abs(step.control - moves[0]) < 1e-3 * problem.control_max
        compared += len(step.vertices) > 1
    assert compared > 5


@pytest.mark.parametrize("name", CASES)
def test_bounds_hold_for_every_vertex_and_are_reached_by_one(name: str) -> None:
    """At full speed the velocity bound, in a narrow range the angle bound."""
    reached = 0
    for changes, states in (
        ({"velocity_max_rad_s": 1.5}, np.linspace([-1.0, -1.3], [1.0, 1.3], 9)),
        ({"angle_max_rad": 0.3, "reference_rad": 0.6}, np.linspace([-0.2, 0.5], [0.25, 0.8], 9)),
    ):
        # Dear enough an error that the moves go as far as they may.
        problem = problem_of(name, 8, weight_angle=1e5, **changes)
        outer = np.array([problem.angle_max_rad, problem.velocity_max_rad_s])
        control = MinMaxControl(problem)
        for state in states:
            step = control.step(state)
            if step.slack > 1e-7:
                continue
            assert np.abs(step.moves).max() <= problem.control_max * (1.0 + 1e-7)
            largest = (np.abs(simulated(problem, state, step.moves)) / outer).max(axis=(0, 1))
            assert largest.max() <= 1.0 + 1e-6
            reached += largest.max() > 1.0 - 1e-5
    assert reached >= 3


@pytest.mark.parametrize("name", CASES)
def test_without_disturbance_it_is_the_laws_problem(name: str) -> None:
    """Ω = {0}, no tightening: the QP of the explicit law, solved by DAQP at σ̂ = 0."""
    _, law = rig_and_law(name, 20, tightening=False)
    with_bound = load_rig(RIGS / name)
    problem = replace(MinMaxProblem.of_rig(with_bound, law), disturbance_max_rad_s2=0.0)
    control = MinMaxControl(problem)
    random = np.random.default_rng(9)
    qp = law.problem
    violated = 0
    for _ in range(40):
        state = random.uniform(-1.0, 1.0, 2) * np.array([2.0, 5.0])
        p = np.array([*state, 0.0, 0.0])
        rows = qp.w + qp.S @ p
        solution, _, exit_flag, _ = daqp.solve(
            qp.H, qp.F @ p + qp.f, qp.G, rows, np.full_like(rows, -1e30),
            np.zeros(len(rows), dtype=np.int32), primal_tol=1e-9,
        )  # fmt: skip
        assert exit_flag == 1
        step = control.step(state)
        assert step.control == pytest.approx(solution[0], abs=1e-4 * problem.control_max)
        assert step.slack == pytest.approx(solution[-1], abs=1e-6)
        assert step.worst.excess == 0.0
        violated += solution[-1] > 1e-4
    assert 0 < violated < 40


def test_what_is_kept_between_steps_does_not_change_a_step() -> None:
    problem = problem_of("paper-case2", 20)
    running = MinMaxControl(problem)
    for state in np.linspace([1.0, 0.0], [0.5, 0.0], 60):
        kept = running.step(state)
        fresh = MinMaxControl(problem).step(state)
        assert kept.control == pytest.approx(fresh.control, abs=1e-3)
        base = problem.cost(state, kept.moves, np.zeros(20)) + kept.worst.excess
        again = problem.cost(state, fresh.moves, np.zeros(20)) + fresh.worst.excess
        assert base == pytest.approx(again, rel=1e-6)


def test_a_held_last_move_counts_in_every_stage() -> None:
    """Fewer free moves than stages: never better than with all of them."""
    free = problem_of("paper-case1", 8)
    held = replace(free, moves=3)
    state = np.array([0.2, -0.5])
    costs = []
    for problem in (free, held):
        step = MinMaxControl(problem).step(state)
        costs.append(vertex_costs(problem, state, step.moves).max())
        epigraph = problem.cost(state, step.moves, np.zeros(8)) + step.epigraph
        assert epigraph == pytest.approx(costs[-1], rel=1e-6)
    assert costs[0] <= costs[1]


def test_refuses_what_it_has_no_counterpart_for() -> None:
    _, law = rig_and_law("paper-case1", 20)
    with pytest.raises(DesignError, match="counterpart of the formulation paper"):
        MinMaxProblem.of_rig(load_rig(RIGS / "paper-case1", "tracking"), law)
    with pytest.raises(DesignError, match=r"set tightening\.disturbance_max_rad_s2"):
        MinMaxProblem.of_rig(*rig_and_law("paper-case1", 20, tightening=False))
    rough = load_rig(
        RIGS / "paper-case1",
        overrides={"tightening.disturbance_max_rad_s2": 60.0,
                   "tightening.disturbance_rate_max_rad_s3": 1.0},
    )  # fmt: skip
    with pytest.raises(DesignError, match="no room within"):
        MinMaxProblem.of_rig(rough, law)
