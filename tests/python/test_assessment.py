"""Judging a run: every expected figure is worked out by hand from a few rows."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from eampc.hil.assessment import Assessment, assess, error_figures
from eampc.hil.recording import Recording
from eampc.hil.scenario_reference import reference_angle
from eampc_rig import Rig, load_rig

RIG_FOLDER = Path(__file__).parents[2] / "rigs" / "reference"
T = 0.005


def rig_with(**tolerance: float) -> Rig:
    return load_rig(
        RIG_FOLDER,
        None,
        {
            "scenarios.short.duration_s": 4 * T,
            "scenarios.short.reference": {"kind": "constant", "amplitude_rad": 0.1},
            "scenarios.short.tolerance": tolerance,
        },
    )


def truth(angle: list[float], answered: list[float] | None = None, first: int = -1) -> Recording:
    """Frames from scenario time `first`·T on."""
    count = len(angle)
    frame = np.arange(count, dtype=float)
    return Recording(
        {
            "frame": frame,
            "scenario_time_s": (frame + first) * T,
            "angle_rad": np.array(angle),
            "velocity_rad_s": np.zeros(count),
            "disturbance_rad_s2": np.full(count, 2.0),
            "sent_monotonic_s": frame,
            "answered_monotonic_s": np.array(answered or frame, dtype=float),
        }
    )


def record(u1: list[float], u2: list[float], first: int = -1) -> Recording:
    count = len(u1)
    cycle = np.arange(count, dtype=float)
    return Recording(
        {
            "cycle": cycle,
            "scenario_time_s": (cycle + first) * T,
            "reference_angle_rad": np.full(count, 0.1),
            "angle_rad": np.full(count, 0.1),
            "disturbance_rad_s2": np.full(count, 5.0),
            "u1_V": np.array(u1),
            "u2_V": np.array(u2),
            "mode": np.array(["ARMING"] + ["ACTIVE"] * (count - 1)),
            "fault": np.array(["none"] * count, dtype=object),
            "arrival_to_sent_us": np.arange(1.0, count + 1.0),
        }
    )


# One frame before the scenario, four in it, one after: only the four count.
ANGLE = [9.0, 0.103, 0.096, 0.1, 0.1, 9.0]
U1 = [0.0, 5.5, 6.0, 5.0, 5.0, 0.0]
U2 = [0.0, 4.5, 4.0, 5.0, 5.0, 0.0]


def assessed(rig: Rig, seen: Recording, done: Recording) -> Assessment:
    angles = reference_angle(rig, "short", seen["scenario_time_s"])
    return assess(rig, "short", angles, seen, done)


def test_figures_by_hand() -> None:
    """Errors 3, −4, 0, 0 mrad: RMS √(25/4) = 2.5 mrad, mean −0.25 mrad."""
    figures = assessed(rig_with(rms_error_max_rad=0.0025), truth(ANGLE), record(U1, U2))
    assert figures.rms_error_rad == pytest.approx(0.0025)
    assert figures.max_error_rad == pytest.approx(0.004)
    assert figures.final_error_rad == pytest.approx(0.00025)
    assert figures.missed_cycles == 0
    assert (figures.u1_min_V, figures.u1_max_V) == (5.0, 6.0)
    assert (figures.u2_min_V, figures.u2_max_V) == (4.0, 5.0)
    assert (figures.all_frames_min_V, figures.all_frames_max_V) == (0.0, 6.0)
    assert figures.disturbance_error_rms_rad_s2 == pytest.approx(3.0)
    assert figures.arrival_to_sent_max_us == 5.0
    assert figures.modes_in_scenario == ["ACTIVE"]


@pytest.mark.parametrize(
    ("tolerance", "passed"),
    [
        ({}, True),
        ({"rms_error_max_rad": 0.00251}, True),
        ({"rms_error_max_rad": 0.00249}, False),
        ({"max_error_max_rad": 0.00401}, True),
        ({"max_error_max_rad": 0.00399}, False),
        ({"final_error_max_rad": 0.000251}, True),
        ({"final_error_max_rad": 0.000249}, False),
        ({"rms_from_s": 2 * T, "rms_error_max_rad": 1e-9}, True),
    ],
)
def test_tolerances_decide(tolerance: dict[str, float], passed: bool) -> None:
    assert assessed(rig_with(**tolerance), truth(ANGLE), record(U1, U2)).passed is passed


def test_unanswered_frame_is_missed_and_fails() -> None:
    seen = truth(ANGLE, answered=[0.0, 1.0, np.nan, 3.0, 4.0, np.nan])
    figures = assessed(rig_with(), seen, record(U1, U2))
    assert figures.missed_cycles == 1
    assert not figures.passed


def test_missed_cycle_in_real_time_is_told_but_judged_by_its_effect() -> None:
    seen = truth(ANGLE, answered=[0.0, 1.0, np.nan, 3.0, 4.0, np.nan])
    rig = rig_with(rms_error_max_rad=0.00251)
    angles = reference_angle(rig, "short", seen["scenario_time_s"])
    figures = assess(rig, "short", angles, seen, record(U1, U2), lockstep=False)
    assert figures.missed_cycles == 1
    assert figures.passed


def test_run_that_ended_early_fails() -> None:
    figures = assessed(rig_with(), truth(ANGLE[:3]), record(U1[:3], U2[:3]))
    assert not figures.passed


@pytest.mark.parametrize(("u1", "passed"), [(10.0, True), (10.001, False), (-0.001, False)])
def test_voltage_outside_the_range_in_any_frame_fails(u1: float, passed: bool) -> None:
    figures = assessed(rig_with(), truth(ANGLE), record([u1, *U1[1:]], U2))
    assert figures.passed is passed


def test_fault_fails() -> None:
    done = record(U1, U2)
    done["fault"][3] = "encoder time-out (safety.encoder_timeout_s)"
    figures = assessed(rig_with(), truth(ANGLE), done)
    assert figures.faults == ["encoder time-out (safety.encoder_timeout_s)"]
    assert not figures.passed


def test_bounds_are_told_and_not_judged() -> None:
    """The law's state bounds are soft; what must hold is a tolerance of the rig file."""
    seen = truth([0.0, 0.1, 1.01, 0.1, 0.1, 0.1])
    seen["velocity_rad_s"][2] = -6.01
    figures = assessed(rig_with(), seen, record(U1, U2))
    assert figures.passed
    assert not figures.bounds_held
    assert figures.angle_max_abs_rad == 1.01
    assert figures.velocity_max_abs_rad_s == 6.01
    assert [bound.met for bound in figures.bounds] == [False, False]
    assert assessed(rig_with(), truth(ANGLE), record(U1, U2)).bounds_held


def test_no_rows_at_all_is_a_failure_not_a_crash() -> None:
    empty = truth(ANGLE).where(np.zeros(6, dtype=bool))
    figures = assessed(rig_with(rms_error_max_rad=1.0), empty, record(U1, U2))
    assert np.isnan(figures.rms_error_rad)
    assert not figures.passed


def test_final_error_is_of_the_last_fifth_of_a_second() -> None:
    """1 s at 200 Hz: the last 40 rows alternate 1 ± 3 mrad, so their mean is 1 mrad."""
    time_s = np.arange(200) * T
    error = np.full(200, 0.5)
    error[160:] = 1e-3 + 3e-3 * (-1.0) ** np.arange(40)
    rms, largest, final = error_figures(time_s, error, 0.8)
    assert final == pytest.approx(1e-3)
    assert largest == pytest.approx(4e-3)
    assert rms == pytest.approx(np.sqrt((4e-3**2 + 2e-3**2) / 2))


def test_summary_names_the_figures_of_the_issue() -> None:
    summary = assessed(rig_with(), truth(ANGLE), record(U1, U2)).as_summary()
    errors = ["rms_error_rad", "max_error_rad", "final_error_rad"]
    voltages = ["u1_min_V", "u1_max_V", "u2_min_V", "u2_max_V"]
    for name in [*errors, "missed_cycles", *voltages, "passed"]:
        assert name in summary
    assert all(demand["met"] for demand in summary["demands"])


@pytest.mark.parametrize(
    ("reference", "time_s", "angle"),
    [
        ({"kind": "constant", "amplitude_rad": 0.3}, -1.0, 0.3),
        ({"kind": "step", "amplitude_rad": 0.5, "start_s": 0.5, "offset_rad": 0.1}, 0.495, 0.1),
        ({"kind": "step", "amplitude_rad": 0.5, "start_s": 0.5, "offset_rad": 0.1}, 100 * T, 0.6),
        ({"kind": "sine", "amplitude_rad": 0.5, "frequency_hz": 0.5}, 0.5, 0.5),
        ({"kind": "sine", "amplitude_rad": 0.5, "frequency_hz": 0.5, "start_s": 1.0}, 0.9, 0.0),
        ({"kind": "sine", "amplitude_rad": 0.5, "frequency_hz": 0.5, "start_s": 1.0}, 2.5, -0.5),
    ],
)
def test_reference_by_hand(reference: dict, time_s: float, angle: float) -> None:
    rig = load_rig(RIG_FOLDER, None, {"scenarios.step.reference": reference})
    assert reference_angle(rig, "step", np.array([time_s]))[0] == pytest.approx(angle)


def test_reference_from_csv_lies_beside_the_rig_file(tmp_path: Path) -> None:
    for name in ("rig.toml", "reference.dbc"):
        shutil.copy(RIG_FOLDER / name, tmp_path)
    (tmp_path / "ramp.csv").write_text("time_s,angle_rad\n0,0\n1,0.2\n")
    rig = load_rig(
        tmp_path, None, {"scenarios.step.reference": {"kind": "csv", "file": "ramp.csv"}}
    )
    angles = reference_angle(rig, "step", np.array([0.0, 0.25, 1.0, 3.0]))
    assert angles == pytest.approx([0.0, 0.05, 0.2, 0.2])


def test_assessment_is_frozen() -> None:
    figures = assessed(rig_with(), truth(ANGLE), record(U1, U2))
    with pytest.raises(dataclasses.FrozenInstanceError):
        figures.passed = True  # type: ignore[misc]
