"""`eampc bench`: the published problems against another statement of them, both forms of a program
against each other, refusals, and one small run of each command.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from eampc import _core, law_design
from eampc.benchmark import offline_peer, online, online_peers
from eampc.benchmark.law_structure import active_rows, build_law, clipped, tables_of
from eampc.benchmark.problems import as_given, of_rig, published, published_names
from eampc.command_line import run as run_command
from eampc.errors import RunFailed, UserError
from eampc_rig import load_rig
from mpqp_problems import benchmark as stated_by_tests

RIGS = Path(__file__).parents[2] / "rigs"


def equal_solutions(name: str, form_of: str) -> None:
    problem = published(name)
    built = build_law(problem)
    form = as_given(problem.problem) if form_of == "given" else problem.bounded(built.active_rows())
    points = online.random_points(problem, form, 500, seed=3)
    U = built.regions(points)
    for timing in (
        online_peers.daqp(problem, form, points, warm=False, how="cold"),
        online_peers.daqp(problem, form, points, warm=True, how="warm"),
    ):
        np.testing.assert_allclose(timing.y, U[:, 0], rtol=0.0, atol=1e-9)
        assert (timing.point_ns > 0.0).all()
    np.testing.assert_allclose(clipped(problem, built.tables, points), U[:, 0], atol=1e-9)


@pytest.mark.parametrize("form", ["given", "reduced"])
@pytest.mark.parametrize("name", ["p5_u2_N4", "p5_u0_N3", "p3_u2_N6"])
def test_both_forms_of_a_program_have_the_solution_of_the_regions(name: str, form: str) -> None:
    equal_solutions(name, form)


@pytest.mark.parametrize(("kind", "u0", "N"), [("p5", 2, 5), ("p5", 0, 3), ("p3", 2, 4)])
def test_published_problems_are_those_of_the_other_tests(kind: str, u0: int, N: int) -> None:
    """Equal cost; equal feasible sets, whatever the order of the rows."""
    ours = published(f"{kind}_u{u0}_N{N}").problem
    theirs = stated_by_tests(kind, N, float(u0))
    for name in ("H", "F", "f", "lower", "upper"):
        np.testing.assert_allclose(
            getattr(ours, name), getattr(theirs, name), rtol=1e-12, atol=1e-12
        )
    rows = [np.column_stack([p.G, p.w, p.S]) for p in (ours, theirs)]
    in_order = [part[np.lexsort(np.round(part, 9).T)] for part in rows]
    np.testing.assert_allclose(*in_order, rtol=0.0, atol=1e-9)


def test_names() -> None:
    assert published_names("p5_u0_N3-5") == ["p5_u0_N3", "p5_u0_N4", "p5_u0_N5"]
    assert published_names("p3_u2_N10") == ["p3_u2_N10"]
    for wrong in ("p4_u2_N5", "p5_u1_N5", "p5_u2_5", "p5_u2_N0", "p5"):
        with pytest.raises(UserError, match="p5_u2_N10"):
            published(wrong)


def test_closed_loop_points_follow_the_model() -> None:
    problem = published("p5_u2_N5")
    built = build_law(problem)
    form = problem.bounded(built.active_rows())
    starts = online.random_points(problem, form, 64, seed=1)
    loop = online.loop_points(problem, built.tables, form, starts)
    assert loop is not None
    assert online_peers.feasible(problem, form, loop).all()
    # Each point but a start is the exact sampled successor of the one before: x⁺ by its own series.
    u = clipped(problem, built.tables, loop)
    rate = np.array([[0.0, 1.0], [106.875, -5.0]])
    x, drive = loop[:, :2], loop[:, 2:4] + np.outer(u, [0.0, 4.96125])
    term, ahead = x @ rate.T + drive, x.copy()
    for k in range(1, 25):
        ahead = ahead + term * 0.01**k / float(np.prod(np.arange(1.0, k + 1.0)))
        term = term @ rate.T
    same_loop = (loop[1:, 2:] == loop[:-1, 2:]).all(axis=1)
    assert same_loop.sum() > 64
    np.testing.assert_allclose(loop[1:, :2][same_loop], ahead[:-1][same_loop], atol=1e-12)


def test_a_law_that_is_wrong_is_not_timed() -> None:
    problem = published("p5_u2_N4")
    built = build_law(problem)
    t = built.tables
    same = ("kind", "hyperplanes", "root", "depth", "node_planes", "node_children", "leaf_care")
    same += ("leaf_bits", "leaf_first", "term_first", "term_pieces", "fold")
    wrong = _core.LawTables(
        piece_gain=1.5 * t.piece_gain,
        piece_offset=t.piece_offset,
        **{name: getattr(t, name) for name in same},
    )
    form = problem.bounded(built.active_rows())
    with pytest.raises(RunFailed, match="differ by"):
        online.measure(problem, wrong, form, peers=("daqp",), points=64)


def test_every_peer_finds_the_law(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = tmp_path / "law.md"
    arguments = ["bench", "law", "--problem", "p5_u2_N3", "--points", "64"]
    assert run_command([*arguments, "--json", "-o", str(report)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["machine"]["cores"] >= 1
    assert found["machine"]["compiler"]
    (figures,) = found["problems"]
    for name in ("sweep_ns", "worst_ns", "fresh_ns", "chain_ns", "cold_median_ns", "timer_ns"):
        assert figures[name] > 0.0
    assert figures["cold_worst_ns"] >= figures["cold_median_ns"]
    peers = {peer["name"].split(",")[0]: peer for peer in figures["peers"]}
    assert set(peers) == {"DAQP", "OSQP", "PIQP", "Clarabel"}
    for peer in figures["peers"]:
        own = figures["loop_ns"] if "closed loop" in peer["name"] else figures["sweep_ns"]
        assert peer["ratio"] == pytest.approx(peer["mean_ns"] / own)
        assert peer["failed"] <= 2  # of points at the edge of what is feasible
        assert peer["largest_difference"] < 1e-4
    text = report.read_text()
    assert "| p5_u2_N3 |" in text
    assert found["machine"]["processor"] in text


# PPOPT's interface over eampc.mpqp: PPOPT brings Gurobi, which is not free, and a compiler.
PPOPT = {
    "__init__.py": "",
    "mpqp_program.py": "from types import SimpleNamespace as MPQP_Program\n",
    "mp_solvers/__init__.py": "",
    "mp_solvers/solve_mpqp.py": """
import enum, time
from types import SimpleNamespace
import numpy as np
from eampc.mpqp import solve

mpqp_algorithm = enum.Enum("mpqp_algorithm", ["geometric", "graph", "combinatorial"])

def solve_mpqp(of, algorithm):
    print("it prints as it goes", flush=True)
    if algorithm is mpqp_algorithm.graph:
        time.sleep(600.0)
    if algorithm is mpqp_algorithm.combinatorial:
        raise ValueError("it gives up")
    box = [np.linalg.solve(rows, bounds) for rows, bounds in zip(
        np.split(of.A_t, 2), np.split(of.b_t.ravel(), 2), strict=True)]
    a = solve(of.Q, of.H, of.c.ravel(), of.A, of.b.ravel(), of.F, (box[1], box[0])).arrays
    regions = [
        SimpleNamespace(E=3.0 * a["facet_normals"][i:k], f=3.0 * a["facet_offsets"][i:k, None])
        for i, k in zip(a["facet_first"][:-1], a["facet_first"][1:], strict=True)
    ]
    return SimpleNamespace(critical_regions=regions[LEFT_OUT:])
""",
}


def install_ppopt(folder: Path, monkeypatch: pytest.MonkeyPatch, left_out: int = 0) -> None:
    """Puts the package above where the processes of the benchmark find it."""
    (folder / "ppopt" / "mp_solvers").mkdir(parents=True)
    for name, text in PPOPT.items():
        (folder / "ppopt" / name).write_text(text.replace("LEFT_OUT", str(left_out)))
    monkeypatch.syspath_prepend(folder)


def test_offline_beside_ppopt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    install_ppopt(tmp_path, monkeypatch)
    report = tmp_path / "offline.md"
    arguments = ["bench", "offline", "--problem", "p3_u2_N2-3", "--points", "500"]
    assert run_command([*arguments, "--limit-s", "2", "--json", "-o", str(report)]) == 0
    for figures in json.loads(capfd.readouterr().out)["problems"]:
        peer = figures["peer"]
        assert figures["uncovered"] == 0
        assert peer["algorithm"] == "geometric"
        assert peer["not_finished"] == ["graph", "combinatorial"]
        assert peer["regions"] == figures["regions"] > 1
        assert peer["uncovered"] == 0
        assert figures["ratio"] == pytest.approx(peer["seconds"] / figures["explore_s"])
    assert "| p3_u2_N3 |" in report.read_text()


def test_what_the_peer_leaves_uncovered_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_ppopt(tmp_path, monkeypatch, left_out=1)
    of = published("p3_u2_N2")
    points = online.random_points(of, as_given(of.problem), 500, seed=1)
    found = offline_peer.best_of(of.problem, points, 60.0, ("geometric",))
    assert found is not None
    missing = int((build_law(of).regions.region_index(points) == 0).sum())
    assert found.uncovered == missing > 0


def test_offline_without_a_peer(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["bench", "offline", "--problem", "p3_u2_N2", "--no-peer", "--json"]) == 0
    (figures,) = json.loads(capsys.readouterr().out)["problems"]
    assert figures["peer"] is None
    assert figures["uncovered"] == 0


def test_a_peer_that_takes_too_long_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_ppopt(tmp_path, monkeypatch)
    problem = published("p5_u2_N8").problem
    points = np.zeros((1, 5))
    assert offline_peer.best_of(problem, points, 0.05, ("graph",)) is None


def test_a_missing_peer_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "piqp", None)
    assert run_command(["bench", "law", "--problem", "p5_u2_N3"]) == 2
    assert "pip install 'eampc[bench]'" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "ppopt", None)
    assert run_command(["bench", "offline", "--problem", "p3_u2_N2"]) == 2
    assert "peer ppopt is not installed" in capsys.readouterr().err
    assert run_command(["bench", "law", "--peer", "gurobi"]) == 2
    assert "no peer is called gurobi" in capsys.readouterr().err
    monkeypatch.setattr(online_peers, "version", lambda _name: "0.8.2")
    assert run_command(["bench", "law", "--peer", "daqp"]) == 2
    assert "daqp 0.8.2 has another C interface" in capsys.readouterr().err


@pytest.mark.parametrize("rig_name", ["reference", "paper-case1"])
def test_the_law_of_a_rig(rig_name: str) -> None:
    overrides = {"control.control_horizon": 2} if rig_name == "reference" else {}
    rig = load_rig(RIGS / rig_name, overrides=overrides)
    law = law_design.design(rig)
    problem = of_rig(rig, law)
    form = problem.bounded(active_rows(law))
    found = online.measure(problem, tables_of(law), form, peers=("daqp",), points=64)
    points = online.random_points(problem, form, 64, seed=1)
    np.testing.assert_allclose(
        clipped(problem, tables_of(law), points), law.evaluate(points), atol=1e-12
    )
    assert all(peer.largest_difference < 1e-6 for peer in found.peers)
    assert np.isfinite(found.loop_ns) == (rig_name == "reference")
