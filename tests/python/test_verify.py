"""`eampc verify`: the compiled plant against the emulator's, replays and clusters against the
campaign bit for bit, and what the command says and exits with.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed import LocalCluster
from eampc import verification
from eampc.command_line import run as run_command
from eampc.errors import UserError
from eampc.law import Law
from eampc.law_design import design
from eampc.verification import campaign_settings, replay, verify
from eampc_rig.rig_file import Rig, load_rig

from plant_emulator.plant import Plant

RIG = Path(__file__).parents[2] / "rigs" / "reference"
# Three free moves: a law of the same form that is designed in a moment.
QUICK = {"control.control_horizon": 3}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(RIG, overrides=QUICK)


@pytest.fixture(scope="module")
def law(rig: Rig) -> Law:
    return design(rig)


@pytest.fixture(scope="module")
def law_file(law: Law, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("law") / "quick.law"
    law.save(path)
    return path


def equal(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray]) -> None:
    assert ours.keys() == theirs.keys()
    for name in ours:
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)


class DrawnDisturbance:
    """d of a trial from its drawn numbers, with the emulator's interface; 0 at the first frame."""

    def __init__(self, drawn: dict[str, float], lead_s: float) -> None:
        self.drawn, self.lead_s = drawn, lead_s
        self.jumps_s = (0.0, drawn["ramp_begin_s"], drawn["ramp_end_s"])

    def level_rad_s2(self, _time_s: float) -> float:
        return 0.0

    def smooth_rad_s2(self, time_s: float, _angle: float, _velocity: float) -> float:
        if time_s < 0.0:
            return self.smooth_rad_s2(0.0, 0.0, 0.0) * (1.0 + time_s / self.lead_s)
        d = self.drawn
        knots = (d["ramp_begin_s"], d["ramp_end_s"])
        levels = (d["first_level_rad_s2"], d["last_level_rad_s2"])
        phase = 2.0 * math.pi * d["frequency_hz"] * time_s + d["phase_rad"]
        return float(np.interp(time_s, knots, levels)) + d["sine_rad_s2"] * math.sin(phase)

    def value_rad_s2(self, time_s: float, angle: float, velocity: float) -> float:
        return self.smooth_rad_s2(time_s, angle, velocity)


@pytest.mark.parametrize("index", [0, 1, 2, 3])
def test_physics_agree_with_the_emulators_plant(rig: Rig, law: Law, index: int) -> None:
    """The emulator's plant under the replayed voltages: the same motion to a microradian."""
    _, cycles, drawn = replay(rig, law, campaign_settings(rig, seconds=1.0), index)
    plant_of_trial = drawn["plant"]
    keys = {
        f"joint.{k}": plant_of_trial[k]
        for k in ("moment_of_inertia_kg_m2", "viscous_damping_N_m_s_rad")
    }
    keys |= {
        f"muscle.{k}": plant_of_trial[k] for k in ("k1_N_per_MPa", "k2_N_per_MPa", "k3_N_per_MPa")
    }
    for key in ("valve_time_constant_s", "initial_angle_rad", "initial_velocity_rad_s"):
        keys[f"emulator.{key}"] = plant_of_trial[key]
    emulated = load_rig(RIG, overrides={**QUICK, **keys, "emulator.substeps": 50})
    lead = int(np.argmax(cycles.active))
    plant = Plant(emulated, (), lead)
    plant._disturbance = DrawnDisturbance(drawn["disturbance"], lead * rig.control.period_s)
    enabled = {"ARMING", "ACTIVE"}
    modes = {2: "ARMING", 3: "ACTIVE"}
    rows = []
    for frame in range(len(cycles.cycle)):
        plant.begin_frame(frame)
        truth = plant.snapshot()
        rows.append(
            (
                truth.angle_rad,
                truth.velocity_rad_s,
                truth.pressure1_kPa,
                truth.torque_N_m,
                truth.disturbance_rad_s2,
            )
        )
        if modes.get(int(cycles.mode[frame])) in enabled:
            plant.command(cycles.u1_V[frame], cycles.u2_V[frame])
        else:
            plant.command(rig.valve.safe_V, rig.valve.safe_V)
        plant.advance_to(rig.control.period_s)
    angle, velocity, pressure, torque, disturbance = np.array(rows).T
    assert np.ptp(angle[lead:]) > 0.05
    np.testing.assert_allclose(cycles.true_angle_rad, angle, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(cycles.true_velocity_rad_s, velocity, rtol=0.0, atol=5e-5)
    np.testing.assert_allclose(cycles.pressure1_kPa, pressure, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(cycles.true_torque_N_m, torque, rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(cycles.true_disturbance_rad_s2, disturbance, rtol=0.0, atol=1e-6)


def test_a_replay_is_the_trial_bit_for_bit(rig: Rig, law: Law) -> None:
    settings = campaign_settings(rig, seed=5)
    found = verify(rig, law, settings, 40)
    for index in (0, 17, 39):
        row, cycles, _ = replay(rig, law, settings, index)
        equal(row.columns, {name: values[[index]] for name, values in found.columns.items()})
        late = cycles.scenario_time_s >= 1.5 - 1e-9
        error = np.abs(cycles.true_angle_rad - cycles.reference_angle_rad)[late]
        assert row.columns["tracking_error_rad"][0] == error.max()


def test_neither_threads_nor_parts_change_a_trial(rig: Rig, law: Law) -> None:
    settings = campaign_settings(rig, seed=2)
    one = verify(rig, law, settings, 101, threads=1)
    equal(one.columns, verify(rig, law, settings, 101, threads=5).columns)
    part = verify(rig, law, settings, 30, first=50)
    equal(part.columns, {name: values[50:80] for name, values in one.columns.items()})
    other = verify(rig, law, campaign_settings(rig, seed=3), 101)
    assert (other.columns["angle_rad"] != one.columns["angle_rad"]).all()


def test_a_dask_cluster_gives_the_local_result(
    rig: Rig, law: Law, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verification, "CLUSTER_CHUNK", 16)
    settings = campaign_settings(rig, seed=9)
    done: list[int] = []
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        spread = verify(
            rig, law, settings, 100, scheduler=cluster.scheduler_address, progress=done.append
        )
    equal(spread.columns, verify(rig, law, settings, 100).columns)
    assert done[-1] == 100
    assert len(done) == 7
    assert spread.core_seconds > 0.0


def test_the_reference_law_keeps_its_voltages(rig: Rig, law: Law) -> None:
    found = verify(rig, law, campaign_settings(rig), 300)
    assert found.hard_violations == {"range_violations": 0, "slew_violations": 0, "non_finite": 0}
    assert found.closed_loop_cycles == 300 * 400
    assert found.columns["saturated"].sum() > 0
    beyond = np.flatnonzero(
        (found.columns["angle_rad"] > 1.0) | (found.columns["velocity_rad_s"] > 6.0)
    )
    np.testing.assert_array_equal(found.beyond_state_bounds, beyond)
    index, value = found.worst("velocity_rad_s")
    assert value == found.columns["velocity_rad_s"].max() == found.columns["velocity_rad_s"][index]


def test_an_exact_plant_without_disturbance_settles(rig: Rig, law: Law) -> None:
    """Tolerances and disturbance at zero: what is left is the encoder and (3)'s θ² term."""
    exact = dict.fromkeys(verification.TOLERANCES, 0.0)
    calm = load_rig(
        RIG,
        overrides={
            **QUICK,
            "tightening.disturbance_max_rad_s2": 0.0,
            "tightening.disturbance_rate_max_rad_s3": 0.0,
        },
    )
    nominal = verify(calm, law, campaign_settings(calm, tolerances=exact), 200)
    varied = verify(rig, law, campaign_settings(rig), 200)
    calm_rms = np.median(nominal.columns["tracking_error_rad"])
    assert calm_rms < 0.5 * np.median(varied.columns["tracking_error_rad"])


def test_an_exception_in_progress_ends_the_campaign(rig: Rig, law: Law) -> None:
    class EnoughError(Exception):
        pass

    def stop(_done: int) -> None:
        raise EnoughError

    with pytest.raises(EnoughError):
        verify(rig, law, campaign_settings(rig, seconds=100.0), 100_000, progress=stop)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"tolerances": {"mass": 0.1}}, "no tolerance is called mass; there are J, b, b1"),
        ({"tolerances": {"J": 1.0}}, "tolerance of J is 1"),
        ({"seconds": 0.001}, "cannot last 0.001 s"),
        ({"seed": -1}, "seed -1"),
    ],
)
def test_bad_settings_are_one_sentence(rig: Rig, arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        campaign_settings(rig, **arguments)


def command(law_file: Path, *more: object) -> int:
    return run_command(
        [
            "verify",
            str(RIG),
            "--set",
            "control.control_horizon=3",
            "--law",
            str(law_file),
            *map(str, more),
        ]
    )


def test_command_reports_and_replays(
    law_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = tmp_path / "verify.md"
    assert command(law_file, "--trials", 1000, "--json", "-o", report) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["trials"] == 1000
    assert summary["closed_loop_cycles_per_s_and_core"] > 0.0
    assert sum(summary["hard_violations"].values()) == 0
    worst = next(row for row in summary["worst"] if row["name"] == "largest velocity")
    text = report.read_text()
    assert worst["replay"] in text
    assert f"| {summary['trials_beyond_state_bounds'][0]} |" in text

    # The very command line that the report gives, with the figure elsewhere.
    words = worst["replay"].split()
    assert words[:2] == ["eampc", "verify"]
    figure = tmp_path / "trial.png"
    assert run_command([*words[1:-1], str(figure), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert [row for row in again["worst"] if row["name"] == "largest velocity"] == [worst]
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_command_exit_status(law_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(law_file, "--trials", 1000, "--strict") == 1
    out = " ".join(capsys.readouterr().out.split())
    assert "voltages outside valve.min_V..max_V: none in 542,000 frames" in out
    assert "|θ̇| ≤ 6 rad/s: left in" in out
    assert command(law_file, "--figure", "x.png") == 2
    assert "--replay" in capsys.readouterr().err
    assert command(law_file, "--tolerance", "J") == 2
    assert "J=20%" in capsys.readouterr().err
    assert command(law_file, "--trials", 4, "--scheduler", "tcp://127.0.0.1:9") == 2
    assert "no Dask scheduler answers" in capsys.readouterr().err
