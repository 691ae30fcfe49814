"""`eampc reproduce`: every file of a short run, and the closed loops against what they must settle
on.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from eampc import Rig, _core, load_rig, simulate
from eampc.reproduce.min_max_control import MinMaxControl
from eampc.reproduce.min_max_problem import MinMaxProblem
from eampc.reproduce.paper_cases import CASES
from eampc.reproduce.paper_runs import CaseResult, run_case
from eampc.reproduce.paper_tables import time_table
from eampc.simulation import simulated_plant
from ready_rigs import RIGS, law_of, rig_of

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def short_run(eampc, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """Both cases, two runs of 0.3 s."""
    folder = tmp_path_factory.mktemp("paper") / "made"
    done = eampc("reproduce", "-o", folder, "--seconds", 0.3, "--runs", 2, "--json")
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_writes_figures_2_to_9_and_the_page(short_run: tuple[Path, dict]) -> None:
    folder, printed = short_run
    figures = {f"figure{k}.png" for k in range(2, 10)}
    assert {file.name for file in folder.iterdir()} == figures | {
        "index.html",
        "README.md",
        "summary.json",
    }
    for name in figures:
        data = (folder / name).read_bytes()
        assert data.startswith(PNG)
        assert len(data) > 10_000, f"{name} is nearly empty"
    assert printed["page"] == str(folder / "index.html")
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert printed == {"page": printed["page"], **summary}


def test_page_needs_no_other_file(short_run: tuple[Path, dict]) -> None:
    page = (short_run[0] / "index.html").read_text(encoding="utf-8")
    sources = re.findall(r'(?:src|href)="([^"]{0,40})', page)
    assert len(sources) == 8
    assert all(source.startswith("data:image/png;base64,") for source in sources)


def test_page_puts_our_times_beside_the_papers(short_run: tuple[Path, dict]) -> None:
    folder, summary = short_run
    text = (folder / "README.md").read_text(encoding="utf-8")
    for number in ("161.57", "164.05", "7.05", "159.17", "160.16", "6.58"):
        assert f"| {number} |" in text
    assert "k_a of Table I is taken for k_u" in text
    for case in summary["cases"].values():
        assert case["steps"] == 60
        times = case["processor_time_s"]
        for ratio, slow, fast in zip(
            case["ratio"], times["min_max"], times["tracking"], strict=True
        ):
            assert ratio == pytest.approx(slow / fast)
        for name in ("tracking_whole_cycle", "paper", "paper_whole_cycle", "min_max_in_clarabel"):
            assert len(times[name]) == 2
            assert min(times[name]) > 0.0
        assert case["settles"] is None


def test_one_case_alone(eampc, tmp_path: Path) -> None:
    done = eampc("reproduce", "--case", 2, "-o", tmp_path, "--seconds", 0.1, "--runs", 1)
    assert done.returncode == 0, done.stderr
    assert sorted(file.name for file in tmp_path.glob("*.png")) == [
        f"figure{k}.png" for k in (6, 7, 8, 9)
    ]
    assert "Table III" in done.stdout
    assert "Table II:" not in done.stdout


@pytest.fixture(scope="module", params=CASES, ids=lambda case: f"case{case.number}")
def settled(request: pytest.FixtureRequest) -> CaseResult:
    return run_case(request.param, RIGS, seconds=6.0, runs=1, progress=lambda *_: None)


def resting_angle_rad(control, rig: Rig, d) -> float:
    """Where b1 θ + b u(θ, 0) + d(θ, 0) = 0, by bisection: at rest there, nothing moves."""
    model = law_of(rig.rig.name).payload["model"]

    def acceleration(angle: float) -> float:
        u = control.step(np.array([angle, 0.0])).control
        return float(model["b1"]) * angle + float(model["b"]) * u + d(angle)

    reference = float(rig.control.reference_rad)
    low, high = reference - 0.1, reference + 0.1
    assert acceleration(low) > 0.0 > acceleration(high)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if acceleration(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)


def test_curves_settle_where_they_must(settled: CaseResult) -> None:
    assert settled.settles
    assert abs(settled.tracking.final_error_rad) < 1e-4
    # A prototype of the whole loop: 28 and 0.6 mrad.
    expected_rad = {1: 0.028, 2: 0.0006}[settled.case.number]
    assert settled.printed.final_error_rad == pytest.approx(expected_rad, rel=0.06)
    d = {1: np.sin, 2: lambda angle: 0.5 * np.cos(angle)}[settled.case.number]
    resting_rad = resting_angle_rad(MinMaxControl(settled.problem), settled.rig, d)
    assert settled.min_max.angle_rad[-1] == pytest.approx(resting_rad, abs=3e-5)
    assert settled.min_max.final_error_rad == pytest.approx(
        resting_rad - settled.problem.reference_rad, abs=3e-5
    )


def test_min_max_keeps_its_bounds_in_the_loop(settled: CaseResult) -> None:
    rig, curve = settled.rig, settled.min_max
    assert settled.min_max_slack < 1e-7
    assert np.abs(curve.control).max() <= rig.control_max
    assert np.abs(curve.angle_rad).max() <= rig.constraints.angle_max_rad
    assert np.abs(curve.velocity_rad_s).max() <= rig.constraints.velocity_max_rad_s
    # At full stretch, not by being idle.
    assert np.abs(curve.control).max() > 0.99 * rig.control_max


def test_another_solver_decides_the_same_in_every_step(settled: CaseResult) -> None:
    assert settled.active_set is not None
    assert settled.active_set.largest_difference < 1e-3 * settled.problem.control_max
    assert settled.active_set.mean_s > 0.0


def test_tables_ratio_is_the_papers(settled: CaseResult) -> None:
    """By hand: 161.57 / 6.58 = 24.55, 159.17 / 6.57 = 24.23."""
    rows = {row[0]: row for row in time_table(settled).rows}
    assert rows["paper: ratio"][1] == {1: "24.6", 2: "24.2"}[settled.case.number]
    assert len(rows["min-max MPC, ms"]) == len(rows["paper: ratio"]) == 7


def test_the_joint_on_the_bus_is_that_of_the_simulation() -> None:
    """The voltages of a simulated run give the same joint, to the last bit."""
    rig, law = rig_of("paper-case1"), law_of("paper-case1")
    run = simulate(rig, law, "step")
    disturbance = [term.model_dump() for term in rig.scenario("step").disturbance]
    joint = _core.JointOnBus(law.checked, simulated_plant(rig), disturbance)
    for k in np.flatnonzero(run.active):
        assert joint.time_s == pytest.approx(run.scenario_time_s[k], abs=1e-9)
        assert joint.angle_rad == pytest.approx(run.true_angle_rad[k], abs=1e-9)
        assert joint.velocity_rad_s == pytest.approx(run.true_velocity_rad_s[k], abs=1e-9)
        assert joint.disturbance_rad_s2 == pytest.approx(run.true_disturbance_rad_s2[k], abs=1e-9)
        assert joint.measure()[0] == pytest.approx(run.measured_angle_rad[k], abs=1e-4)
        sent = joint.advance(float(run.u1_V[k]), float(run.u2_V[k]))
        assert sent == (run.u1_V[k], run.u2_V[k])


def test_bad_input_is_one_sentence(eampc, tmp_path: Path) -> None:
    done = eampc("reproduce", "--rigs", tmp_path, "-o", tmp_path / "made")
    assert done.returncode == 2
    assert "no such rig; run eampc reproduce in the repository" in done.stderr
    assert eampc("reproduce", "--runs", 0).returncode == 2
    assert eampc("reproduce", "--case", 3).returncode == 2


def test_says_which_package_is_missing(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['clarabel'] = None\n"
        "from eampc.command_line import run\n"
        f"sys.exit(run(['reproduce', '-o', {str(tmp_path)!r}, '--rigs', {str(RIGS)!r}]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 2
    assert "needs the package clarabel; install eampc[reproduce]" in done.stderr
    assert not (tmp_path / "index.html").exists()


def test_a_problem_is_that_of_its_rig() -> None:
    """Every number of the comparison from the rig file, none by hand."""
    rig = load_rig(RIGS / "paper-case2", overrides={"control.weight_angle": 11.0})
    problem = MinMaxProblem.of_rig(rig, law_of("paper-case2"))
    assert problem.weight_angle == 11.0
    assert (problem.horizon, problem.moves) == (20, 20)
    assert problem.disturbance_max_rad_s2 == 0.5
    assert problem.control_max == 60.0
    # Responses of one sign: the reach is the sum of |columns|, here of D alone at the first stage.
    assert problem.state_bounds[0] == pytest.approx(
        [2.0, 5.0] - 0.5 * np.abs(problem.disturbance_column)
    )
