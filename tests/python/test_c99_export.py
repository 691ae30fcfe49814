"""The C99 export: its own test under two compilers, every bit against the daemon's evaluator."""

import copy
import ctypes
import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from eampc import _core
from eampc.c99_export import export_c99, single_precision_error
from eampc.law import Law
from eampc.law_arrays import tables_payload
from law_in_numpy import values_at
from ready_rigs import law_of

COMPILERS = ("gcc", "clang")
FLAGS = ("-std=c99", "-pedantic", "-Wall", "-Werror", "-ffp-contract=off", "-O2")
POINTS = 100_000


def random_law(seed: int, *, flat: bool = False, lattice: bool = False, fold: bool = False) -> Law:
    """paper-case1 with pieces, hyperplanes and leaves that random numbers chose."""
    random = np.random.default_rng(seed)
    payload = copy.deepcopy(law_of("paper-case1").payload)
    n_planes, n_leaves, n_pieces = (0, 1, 40) if lattice else (50, 30, 60)
    nodes = 0 if flat or lattice else 9
    scale = 1.0 / payload["law"]["upper"]
    terms = [
        random.integers(n_pieces, size=random.integers(1, 4)).tolist()
        for _ in range(3 * n_leaves if not lattice else 17)
    ]
    care = np.zeros((n_leaves if flat else 0, 2), dtype=np.int32)
    care[:-1] = random.integers(-(2**31), 2**31, care[:-1].shape) & random.integers(
        -(2**31), 2**31, care[:-1].shape
    )
    care[:, 1] &= (1 << (n_planes - 32)) - 1 if flat else 0
    care[:-1, 0] &= 0b1010
    care[:-1, 1] &= 0b11
    # A node leads to later nodes or to leaves: never in a circle.
    children = ~random.integers(n_leaves, size=(nodes, 8))
    for node in range(nodes - 1):
        children[node, node % 8] = node + 1
    planes = random.uniform(-1.0, 1.0, (n_planes, 5)) * [*scale, 0.5]
    tables = _core.LawTables(
        kind="flat" if flat else "tree",
        piece_gain=60.0 * random.uniform(-1.0, 1.0, (n_pieces, 4)) * scale,
        piece_offset=random.uniform(-60.0, 60.0, n_pieces),
        hyperplanes=planes,
        root=0 if nodes else -1,
        depth=nodes,
        node_planes=random.integers(-1, max(n_planes, 1), (nodes, 7)).astype(np.int32),
        node_children=children.astype(np.int32),
        leaf_care=care,
        leaf_bits=care & random.integers(-(2**31), 2**31, care.shape).astype(np.int32),
        leaf_first=np.arange(0, len(terms) + 1, len(terms) // n_leaves, dtype=np.int32),
        term_first=np.cumsum([0, *map(len, terms)]).astype(np.int32),
        term_pieces=np.array([piece for term in terms for piece in term], dtype=np.int32),
        fold=random.uniform(-1.0, 1.0, 4) if fold else np.zeros(4),
    )
    payload["law"].update(tables_payload(tables))
    return Law(payload)


LAWS: dict[str, Callable[[], Law]] = {
    "designed": lambda: law_of("paper-case1", "tracking"),
    "tree": lambda: random_law(1),
    "flat": lambda: random_law(2, flat=True),
    "lattice": lambda: random_law(3, lattice=True),
    "folded": lambda: random_law(4, fold=True),
}


@pytest.fixture(params=LAWS)
def law(request: pytest.FixtureRequest) -> Law:
    return LAWS[request.param]()


def compiled(folder: Path, compiler: str) -> ctypes.CDLL:
    library = folder / f"law-{compiler}.so"
    subprocess.run(
        [compiler, *FLAGS, "-shared", "-fPIC", "-o", library, folder / "law.c"], check=True
    )
    return ctypes.CDLL(str(library))


def values_of(library: ctypes.CDLL, points: np.ndarray) -> np.ndarray:
    """law_control at every row, in the type of the points."""
    real = ctypes.c_float if points.dtype == np.float32 else ctypes.c_double
    library.law_control.restype = real
    library.law_control.argtypes = [ctypes.c_void_p]
    first, step = points.ctypes.data, points.strides[0]
    return np.array(
        [library.law_control(first + i * step) for i in range(len(points))], points.dtype
    )


def sampled(law: Law, count: int) -> np.ndarray:
    """Random points of the box, some beyond it, a quarter on hyperplanes."""
    random = np.random.default_rng(7)
    points = random.uniform(1.1 * law.lower, 1.1 * law.upper, (count, len(law.lower)))
    planes = law.payload["law"]["evaluator"]["hyperplanes"]
    if len(planes):
        chosen = planes[random.integers(len(planes), size=count // 4)]
        normal, some = chosen[:, :-1], points[: count // 4]
        excess = (some * normal).sum(axis=1) - chosen[:, -1]
        some -= normal * (excess / (normal**2).sum(axis=1))[:, None]
    return points


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("single", [False, True], ids=["double", "float"])
def test_its_own_test_passes(law: Law, compiler: str, single: bool, tmp_path: Path) -> None:
    export_c99(law, tmp_path, single)
    done = subprocess.run(
        ["make", "-s", "-C", tmp_path, "check", f"CC={compiler}"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 of 500 points differ" in done.stdout


def test_its_own_test_sees_a_changed_gain(tmp_path: Path) -> None:
    export_c99(law_of("paper-case1"), tmp_path)
    code = (tmp_path / "law.c").read_text()
    head, pieces = code.split("/* offset, gains */")
    assert "0x1" in pieces
    (tmp_path / "law.c").write_text(f"{head}/* offset, gains */{pieces.replace('0x1.', '0x1.0')}")
    done = subprocess.run(["make", "-s", "-C", tmp_path, "check"], capture_output=True, text=True)
    assert done.returncode != 0
    assert "expected" in done.stdout


@pytest.mark.parametrize("compiler", COMPILERS)
def test_double_has_the_bits_of_the_daemon(law: Law, compiler: str, tmp_path: Path) -> None:
    export_c99(law, tmp_path)
    points = sampled(law, POINTS)
    found = values_of(compiled(tmp_path, compiler), points)
    # + 0.0: where two pieces meet in zero, either sign of it is right.
    assert (found + 0.0).tobytes() == (law.evaluate(points) + 0.0).tobytes()
    assert len(np.unique(found)) > 100


def test_float_is_within_its_stated_error(law: Law, tmp_path: Path) -> None:
    export_c99(law, tmp_path, single=True)
    error = single_precision_error(law)
    header = (tmp_path / "law.h").read_text()
    assert f"#define LAW_ERROR {error:.3e}" in header
    points = sampled(law, POINTS).astype(np.float32)
    inside = (points >= law.lower).all(axis=1) & (points <= law.upper).all(axis=1)
    points = np.ascontiguousarray(points[inside])
    difference = values_of(compiled(tmp_path, "gcc"), points) - law.evaluate(points)
    assert 0.0 < np.abs(difference).max() <= error
    assert error < 1e-2 * (law.control_range[1] - law.control_range[0])


def test_random_laws_are_evaluated_by_their_rules(law: Law) -> None:
    """That what C is compared with is right in the first place."""
    points = np.clip(sampled(law, 1500), law.lower, law.upper)
    expected, _ = values_at(law.payload["law"], points)
    off_planes = slice(1500 // 4, None)
    u = law.evaluate(points)[off_planes]
    np.testing.assert_allclose(u, np.clip(expected, *law.control_range)[off_planes], atol=1e-9)


def test_nan_in_gives_nan(tmp_path: Path) -> None:
    export_c99(law_of("paper-case1"), tmp_path)
    points = np.array([[0.0, np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0, 0.0]])
    nan, clamped = values_of(compiled(tmp_path, "gcc"), points)
    assert np.isnan(nan)
    assert clamped == law_of("paper-case1").evaluate(points[1])


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from eampc.command_line import run

    path = tmp_path / "rig.law"
    law_of("paper-case1").save(path)
    assert run(["export", str(path), "--c99", str(tmp_path / "out"), "--float", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["error"] == single_precision_error(law_of("paper-case1"))
    assert all(Path(file).is_file() for file in answer["files"])
    assert run(["export", str(path), "--c99", str(path)]) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert run(["export", str(tmp_path / "none.law"), "--c99", str(tmp_path)]) == 2


def test_two_compilers_are_here() -> None:
    assert all(shutil.which(compiler) for compiler in COMPILERS), "run tools/setup"
