"""The stated bound on operations against instructions counted by valgrind's callgrind.

The translation stands in daemon/service/law_cost.hpp: two instructions per operation on the scalar
path, and 150 for the call. EAMPC_TEST_PROGRAMS names the folder of the built test programs.
"""

import os
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from eampc.law import Law
from law_in_numpy import leaf_at
from ready_rigs import law_of
from test_c99_export import random_law

PROGRAMS = Path(
    os.environ.get("EAMPC_TEST_PROGRAMS") or Path(__file__).parents[2] / "build" / "tests"
)
INSTRUCTIONS_PER_OPERATION, INSTRUCTIONS_PER_CALL = 2, 150
SAMPLES = 100_000
MEASURED = 400

LAWS: dict[str, Callable[[], Law]] = {
    "paper-case1": lambda: law_of("paper-case1"),
    "reference": lambda: law_of("reference"),
    "tree": lambda: random_law(1),
    "flat": lambda: random_law(2, flat=True),
    "lattice": lambda: random_law(3, lattice=True),
    "folded": lambda: random_law(4, fold=True),
}


def tree_leaves(evaluator: dict, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(leaf, nodes met) of every point of a tree without fold."""
    code = np.full(len(points), evaluator["root"])
    met = np.zeros(len(points), dtype=int)
    while (inner := np.flatnonzero(code >= 0)).size:
        place, path = np.zeros(inner.size, dtype=int), np.zeros(inner.size, dtype=int)
        for _ in range(3):
            number = evaluator["node_planes"][code[inner], place]
            plane = evaluator["hyperplanes"][number]
            above = (plane[:, :-1] * points[inner]).sum(axis=1) > plane[:, -1]
            bit = ((number >= 0) & above).astype(int)
            place, path = 2 * place + 1 + bit, 2 * path + bit
        code[inner] = evaluator["node_children"][code[inner], path]
        met[inner] += 1
    return ~code, met


def points_of_every_leaf(law: Law) -> np.ndarray:
    """Of many samples those that meet most nodes and pieces, and one of each leaf that was hit."""
    random = np.random.default_rng(13)
    points = random.uniform(law.lower, law.upper, (SAMPLES, len(law.lower)))
    evaluator = law.payload["law"]["evaluator"]
    if evaluator["kind"] == "flat":
        points = points[:5000]
        leaf = np.array([leaf_at(evaluator, p) for p in points])
        met = np.zeros(len(points), dtype=int)
    else:
        turned = np.where(points @ evaluator["fold"] < 0.0, -1.0, 1.0)[:, None] * points
        leaf, met = tree_leaves(evaluator, turned)
    terms = evaluator["term_first"][evaluator["leaf_first"]]
    pieces = np.diff(terms)[leaf]
    longest_first = np.lexsort((-pieces, -met))
    _, first = np.unique(leaf[longest_first], return_index=True)
    chosen = np.unique(np.concatenate([longest_first[:MEASURED], longest_first[first]]))
    return points[chosen[:: max(1, len(chosen) // (4 * MEASURED))]]


def instructions(law: Law, points: np.ndarray, path: str, folder: Path) -> np.ndarray:
    """Instructions of the evaluation at each point."""
    law.save(folder / "rig.law")
    (folder / "points").write_bytes(np.ascontiguousarray(points).tobytes())
    output = folder / f"callgrind.{path}"
    command = ["valgrind", "--tool=callgrind", "--collect-atstart=no", "--combine-dumps=yes"]
    command += ["--toggle-collect=evaluate_once", "--dump-after=evaluate_once"]
    command += [f"--callgrind-out-file={output}", str(PROGRAMS / "law_instructions")]
    command += [str(folder / "rig.law"), str(folder / "points"), path]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    counts = re.findall(r"^totals: (\d+)$", output.read_text(), re.MULTILINE)
    assert len(counts) == len(points) + 1  # the last part: after the last call
    return np.array(counts[:-1], dtype=int)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", LAWS)
def test_no_evaluation_exceeds_the_stated_bound(name: str, tmp_path: Path) -> None:
    law = LAWS[name]()
    points = points_of_every_leaf(law)
    bound = law.payload["law"]["evaluator"]["worst_operations"]
    translated = INSTRUCTIONS_PER_OPERATION * bound + INSTRUCTIONS_PER_CALL
    worst = {path: instructions(law, points, path, tmp_path).max() for path in ("scalar", "best")}
    print(f"{name}: {bound} operations, {translated} instructions, measured {worst}")
    assert worst["scalar"] <= 2 * translated
    assert worst["best"] <= 2 * translated
    # The bound says something: the worst point of a tree comes near to it.
    assert worst["scalar"] >= 0.4 * translated
