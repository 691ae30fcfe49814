"""Flight records: the file as documented → arrays and figures; and from a daemon that stopped."""

import math
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import can
import msgpack
import numpy as np
import pytest
from eampc.errors import UserError
from eampc.flight_record import is_flight_record, loop_data, read_flight_record
from eampc_rig import FAULT_NAMES
from toy_daemon import PERIOD_S, UDP_PORT, Daemon, EncoderNode, answer

Eampc = Callable[..., subprocess.CompletedProcess[str]]
COLUMNS = (
    *("cycle", "mode", "fault", "reference_angle_rad", "angle_rad", "u1_V", "u2_V"),
    *("disturbance_rad_s2", "arrival_to_wake_us", "wake_to_decided_us", "decided_to_sent_us"),
    "arrival_to_sent_us",
)
FAULT_AT = 150


def row(number: int) -> list[float]:
    faulty = number >= FAULT_AT
    return [
        1000.0 + number,
        5.0 if faulty else 3.0,
        19.0 if faulty else 0.0,
        *(0.5, 0.5 * math.sin(0.01 * number), 6.0, 4.0, 20.0, 10.0, 5.0, 20.0, 35.0),
    ]


def flight_bytes(rows: int = 200, **changes: object) -> bytes:
    data = b"".join(struct.pack(f"<{len(COLUMNS)}d", *row(k)) for k in range(rows))
    return msgpack.packb(
        {
            "format": "eampc-flight",
            "version": 1,
            "period_s": 0.005,
            "reason": "e_stop",
            "fault": 19,
            "fault_text": "emergency stop pressed (bus.e_stop)",
            "texts": {"mode": {"3": "ACTIVE", "5": "FAULT"}},
            "columns": [{"name": name, "unit": ""} for name in COLUMNS],
            "data": {"shape": [rows, len(COLUMNS)], "f64": data},
            **changes,
        }
    )


def write(folder: Path, data: bytes) -> Path:
    path = folder / "a.flight"
    path.write_bytes(data)
    return path


def test_columns_and_texts(tmp_path: Path) -> None:
    path = write(tmp_path, flight_bytes())
    assert is_flight_record(path)
    record = read_flight_record(path)
    assert record.about["reason"] == "e_stop"
    assert record.columns["cycle"].tolist() == [1000.0 + k for k in range(200)]
    assert record.texts("mode") == ["ACTIVE"] * FAULT_AT + ["FAULT"] * 50
    data = loop_data(record)
    assert data.cycle_time_s[FAULT_AT] == 0.0
    assert data.cycle_time_s[0] == pytest.approx(-FAULT_AT * 0.005)
    assert data.mode_changes == [(0.0, "FAULT")]
    assert np.isnan(data.cycle_reference_rad[FAULT_AT:]).all()


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"\xc1nothing", "is not a whole flight record"),
        (flight_bytes()[:-5], "is not a whole flight record"),
        (msgpack.packb([1]), "is not a flight record"),
        (flight_bytes(version=2), "version 2, but this eampc reads version 1"),
        (flight_bytes(data={"shape": [3, 3], "f64": b""}), "is a damaged flight record"),
        (flight_bytes(columns=[]), "is a damaged flight record"),
        (flight_bytes(rows=0), "holds no cycle"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path: Path, data: bytes, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        read_flight_record(write(tmp_path, data))


def test_plot_draws_it(tmp_path: Path, eampc: Eampc) -> None:
    path = write(tmp_path, flight_bytes())
    done = eampc("plot", path, "--out", tmp_path / "figures")
    assert done.returncode == 0, done.stderr
    names = [Path(line).name for line in done.stdout.split()]
    assert names
    assert all((tmp_path / "figures" / name).is_file() for name in names)


def test_a_fault_and_a_request_leave_a_file(tmp_path: Path) -> None:
    """A daemon that is armed, then hears nothing but a wrong CRC for as long as the time-out."""
    url = f"udp_multicast:239.74.163.9:{UDP_PORT}"
    with (
        Daemon(tmp_path, url, "--emulation", "--lockstep") as daemon,
        can.Bus("239.74.163.9", interface="udp_multicast", port=UDP_PORT) as bus,
    ):
        node = EncoderNode()
        operator = daemon.operator()

        def cycles(count: int, damaged: bool = False) -> None:
            for _ in range(count):
                frame = node.frame()
                if damaged:
                    frame.data[7] ^= 0xFF
                bus.send(frame)
                answer(bus)

        cycles(3)
        assert operator.ask(command="arm", at_cycle=5)["ok"]
        cycles(40)
        status = operator.ask(command="status")
        assert status["mode"] == "ACTIVE"
        assert (status["fault_number"], status["refusal"], status["refusal_number"]) == (
            0,
            "none",
            0,
        )
        refused = operator.ask(command="arm")
        assert not refused["ok"]
        assert refused["refusal_number"] == 6

        asked = operator.ask(command="flight")
        assert asked["ok"], asked["message"]
        before = read_flight_record(Path(asked["message"]))
        assert before.about["reason"] == "request"
        assert before.texts("mode")[-1] == "ACTIVE"

        cycles(21, damaged=True)
        status = daemon.status_after(60)
        assert status["fault_name"] == "encoder_crc"
        assert status["fault_number"] == FAULT_NAMES.index("encoder_crc") + 1
        cycles(60)
        refused = operator.ask(command="arm")
        assert refused["refusal_number"] == 1
        assert "encoder_invalid_frames" in refused["refusal"]
        assert daemon.stop() == 0
    (written,) = [path for path in tmp_path.glob("flight-*") if "encoder_crc" in path.name]
    record = read_flight_record(written)
    assert record.about["period_s"] == PERIOD_S
    assert record.about["fault"] == 2
    assert record.texts("mode")[-1] == "FAULT"
    assert {"ACTIVE", "SOFT_STOP", "FAULT"} <= set(record.texts("mode"))
