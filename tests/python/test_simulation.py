"""The simulated closed loop against a second implementation: the emulator's plant, stepped in
Python around the bound control cycle. And the bound law against numpy's own walk of its tables.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from eampc import _core
from eampc.errors import LawFileError, UserError
from eampc.law import Law
from eampc.law_design import design
from eampc.simulation import ARM_AT_CYCLE, simulate
from eampc_rig.frames import resolve_frames
from eampc_rig.rig_error import RigError
from eampc_rig.rig_file import Rig, load_rig
from law_in_numpy import values_at

from plant_emulator.encoder import Encoder
from plant_emulator.plant import Plant

RIG = Path(__file__).parents[2] / "rigs" / "paper-case1"
# This law is designed in a quarter of a second; a lag and a ramp exercise the rest of the plant.
LAGGING = {"emulator.valve_time_constant_s": 0.004, "safety.arming_ramp_s": 0.1}
CYCLES = 300


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(RIG)


@pytest.fixture(scope="module")
def law(rig: Rig) -> Law:
    return design(rig)


def run_with_emulator(rig: Rig, law: Law, cycles: int) -> dict[str, np.ndarray]:
    """The same run with the emulator's plant, encoder and cantools' frames."""
    frames = resolve_frames(rig)
    run = rig.scenarios["step"]
    period_s = rig.control.period_s
    lead = ARM_AT_CYCLE + rig.safety.arming_periods(period_s)
    plant = Plant(rig, run.disturbance, lead)
    encoder = Encoder.from_rig(rig, frames)
    cycle = _core.ControlCycle(_core.law_from_bytes(law.to_bytes()))
    cycle.set_reference(**run.reference.model_dump())
    rows = []
    for frame in range(cycles):
        plant.begin_frame(frame)
        truth = plant.snapshot()
        angle, velocity = encoder.measure(plant.angle_rad, plant.velocity_rad_s)
        data = frames.encoder.encode({"angle": angle, "velocity": velocity}, counter=frame)
        action = "arm" if frame == ARM_AT_CYCLE else "none"
        record = cycle.step(id=frames.encoder.frame_id, data=bytes(data), action=action)
        if record["enable"]:
            plant.command(record["u1_V"], record["u2_V"])
        else:
            plant.command(rig.valve.safe_V, rig.valve.safe_V)
        plant.advance_to(period_s)
        rows.append((truth.angle_rad, truth.velocity_rad_s, truth.torque_N_m, record["u1_V"]))
    names = ("true_angle_rad", "true_velocity_rad_s", "true_torque_N_m", "u1_V")
    return dict(zip(names, np.array(rows).T, strict=True))


@pytest.mark.parametrize("overrides", [{}, LAGGING], ids=["ideal", "lagging"])
def test_agrees_with_the_emulators_plant(overrides: dict, law: Law) -> None:
    rig = load_rig(RIG, overrides=overrides)
    law = design(rig) if overrides else law
    simulated = simulate(rig, law, "step")
    emulated = run_with_emulator(rig, law, CYCLES)
    assert np.abs(simulated.true_angle_rad[:CYCLES]).max() > 0.5
    for name, values in emulated.items():
        ours = getattr(simulated, name)[:CYCLES]
        np.testing.assert_allclose(ours, values, rtol=0.0, atol=1e-9, err_msg=name)


def test_scenario_time_begins_with_active(rig: Rig, law: Law) -> None:
    result = simulate(rig, law, "step")
    first = int(np.flatnonzero(result.active)[0])
    assert first == ARM_AT_CYCLE + rig.safety.arming_periods(rig.control.period_s)
    assert result.region[first - 1] == -1
    assert (result.region[first:] >= 0).all()
    assert len(result.cycle) == first + round(
        rig.scenarios["step"].duration_s / rig.control.period_s
    )
    # Held at the start until then: the first state of the scenario is the rig's initial state.
    assert result.true_angle_rad[first] == rig.emulator.initial_angle_rad
    assert result.true_velocity_rad_s[first] == rig.emulator.initial_velocity_rad_s


def test_meets_the_figure_of_the_prototype(rig: Rig, law: Law) -> None:
    """Case 1, paper formulation: a prototype of the whole loop settled at 28 mrad."""
    assert simulate(rig, law, "step").final_error_rad() == pytest.approx(0.028, abs=0.0005)


def test_bound_law_agrees_with_numpy(law: Law) -> None:
    generator = np.random.default_rng(11)
    span = law.upper - law.lower
    points = law.lower - 0.2 * span + 1.4 * span * generator.random((5_000, len(span)))
    u, region, clamped = _core.law_from_bytes(law.to_bytes()).evaluate(points)
    expected, pieces = values_at(law.payload["law"], np.clip(points, law.lower, law.upper))
    np.testing.assert_allclose(u, np.clip(expected, *law.control_range), rtol=0.0, atol=1e-9)
    # On a facet the two sums may round to different sides; the value is the same there.
    assert np.mean([found not in known for found, known in zip(region, pieces, strict=True)]) < 1e-3
    outside = ((points < law.lower) | (points > law.upper)).any(axis=1)
    np.testing.assert_array_equal(clamped, outside)


def test_bad_input_is_one_sentence(rig: Rig, law: Law, tmp_path: Path) -> None:
    with pytest.raises(RigError, match='no scenario "jump"'):
        simulate(rig, law, "jump")
    other = load_rig(RIG.parent / "paper-case2")
    with pytest.raises(UserError, match="for the rig paper-case1, not paper-case2"):
        simulate(other, law, "step")
    with pytest.raises(TypeError, match="load_rig"):
        simulate(str(RIG), law, "step")
    rough = load_rig(RIG, overrides={"emulator.coulomb_friction_N_m": 0.001})
    with pytest.raises(UserError, match="coulomb_friction"):
        simulate(rough, law, "step")
    cut = tmp_path / "cut.law"
    cut.write_bytes(law.to_bytes()[:-10])
    with pytest.raises(LawFileError, match="cut short"):
        simulate(rig, str(cut), "step")
    with pytest.raises(ValueError, match="columns"):
        _core.law_from_bytes(law.to_bytes()).evaluate(np.zeros((3, 2)))


def test_the_scenario_replaces_the_emulators_disturbance(law: Law) -> None:
    """As in the emulator, where the rig's own disturbance only acts without a scenario."""
    shaken = load_rig(
        RIG, overrides={"emulator.disturbance": [{"kind": "constant", "amplitude_rad_s2": 5.0}]}
    )
    plain = simulate(load_rig(RIG), law, "step")
    same = simulate(shaken, law, "step")
    np.testing.assert_array_equal(same.true_angle_rad, plain.true_angle_rad)


def test_importing_a_module_does_not_hide_a_function() -> None:
    """`import eampc.design` once put a module in the place of eampc.design."""
    code = (
        "import importlib, pkgutil, eampc\n"
        "modules = {m.name for m in pkgutil.iter_modules(eampc.__path__)}\n"
        "for name in modules & set(eampc.__all__):\n"
        "    value = getattr(eampc, name)\n"
        "    importlib.import_module(f'eampc.{name}')\n"
        "    assert getattr(eampc, name) is value, name\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_evaluate_takes_one_point_or_rows_of_points(law: Law) -> None:
    names = law.parameter_names
    rows = law.evaluate(np.zeros((3, len(names))))
    assert rows.shape == (3,)
    assert law.evaluate(np.zeros(len(names))) == rows[0]
    for shape in ((2,), (1, 2), (), (1, 1, len(names))):
        with pytest.raises(ValueError, match=names[0]):
            law.evaluate(np.zeros(shape))
