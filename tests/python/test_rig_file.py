"""Reading rig files: what is accepted, and the one sentence for what is not."""

import math
import shutil
import zlib
from pathlib import Path
from typing import Any

import pytest
from eampc import _core
from eampc_rig import (
    FAULT_NAMES,
    Rig,
    RigError,
    load_rig,
    parse_bus_url,
    parse_override,
    resolve_frames,
)

RIGS = Path(__file__).parents[2] / "rigs"
REFERENCE = RIGS / "reference"


def complaint(overrides: dict[str, Any], variant: str | None = None) -> str:
    with pytest.raises(RigError) as caught:
        load_rig(REFERENCE, variant, overrides)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{REFERENCE / 'rig.toml'}: ")
    return text.split(": ", 1)[1]


@pytest.mark.parametrize("folder", sorted(path.parent.name for path in RIGS.glob("*/rig.toml")))
def test_every_ready_rig_and_variant_loads(folder: str) -> None:
    rig = load_rig(RIGS / folder)
    assert rig.rig.name == folder
    for variant in rig.variants:
        assert load_rig(RIGS / folder, variant).variant == variant


def test_attributes_are_sections_and_keys() -> None:
    rig = load_rig(REFERENCE)
    assert rig.control.period_s == 0.005
    assert rig.valve.bias_V == 5.0
    assert rig.scenarios["step"].reference.kind == "step"
    assert rig.scenarios["step"].disturbance[1].amplitude_rad_s2 == 30.0
    assert rig.folder == REFERENCE
    assert rig.dbc_path == REFERENCE / "reference.dbc"
    assert rig.variant is None
    assert rig.control_max == pytest.approx(5.0 / 0.45)


def test_a_rig_is_frozen() -> None:
    rig = load_rig(REFERENCE)
    with pytest.raises(ValueError, match="frozen"):
        rig.control.period_s = 1.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (
            {"control.period_ms": 5, "control.period_s": "absent"},
            "control.period_ms is not a key of this file; did you mean control.period_s (unit s)?",
        ),
        (
            {"control.bias_V": 5},
            "control.bias_V is not a key of this file; did you mean valve.bias_V (unit V)?",
        ),
        (
            {"valve.max_mV": 5},
            "valve.max_mV is not a key of this file; did you mean valve.max_V (unit V)?",
        ),
        (
            {"contorl.horizon": 5},
            "contorl is not a key of this file; did you mean control?",
        ),
        (
            {"estimator.low_pass_Hz": 8.0},
            "estimator.low_pass_Hz is not a key of this file; "
            "did you mean estimator.low_pass_hz (unit Hz)?",
        ),
        ({"valve.bias_V": "absent"}, "valve.bias_V is missing; add it (unit V)"),
        ({"valve": "absent"}, "valve is missing; add the table [valve]"),
        (
            {"control.period_s": -0.005},
            "control.period_s is -0.005 s, but must be at least 0.0001 s",
        ),
        (
            {"joint.moment_of_inertia_kg_m2": 0},
            "joint.moment_of_inertia_kg_m2 is 0 kg m², but must be greater than 0.0 kg m²",
        ),
        (
            {"control.period_s": "5 ms"},
            'control.period_s is "5 ms", but must be a number (unit s)',
        ),
        ({"control.horizon": 2.5}, "control.horizon is 2.5, but must be a whole number"),
        ({"muscle.k4_N": math.nan}, "muscle.k4_N is nan, but must be a finite number (unit N)"),
        (
            {"estimator.bias_compensation": "yes"},
            'estimator.bias_compensation is "yes", but must be true or false',
        ),
        (
            {"control.trigger": "encodr"},
            'control.trigger is "encodr", but must be "encoder" or "sync"; did you mean "encoder"?',
        ),
        (
            {"scenarios.step.reference.kind": "stp"},
            'scenarios.step.reference.kind is "stp", but must be one of "constant", "step", '
            '"sine", "csv"; did you mean "step"?',
        ),
        (
            {"scenarios.step.disturbance.1.start_ms": 3},
            "scenarios.step.disturbance.1.start_ms is not a key of this file; "
            "did you mean scenarios.step.disturbance.1.start_s (unit s)?",
        ),
        ({"valve.min_V": 11.0}, "valve.min_V is 11.0 V, but must be less than valve.max_V = 10"),
        ({"valve.bias_V": 10.0}, "valve.bias_V is 10.0 V, at the edge of valve.min_V..max_V"),
        (
            {"constraints.control_max": 12.0},
            "constraints.control_max is 12.0, but valve.bias_V, min_V, max_V and control_gain_V "
            "only allow |u| up to 11.1111; lower it or remove it",
        ),
        (
            {"control.horizon": 5},
            "control.control_horizon is 8, but must be at most control.horizon = 5",
        ),
        (
            {"emulator.initial_angle_rad": -1.2},
            "emulator.initial_angle_rad is -1.2, outside constraints.angle_max_rad = 1.0",
        ),
        (
            {"safety.encoder_timeout_s": 0.005},
            "safety.encoder_timeout_s is 0.005 s, but must be greater than control.period_s",
        ),
        (
            {"safety.supply_pressure_min_kPa": 1300.0},
            "safety.supply_pressure_min_kPa is 1300.0 kPa, but must be less than "
            "safety.supply_pressure_max_kPa = 1200.0 kPa",
        ),
        (
            {"bus.valve_feedback": "absent"},
            "safety.supply_pressure_min_kPa or max_kPa is set, but there is no "
            "bus.valve_feedback.supply_pressure_signal to compare with; name one",
        ),
        (
            {"bus.encoder.status_signal": "absent"},
            "safety.encoder_status_mask is 15, but there is no bus.encoder.status_signal",
        ),
        (
            {"safety.e_stop_action": "hope"},
            "safety.e_stop_action",
        ),
        (
            {"safety.encoder_invalid_action": "soft_stop"},
            "safety.encoder_invalid_action",
        ),
        (
            {"bus.encoder.velocity_signal": "absent"},
            'estimator.kind is "adaptive", which needs bus.encoder.velocity_signal',
        ),
        (
            {"tightening.kind": "theorem"},
            'tightening.lipschitz_delta_per_s2 is missing; tightening.kind = "theorem" needs it',
        ),
        (
            {"bus.encoder.angle_signal": "Positon"},
            'bus.encoder.angle_signal names the signal "Positon", which JointEncoder in '
            "reference.dbc does not have; it has Position, Velocity, Counter, Status, Crc; "
            'did you mean "Position"?',
        ),
        (
            {"bus.encoder.message": "Encoder"},
            'bus.encoder.message names the message "Encoder", which reference.dbc does not have',
        ),
        (
            {"bus.encoder.crc_signal": "Counter", "bus.encoder.counter_signal": "absent"},
            "bus.encoder.crc_signal names Counter, which is not one whole byte (4 bits",
        ),
        (
            {"bus.valve_command.u2_signal": "U1"},
            'bus.valve_command.u2_signal and u1_signal both name "U1"; give each its own signal',
        ),
        (
            {"bus.sync.message": "JointEncoder"},
            "bus.sync.message and bus.encoder.message have the same CAN id 0x181",
        ),
        ({"bus.dbc": "other.dbc"}, 'bus.dbc names "other.dbc", but '),
        (
            {"valve.max_V": 20.0},
            "bus.valve_command.u1_signal carries 0..10 in reference.dbc, but valve.min_V..max_V "
            "asks for 0..20; widen the signal or narrow the limits",
        ),
        (
            {"scenarios.step.reference": {"kind": "csv", "file": "no.csv"}},
            "scenarios.step.reference.file names ",
        ),
        (
            {"scenarios.step.tolerance.rms_from_s": 9.0},
            "scenarios.step.tolerance.rms_from_s is 9.0 s, but must be less than",
        ),
        (
            {"constraints.velocity_max_rad_s": 20.0},
            "bus.encoder.velocity_signal carries -16.384..16.3835 in reference.dbc, but "
            "constraints.velocity_max_rad_s asks for -20..20",
        ),
        (
            {
                "emulator.disturbance": [
                    {"kind": "pulse", "amplitude_rad_s2": 1.0, "start_s": 2.0, "end_s": 1.0}
                ]
            },
            "emulator.disturbance.0.end_s is 1.0 s, but must be greater than",
        ),
        ({"rig.name.first": 1}, 'override rig.name.first leads nowhere; "first" is looked up in'),
    ],
)
def test_one_sentence_with_key_problem_and_mend(overrides: dict[str, Any], sentence: str) -> None:
    assert complaint(overrides).startswith(sentence)


def test_the_first_problem_is_told_and_the_rest_counted() -> None:
    text = complaint({"control.horizons": 5, "valve.bias_V": "x", "joint": "absent"})
    assert text.startswith("control.horizons is not a key of this file")
    assert text.endswith("(and 2 more)")


def test_every_cause_has_an_action_under_the_daemon_s_name() -> None:
    assert tuple(_core.fault_names()) == FAULT_NAMES
    safety = load_rig(RIGS / "reference").safety
    immediate = {name for name in FAULT_NAMES if safety.action(name) == "immediate"}
    assert immediate == {
        *("bus_off", "tx_unconfirmed", "link_down", "send_refused", "e_stop", "law_mismatch")
    }


def test_arming_counts_ramp_and_reduced_limits() -> None:
    safety = load_rig(RIGS / "reference").safety
    assert safety.arming_periods(0.005) == 100 + 40


def test_wrong_variant_names_the_near_one() -> None:
    assert complaint({}, "kalmn") == 'there is no variant "kalmn"; did you mean "kalman"?'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[rig\n", "is not valid TOML"),
        ("", "rig is missing; add the table [rig] (and "),
    ],
)
def test_broken_files(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "rig.toml").write_text(text)
    with pytest.raises(RigError) as caught:
        load_rig(tmp_path)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_file() -> None:
    with pytest.raises(RigError, match="there is no such file; give a rig's folder or"):
        load_rig("/nowhere")


def test_broken_dbc(tmp_path: Path) -> None:
    shutil.copy(REFERENCE / "rig.toml", tmp_path)
    (tmp_path / "reference.dbc").write_text("this is no DBC")
    with pytest.raises(RigError, match="is not a DBC that cantools reads") as caught:
        load_rig(tmp_path)
    assert "\n" not in str(caught.value)


def test_variant_and_overrides_are_put_over_the_file() -> None:
    rig = load_rig(REFERENCE, "kalman", {"estimator.low_pass_hz": 4})
    assert rig.estimator.kind == "kalman"
    assert rig.bus.encoder.velocity_signal is None
    assert rig.estimator.low_pass_hz == 4.0
    assert "velocity" not in resolve_frames(rig).encoder.roles
    assert load_rig(REFERENCE, "ideal-valve-design").model.valve_time_constant_s is None


def test_control_horizon_defaults_to_horizon() -> None:
    rig = load_rig(REFERENCE, overrides={"control.control_horizon": "absent"})
    assert rig.control.control_horizon == rig.control.horizon == 30


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("control.horizon=20", ("control.horizon", 20)),
        ("valve.bias_V = 4.5", ("valve.bias_V", 4.5)),
        ("estimator.kind=kalman", ("estimator.kind", "kalman")),
        ('estimator.kind="kalman"', ("estimator.kind", "kalman")),
        ("estimator.bias_compensation=false", ("estimator.bias_compensation", False)),
        ("a=absent", ("a", "absent")),
        ("a=b=c", ("a", "b=c")),
    ],
)
def test_overrides_of_the_command_line(text: str, expected: tuple[str, Any]) -> None:
    assert parse_override(text) == expected


def inputs(overrides: dict[str, Any] | None = None) -> str:
    return load_rig(REFERENCE, overrides=overrides).inputs_sha256


def test_hash_follows_what_the_law_is_made_of(tmp_path: Path) -> None:
    rig = load_rig(REFERENCE)
    assert inputs() == rig.inputs_sha256
    assert inputs({"control.weight_control": 0.02}) != rig.inputs_sha256
    # The same value written differently, and what never reaches the law, change nothing.
    assert inputs({"control.weight_angle": 100}) == rig.inputs_sha256
    assert inputs({"emulator.seed": 2}) == rig.inputs_sha256
    assert inputs({"scenarios.step.duration_s": 7.0}) == rig.inputs_sha256
    assert rig.inputs_crc32 == zlib.crc32(rig._inputs)
    copy = shutil.copytree(REFERENCE, tmp_path / "copy")
    assert load_rig(copy).inputs_sha256 == rig.inputs_sha256
    with (copy / "reference.dbc").open("a") as dbc:
        dbc.write("\n")
    assert load_rig(copy).inputs_sha256 != rig.inputs_sha256


def test_narrower_control_range_is_taken() -> None:
    rig: Rig = load_rig(REFERENCE, overrides={"constraints.control_max": 5.0})
    assert rig.control_max == 5.0


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("socketcan:can0", "socketcan:can0"),
        ("udp_multicast", "udp_multicast:239.74.163.2:43113"),
        ("udp_multicast:239.1.2.3", "udp_multicast:239.1.2.3:43113"),
        ("udp_multicast:239.1.2.3:5000", "udp_multicast:239.1.2.3:5000"),
    ],
)
def test_bus_urls(url: str, shown: str) -> None:
    assert str(parse_bus_url(url)) == shown


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("can0", 'unknown transport "can0"; use socketcan:INTERFACE or udp_multicast:'),
        ("socketcn:can0", 'did you mean "socketcan"?'),
        ("socketcan:", '"" is not an interface name'),
        ("socketcan:averylonginterface", "is not an interface name"),
        ("udp_multicast:10.0.0.1", '"10.0.0.1" is not an IPv4 multicast group'),
        ("udp_multicast:239.1.2.3:0", '"0" is not a port; use 1..65535'),
    ],
)
def test_wrong_bus_urls(url: str, sentence: str) -> None:
    with pytest.raises(RigError) as caught:
        parse_bus_url(url)
    assert sentence in str(caught.value)
