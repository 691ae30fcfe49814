"""A law without move blocking: the variant says so, and a smaller relative takes the same path.

The variant itself takes too long to be designed by every run of the tests. By hand:

    eampc design rigs/reference --variant unblocked -o unblocked.law && eampc certify unblocked.law
"""

from functools import cache

import numpy as np
from eampc.certificate import PARTS, PROVED, certify
from eampc.law import Law
from eampc.law_design import design
from eampc_rig import load_rig
from mpqp_oracles import online_solution
from ready_rigs import READY, RIGS

REFERENCE = RIGS / "reference"
SAMPLES, SEED = 2000, 1
SMALLER = {
    "control.horizon": 8,
    "control.control_horizon": 8,
    "constraints.stage_step": 8,
}


@cache
def smaller_law() -> Law:
    return design(load_rig(REFERENCE, "unblocked", SMALLER))


def test_every_move_of_the_variant_is_free() -> None:
    rig = load_rig(REFERENCE, "unblocked")
    assert rig.control.horizon == rig.control.control_horizon == 20
    assert rig.control.weight_control_rate == 0.0
    assert rig.constraints.stage_step == 20
    assert ("reference", "unblocked") not in READY


def test_a_smaller_relative_is_proved() -> None:
    law = smaller_law()
    figures = law.payload["law"]["certificate"]
    assert all(figures[part] == PROVED for part in PARTS)
    assert law.statistics["regions"] > 1500
    again = certify(law, threads=1)
    assert again.proved, again.failure
    assert again.figures == figures


def test_a_smaller_relative_is_the_solution_of_its_problem() -> None:
    law = smaller_law()
    problem = law.problem
    random = np.random.default_rng(SEED)
    p = random.uniform(law.lower, law.upper, size=(SAMPLES, len(law.lower)))
    p[::2] *= random.uniform(0.0, 0.5, size=(SAMPLES // 2, 1))
    u_min, u_max = law.control_range
    for row, u in zip(p, law.evaluate(p), strict=True):
        U = online_solution(problem, row)
        assert U is not None
        control = float(U @ problem.output_U + row @ problem.output_p + problem.output_offset)
        assert abs(u - np.clip(control, u_min, u_max)) <= 1e-8 * (u_max - u_min), row.tolist()
