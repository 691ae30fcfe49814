"""Codec, counter and CRC against cantools and crccheck."""

import cantools
import pytest
from crccheck.crc import Crc8SaeJ1850
from eampc_rig import Frames, Rig, crc8_j1850, frame_crc
from eampc_rig.message_codec import MessageCodec
from hypothesis import given
from hypothesis import strategies as st


def test_crc_check_value() -> None:
    assert crc8_j1850(b"123456789") == 0x4B


@given(st.binary(max_size=16))
def test_crc_is_sae_j1850(data: bytes) -> None:
    assert crc8_j1850(data) == Crc8SaeJ1850.calc(data)


@given(st.binary(min_size=8, max_size=8), st.integers(0, 7), st.integers(0, 0xFFFF))
def test_frame_crc_covers_id_and_all_other_bytes(data: bytes, at: int, data_id: int) -> None:
    rest = data[:at] + data[at + 1 :]
    head = data_id.to_bytes(2, "little")
    assert frame_crc(data, at, data_id) == Crc8SaeJ1850.calc(head + rest)


@given(
    u1=st.integers(0, 10000), u2=st.integers(0, 10000), enable=st.integers(0, 1), n=st.integers(0)
)
def test_valve_command_bytes_are_cantools_own(
    reference_rig: Rig, reference_frames: Frames, u1: int, u2: int, enable: int, n: int
) -> None:
    database = cantools.database.load_file(str(reference_rig.dbc_path))
    data = reference_frames.valve_command.encode(
        {"u1": u1 / 1000, "u2": u2 / 1000, "enable": enable}, n
    )
    said = database.decode_message("ValveCommand", data)
    assert said["U1"] == pytest.approx(u1 / 1000, abs=1e-9)
    assert said["U2"] == pytest.approx(u2 / 1000, abs=1e-9)
    assert said["Enable"] == enable
    assert said["Counter"] == n % 16
    assert said["Crc"] == Crc8SaeJ1850.calc(bytes([0x01, 0x02]) + data[:7])
    assert reference_frames.valve_command.decode(data).valid


def test_golden_encoder_frame(reference_frames: Frames) -> None:
    """Position 1000 counts, velocity −2 counts, counter 5: bytes by hand."""
    data = reference_frames.encoder.encode(
        {"angle": 1000 * 4.7936899621426287e-05, "velocity": -0.001}, 21
    )
    head = bytes([0xE8, 0x03, 0x00, 0xFE, 0xFF, 0x05, 0x00])
    assert data == head + bytes([Crc8SaeJ1850.calc(bytes([0x81, 0x01]) + head)])


@given(bit=st.integers(0, 63))
def test_any_flipped_bit_is_seen(reference_frames: Frames, bit: int) -> None:
    data = bytearray(reference_frames.encoder.encode({"angle": 0.25, "velocity": 1.0}, 3))
    data[bit // 8] ^= 1 << bit % 8
    assert not reference_frames.encoder.decode(bytes(data)).valid


@given(data=st.binary(max_size=64))
def test_bytes_from_the_bus_never_raise(reference_frames: Frames, data: bytes) -> None:
    frame = reference_frames.encoder.decode(data)
    assert frame.length_ok == (len(data) == 8)


def test_values_beyond_the_range_are_held_at_its_end(reference_frames: Frames) -> None:
    codec = reference_frames.encoder
    said = codec.decode(codec.encode({"angle": 99.0, "velocity": -99.0})).values
    assert said["angle"] == pytest.approx(12.56, abs=1e-4)
    assert said["velocity"] == pytest.approx(-16.384)


def test_layout_of_a_motorola_signal() -> None:
    text = (
        'VERSION ""\n\nBU_: A\n\nBO_ 2566848513 M: 8 A\n'
        ' SG_ P : 7|16@0- (0.5,-3) [0|0] "rad" A\n SG_ C : 63|8@0+ (1,0) [0|255] "" A\n'
    )
    message = cantools.database.load_string(text, "dbc").messages[0]
    codec = MessageCodec(message, {"angle": "P", "crc": "C"})
    assert codec.layout() == {
        "id": 2566848513 & 0x1FFFFFFF,
        "extended": True,
        "length": 8,
        "signals": {
            "angle": {
                "start_bit": 7,
                "length": 16,
                "little_endian": False,
                "is_signed": True,
                "factor": 0.5,
                "offset": -3.0,
                "minimum": -16387.0,
                "maximum": 16380.5,
            }
        },
        "crc": {"byte": 7, "data_id": 2566848513 & 0xFFFF},
    }
    assert codec.encode({"angle": -2.5})[:2] == b"\x00\x01"


def test_layout_of_the_reference_rig(reference_frames: Frames) -> None:
    layout = reference_frames.layout()
    assert layout["encoder"]["id"] == 0x181
    assert layout["encoder"]["signals"]["angle"]["maximum"] == 12.56
    assert layout["valve_command"]["crc"] == {"byte": 7, "data_id": 0x201}
    assert layout["sync"] == {"id": 0x80, "extended": False, "length": 1, "counter_signal": None}
    assert list(layout["valve_command"]["signals"]) == ["u1", "u2", "enable", "counter"]
