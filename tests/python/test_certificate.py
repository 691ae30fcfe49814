"""The certificate: what it says of the ready rigs, the tightening, and the paper's two bounds."""

import copy
import math

import numpy as np
import pytest
from eampc import _core, law_design
from eampc.certificate import NOT_PROVED, PARTS, PROVED, certify
from eampc.certificate_report import html_report, markdown_report
from eampc.law import Law
from eampc.tightening_check import check_tightening, expected_tightening, theorem_bounds
from ready_rigs import law_of, rig_of

RIGS = (("paper-case1", None), ("paper-case2", None), ("paper-case2", "theorem"))


@pytest.mark.parametrize(("name", "variant"), RIGS)
def test_ready_laws_are_proved_and_say_so(name: str, variant: str | None) -> None:
    law = law_of(name, variant)
    certificate = certify(law)
    assert certificate.proved, certificate.failure
    assert all(certificate.figures[part] == PROVED for part in PARTS)
    assert law.payload["law"]["certificate"] == certificate.figures
    assert certificate.figures["regions"] == law.statistics["regions"]
    assert certificate.figures["law_error"] <= 1e-9
    assert certificate.figures["stationarity_residual"] < 1e-15
    assert certificate.figures["worst_operations"] == law.tables.worst_operations
    assert certificate.figures["tightened_rows"] > 0


def test_the_proofs_do_not_depend_on_the_number_of_threads() -> None:
    law = law_of("paper-case1")
    assert certify(law, threads=1).figures == certify(law, threads=3).figures


@pytest.mark.parametrize(("name", "variant"), RIGS)
def test_programs_alone_come_to_the_same_verdict(name: str, variant: str | None) -> None:
    """Without the comparisons of two pieces that save most linear programs."""
    law = law_of(name, variant)
    problem = law.problem
    figures, _ = _core.certify_law(
        *problem[:8],
        output=_core.OutputLaw(
            problem.output_U, problem.output_p, problem.output_offset, *law.control_range
        ),
        active_sets=law.payload["law"]["active_sets"],
        tables=law.tables,
        programs_only=True,
    )
    assert figures["proved"], figures["failure"]
    assert figures["cells"] == law.payload["law"]["certificate"]["cells"]


def test_progress_is_told_and_an_exception_in_it_ends_the_work() -> None:
    seen = set()
    certify(law_of("paper-case1"), lambda part, _done, _of: seen.add(part))
    assert {"optimality", "coverage", "evaluator", "invariant set"} <= seen

    def stop(_part: str, _done: int, _of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        certify(law_of("paper-case1"), stop)


def test_a_design_without_certificate_says_none() -> None:
    law = law_design.design(rig_of("paper-case2", "theorem"), certificate=False)
    assert law.payload["law"]["certificate"] == "none"
    assert certify(law).proved


def test_pages_hold_every_figure() -> None:
    law = law_of("paper-case2", "theorem")
    certificate = certify(law)
    for page in (markdown_report(certificate, law), html_report(certificate, law)):
        assert "not proved" not in page
        for key in certificate.figures:
            assert key in page
        assert law.payload["rig"]["inputs_sha256"] in page
    html = html_report(certificate, law)
    assert html.count("<table>") == html.count("</table>") == 1


@pytest.mark.parametrize(("name", "variant"), RIGS)
def test_tightening_is_recomputed_by_other_formulae(name: str, variant: str | None) -> None:
    payload = law_of(name, variant).payload
    found = check_tightening(payload)
    assert found.failure == ""
    np.testing.assert_allclose(
        expected_tightening(payload), payload["tightening"]["epsilon"], rtol=1e-4, atol=1e-12
    )


def test_a_tightening_that_is_not_in_force_is_found() -> None:
    payload = copy.deepcopy(dict(law_of("paper-case1").payload))
    payload["tightening"]["epsilon"] = 0.5 * payload["tightening"]["epsilon"]
    assert "differs" in check_tightening(payload).failure
    payload = copy.deepcopy(dict(law_of("paper-case1").payload))
    states = np.abs(payload["problem"]["S"]).max(axis=1) > 0.0
    payload["problem"]["w"][np.flatnonzero(states)[0]] *= 1.01  # one bound let out
    assert "row" in check_tightening(payload).failure
    certificate = certify(Law(payload))
    assert not certificate.proved
    assert certificate.figures["tightening"] == NOT_PROVED


class Trajectories:
    """Random plants ẋ = A x + B u + (0, d(x)) whose d keeps the rig's Lipschitz constants:
    d(x) = c cos(k·x + φ) + d_0, |c| |k| ≤ l_δ, |d(0)| ≤ b_δ; and the printed estimator (13), (14).
    """

    SUBSTEPS = 8

    def __init__(self, name: str, count: int) -> None:
        rig = rig_of(name, "theorem")
        self.model, self.sampled = law_design._model(rig)
        self.a = law_design._assumptions(rig)
        self.epsilon = law_design._tightening(rig, self.model)
        self.period_s, self.horizon = rig.control.period_s, rig.control.horizon
        self.random = np.random.default_rng(20)
        r = self.random
        angle = r.uniform(0.0, 2.0 * math.pi, count)
        length = r.uniform(0.2, 4.0, count)
        self.k = length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        self.phase = r.uniform(0.0, 2.0 * math.pi, count)
        slope = min(self.a["l_delta"], self.a["b_delta_x"])
        self.c = slope * r.uniform(0.5, 1.0, count) / length
        at_zero = self.a["b_delta"] * r.uniform(-1.0, 1.0, count)
        self.d_0 = at_zero - self.c * np.cos(self.phase)
        half = np.array([self.a["angle_max_rad"], self.a["velocity_max_rad_s"]])
        self.x = r.uniform(-0.9, 0.9, (count, 2)) * half
        self.half = half
        self.A, self.B = np.array(self.model.joint_A), np.array([0.0, self.model.b])

    def disturbance(self, x: np.ndarray) -> np.ndarray:
        d = self.c * np.cos((self.k * x).sum(axis=1) + self.phase) + self.d_0
        return np.column_stack([np.zeros(len(d)), d])

    def after_a_period(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        h = self.period_s / self.SUBSTEPS

        def rate(x: np.ndarray) -> np.ndarray:
            return x @ self.A.T + np.outer(u, self.B) + self.disturbance(x)

        for _ in range(self.SUBSTEPS):
            k1 = rate(x)
            k2 = rate(x + 0.5 * h * k1)
            k3 = rate(x + 0.5 * h * k2)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(x + h * k3))
        return x

    def inputs(self) -> np.ndarray:
        u = self.random.uniform(-1.0, 1.0, len(self.x))
        extreme = self.random.random(len(u)) < 0.5
        return self.a["control_max"] * np.where(extreme, np.sign(u), u)

    def inside(self, x: np.ndarray) -> np.ndarray:
        return (np.abs(x) <= self.half).all(axis=1)


@pytest.mark.parametrize("name", ["paper-case1", "paper-case2"])
def test_lemma_and_theorem_hold_on_random_trajectories(name: str) -> None:
    """Lemma 3.1: ‖δ(t_k) − σ̂(t_k)‖ ≤ γ(T). Theorem 3.1: ‖x̄(t_k + iT) − x‖ ≤ ‖ε^i‖."""
    t = Trajectories(name, 400)
    gamma, _ = theorem_bounds(t.A, t.model.b, t.a, t.period_s, t.horizon)
    A_star, B_star = np.array(t.sampled.A_star), np.array(t.sampled.B_star).ravel()
    D = np.array(t.sampled.D)
    decay = math.exp(-t.a["adaptation_rate_per_s"] * t.period_s)
    x, z = t.x, t.x.copy()
    kept = t.inside(x)
    lemma, theorem, checks = 0.0, 0.0, 0
    for cycle in range(12):
        sigma = -decay * np.linalg.solve(D, (z - x).T).T
        if cycle > 0:
            miss = np.linalg.norm(t.disturbance(x) - sigma, axis=1)
            lemma = max(lemma, float(miss[kept].max()) / gamma)
            true, predicted, within = x, x, kept
            for i in range(1, t.horizon + 1):
                u = t.inputs()
                true = t.after_a_period(true, u)
                predicted = predicted @ A_star.T + np.outer(u, B_star) + sigma @ D.T
                within = within & t.inside(true)
                error = np.linalg.norm(predicted - true, axis=1)[within]
                checks += len(error)
                if len(error):
                    theorem = max(theorem, float(error.max()) / t.epsilon[i, 0])
        u = t.inputs()
        z = x @ A_star.T + np.outer(u, B_star) + sigma @ D.T + decay * (z - x)
        x = t.after_a_period(x, u)
        kept = kept & t.inside(x)
        assert kept.sum() > 50
    assert checks > 5000
    assert 0.0 < lemma <= 1.0
    assert 0.0 < theorem <= 1.0
