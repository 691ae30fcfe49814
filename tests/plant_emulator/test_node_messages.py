"""What the emulated node says beside encoder frames, and how faults change it."""

import can
import cantools
import pytest
from eampc_rig import Frames, Rig, resolve_frames

from plant_emulator.command_log import CommandLog
from plant_emulator.encoder import Encoder
from plant_emulator.fault_injection import FaultInjector, parse_fault
from plant_emulator.joint_node import JointNode
from plant_emulator.plant import Plant
from plant_emulator.valve_node import ValveNode


def said_by(rig: Rig, frames: int, *faults: str) -> list[list[tuple[str, dict[str, float]]]]:
    """Per period: message name and signals of every frame, decoded by cantools alone."""
    codecs: Frames = resolve_frames(rig)
    injector = FaultInjector([parse_fault(text) for text in faults], rig.control.period_s)
    node = JointNode(
        rig,
        codecs,
        Plant(rig),
        Encoder.from_rig(rig, codecs),
        ValveNode(codecs.valve_command, 0.0, 0.02),
        injector,
        CommandLog(None, codecs.valve_command),
        inputs_crc32=0x12345678,
    )
    database = cantools.database.load_file(str(rig.dbc_path))

    def decoded(message: can.Message) -> tuple[str, dict[str, float]]:
        definition = database.get_message_by_frame_id(message.arbitration_id)
        data = bytes(message.data)
        whole = len(data) == definition.length
        return definition.name, definition.decode(data) if whole else {"length": len(data)}

    periods = []
    for frame in range(frames):
        messages = node.begin_frame(frame)
        messages += [node.encoder_message(delivery.data) for delivery in node.encoder_deliveries()]
        periods.append([decoded(message) for message in messages])
        node.end_frame(0.0)
    return periods


def signal(periods: list, name: str, key: str) -> dict[int, float]:
    return {
        frame: values[key]
        for frame, messages in enumerate(periods)
        for message, values in messages
        if message == name
    }


def test_e_stop_is_told_at_once_and_every_period_while_it_is_pressed(reference_rig: Rig) -> None:
    told = signal(said_by(reference_rig, 30, "e_stop@7:3"), "EStop", "Stop")
    assert told == {0: 0, 7: 1, 8: 1, 9: 1, 10: 0, 20: 0}


def test_silent_e_stop(reference_rig: Rig) -> None:
    told = signal(said_by(reference_rig, 50, "e_stop_silent@15:10"), "EStop", "Stop")
    assert told == {0: 0, 40: 0}


def test_emergency_is_told_once_and_taken_back(reference_rig: Rig) -> None:
    periods = said_by(reference_rig, 30, "emergency_message@5:4")
    assert signal(periods, "Emergency", "ErrorCode") == {5: 0x5000, 9: 0}


def test_heartbeat_stops_while_feedback_goes_on(reference_rig: Rig) -> None:
    periods = said_by(reference_rig, 90, "heartbeat_lost@15:30")
    assert signal(periods, "Heartbeat", "State") == {0: 5, 60: 5, 80: 5}
    assert len(signal(periods, "ValveFeedback", "Status")) == 90


def test_supply_pressure_falls_or_is_not_told(reference_rig: Rig) -> None:
    periods = said_by(reference_rig, 9, "supply_pressure@2:3", "supply_unknown@6:2")
    told = signal(periods, "ValveFeedback", "SupplyPressure")
    assert told == {0: 1000, 1: 1000, 2: 0, 3: 0, 4: 0, 5: 1000, 8: 1000}


def test_identity_of_another_rig(rig_with) -> None:
    rig = rig_with(
        bus__identity__message="RigIdentity", bus__identity__inputs_crc32_signal="InputsCrc32"
    )
    told = signal(said_by(rig, 21, "law_mismatch@4:2"), "RigIdentity", "InputsCrc32")
    assert told == {0: 0x12345678, 4: 0x12345679, 6: 0x12345678, 20: 0x12345678}


def test_encoder_faults_on_the_wire(reference_rig: Rig) -> None:
    periods = said_by(
        reference_rig,
        40,
        "encoder_timeout@2:3",
        "encoder_length@6:2",
        "encoder_out_of_range@9:2",
        "encoder_status@12:2",
        "encoder_jump@15:2",
        "encoder_repeats@18:3",
        "encoder_counter_gap@24:2",
    )
    encoder = {
        frame: values
        for frame, messages in enumerate(periods)
        for name, values in messages
        if name == "JointEncoder"
    }
    assert sorted(set(range(40)) - set(encoder)) == [2, 3, 4, 24, 25]
    assert encoder[6] == encoder[7] == {"length": 7}
    assert abs(encoder[9]["Position"]) > 12.56
    assert [encoder[frame]["Status"] for frame in (11, 12, 13, 14)] == [0, 15, 15, 0]
    assert encoder[15]["Position"] - encoder[14]["Position"] == pytest.approx(0.5, abs=1e-3)
    assert encoder[18] == encoder[19] == encoder[20] == encoder[17]
    assert encoder[21]["Counter"] == 21 % 16
    assert encoder[26]["Counter"] == 26 % 16


def test_crc_fault_breaks_the_crc(reference_frames: Frames) -> None:
    injector = FaultInjector([parse_fault("encoder_crc@1:1")], 0.005)
    data = reference_frames.encoder.encode({"angle": 0.25}, 1)
    assert reference_frames.encoder.decode(data).valid
    (delivery,) = injector.deliveries(1, data)
    assert not reference_frames.encoder.decode(delivery.data).crc_ok
