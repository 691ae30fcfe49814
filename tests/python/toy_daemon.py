"""A running eampcd with a toy law, and the other end of its bus and operator socket, for tests.

The law is one affine piece on an ideal joint (u = u_ss - k e), the frames are those of
rigs/reference/reference.dbc. Nothing of the project is imported: what the daemon says is judged
against cantools, python-can and zlib alone.
"""

import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import can
import cantools
import msgpack

REPOSITORY = Path(__file__).parents[2]
DBC = REPOSITORY / "rigs" / "reference" / "reference.dbc"
PERIOD_S = 0.005
ARMING_RAMP_S = 0.05
SOFT_STOP_RAMP_S = 0.05
BIAS_V = 5.0
FAULT_NAMES = (
    *("encoder_timeout", "encoder_crc", "encoder_length", "encoder_out_of_range"),
    *("encoder_frozen", "encoder_jump", "encoder_counter_gap", "encoder_status"),
    *("not_finite", "bus_off", "error_passive", "tx_unconfirmed", "link_down", "send_refused"),
    *("heartbeat_lost", "emergency_message", "supply_pressure", "deadline_overruns"),
    *("e_stop", "law_mismatch"),
)
# Multicast has no owner: two test runs on one machine must not meet. Below the ephemeral ports.
UDP_PORT = 20_000 + os.getpid() % 12_000
# A start under user-mode Linux with every page locked takes seconds; on a plain machine 50 ms.
START_LIMIT_S = 60.0


def eampcd() -> str:
    """$EAMPCD, else the daemon installed beside this Python."""
    return os.environ.get("EAMPCD") or str(Path(sys.executable).parent / "eampcd")


def array(rows: list) -> dict:
    """The law file's form of a matrix or a vector of float64."""
    if rows and isinstance(rows[0], list):
        flat = [float(x) for row in rows for x in row]
        shape = [len(rows), len(rows[0])]
    else:
        flat, shape = [float(x) for x in rows], [len(rows)]
    return {"shape": shape, "f64": struct.pack(f"<{len(flat)}d", *flat)}


def integers(values: list[int], columns: int | None = None) -> dict:
    """The law file's form of int32, in rows of `columns` if that is given."""
    shape = [len(values)] if columns is None else [len(values) // columns, columns]
    return {"shape": shape, "i32": struct.pack(f"<{len(values)}i", *values)}


def signal_layout(message: str, name: str) -> dict:
    found = cantools.database.load_file(DBC).get_message_by_name(message).get_signal_by_name(name)
    return {
        "start_bit": found.start,
        "length": found.length,
        "little_endian": found.byte_order == "little_endian",
        "is_signed": found.is_signed,
        "factor": float(found.scale),
        "offset": float(found.offset),
        "minimum": float(found.minimum),
        "maximum": float(found.maximum),
    }


def law_payload(**telemetry) -> dict:
    b, b1, b2 = 20.0, -10.0, -5.0
    decay = 0.975  # e^(-a T), a = 5 1/s
    return {
        "rig": {
            "name": "toy",
            "description": "one affine piece",
            "variant": "",
            "inputs_sha256": "ab" * 32,
            "inputs_crc32": 1,
            "eampc_version": "0.1.0",
        },
        "timing": {"period_s": PERIOD_S, "trigger": "encoder"},
        "model": {
            "order": 2,
            "A": array([[0.0, 1.0], [b1, b2]]),
            "B": array([0.0, b]),
            # First order in T: good enough for a test of the daemon, not of the law.
            "A_star": array([[1.0, PERIOD_S], [b1 * PERIOD_S, 1.0 + b2 * PERIOD_S]]),
            "B_star": array([0.0, b * PERIOD_S]),
            "D": array([[PERIOD_S, 0.0], [0.0, PERIOD_S]]),
            "b": b,
            "b1": b1,
            "b2": b2,
            "valve_time_constant_s": 0.0,
        },
        "estimator": {
            "kind": "adaptive",
            "decay": decay,
            "D_inverse": array([[1.0 / PERIOD_S, 0.0], [0.0, 1.0 / PERIOD_S]]),
            "bias_compensation": True,
            "low_pass_alpha": 0.2,
            "as_printed": False,
            "kalman_state_gain": array([0.0, 0.0]),
            "kalman_disturbance_gain": 0.0,
        },
        "law": {
            "formulation": "tracking",
            "reference_is_parameter": False,
            "fixed_reference_rad": 0.0,
            "u_min": -11.0,
            "u_max": 11.0,
            "parameter_names": [
                "angle_error",
                "velocity_error",
                "steady_control",
                "reference",
                "reference_velocity",
            ],
            "parameter_units": ["rad", "rad/s", "1", "rad", "rad/s"],
            "lower": array([-3.0, -20.0, -11.0, -1.0, -6.0]),
            "upper": array([3.0, 20.0, 11.0, 1.0, 6.0]),
            "piece_gain": array([[-8.0, -1.0, 1.0, 0.0, 0.0]]),
            "piece_offset": array([0.0]),
            "evaluator": {
                "kind": "tree",
                "worst_operations": 88,  # eight lanes of one piece: 8·(2·5 + 1)
                "root": -1,
                "depth": 0,
                "hyperplanes": {"shape": [0, 6], "f64": b""},
                "node_planes": integers([], 7),
                "node_children": integers([], 8),
                "leaf_care": integers([], 2),
                "leaf_bits": integers([], 2),
                "leaf_first": integers([0, 1]),
                "term_first": integers([0, 1]),
                "term_pieces": integers([0]),
                "fold": array([0.0] * 5),
            },
            "active_sets": integers([0], 1),
            "statistics": {"regions": 1, "pieces": 1, "depth": 0, "nodes": 0},
        },
        "problem": {},
        "tightening": {"kind": "none", "epsilon": {"shape": [0, 2], "f64": b""}},
        "valve": {
            "bias_V": BIAS_V,
            "control_gain_V": 0.45,
            "min_V": 0.0,
            "max_V": 10.0,
            "safe_V": 0.0,
            "slew_max_V_per_s": 4000.0,
        },
        "safety": {
            "encoder_timeout_s": 0.1,
            "arming_ramp_s": ARMING_RAMP_S,
            "soft_stop_ramp_s": SOFT_STOP_RAMP_S,
            "reduced_limits_s": 0.0,
            "reduced_control_share": 1.0,
            "reduced_slew_V_per_s": 4000.0,
            "encoder_invalid_frames": 20,
            "encoder_frozen_s": 0.0,
            "encoder_frozen_command_V": 0.5,
            "encoder_jump_velocity_rad_s": 1e6,
            "encoder_jump_margin_rad": 0.05,
            "encoder_counter_gap_max": 15,
            "encoder_status_mask": 0,
            "error_passive_s": 0.1,
            "tx_unconfirmed_periods": 2,
            "send_refused_frames": 2,
            "heartbeat_timeout_s": 0.35,
            "e_stop_timeout_s": 0.0,
            "supply_pressure_min_kPa": None,
            "supply_pressure_max_kPa": None,
            "supply_pressure_s": 0.1,
            "deadline_overruns_max": 1_000_000,
            "deadline_overruns_window_s": 1.0,
            "actions": dict.fromkeys(FAULT_NAMES, "soft_stop"),
            "reference_angle_max_rad": 1.0,
        },
        "bus": {
            "encoder": {
                "id": 0x181,
                "extended": False,
                "length": 8,
                "signals": {
                    "angle": signal_layout("JointEncoder", "Position"),
                    "velocity": signal_layout("JointEncoder", "Velocity"),
                    "counter": signal_layout("JointEncoder", "Counter"),
                    "status": signal_layout("JointEncoder", "Status"),
                },
                "crc": {"byte": 7, "data_id": 0x181},
            },
            "valve_command": {
                "id": 0x201,
                "extended": False,
                "length": 8,
                "signals": {
                    "u1": signal_layout("ValveCommand", "U1"),
                    "u2": signal_layout("ValveCommand", "U2"),
                    "enable": signal_layout("ValveCommand", "Enable"),
                    "counter": signal_layout("ValveCommand", "Counter"),
                },
                "crc": {"byte": 7, "data_id": 0x201},
            },
            "sync": {
                "id": 0x80,
                "extended": False,
                "length": 1,
                "counter_signal": signal_layout("Sync", "SyncCounter"),
            },
            "valve_feedback": None,
            "heartbeat": None,
            "emergency": None,
            "e_stop": None,
            "identity": None,
        },
        "telemetry": {
            "lcm_url": "none",
            "state_decimation": 1,
            "reference_by_lcm": False,
            **telemetry,
        },
    }


def law_bytes(payload: dict | None = None) -> bytes:
    body = msgpack.packb(payload or law_payload())
    return msgpack.packb(
        {"format": "eampc-law", "version": 3, "crc32": zlib.crc32(body), "payload": body}
    )


def crc8_j1850(data: bytes) -> int:
    """Poly 0x1D, init and final XOR 0xFF; 0x4B over "123456789" (AUTOSAR CRC library)."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1D) & 0xFF if crc & 0x80 else (crc << 1) & 0xFF
    return crc ^ 0xFF


class EncoderNode:
    """Encodes encoder frames and decodes valve commands, with cantools."""

    def __init__(self) -> None:
        self._database = cantools.database.load_file(DBC)
        self._counter = 0

    def frame(self, angle_rad: float = 0.0, velocity_rad_s: float = 0.0) -> can.Message:
        data = bytearray(
            self._database.encode_message(
                "JointEncoder",
                {
                    "Position": angle_rad,
                    "Velocity": velocity_rad_s,
                    "Counter": self._counter,
                    "Status": 0,
                    "Crc": 0,
                },
            )
        )
        data[7] = crc8_j1850(struct.pack("<H", 0x181) + data[:7])
        self._counter = (self._counter + 1) % 16
        return can.Message(arbitration_id=0x181, is_extended_id=False, data=data)

    def decode(self, message: can.Message) -> dict:
        assert message.arbitration_id == 0x201
        assert crc8_j1850(struct.pack("<H", 0x201) + message.data[:7]) == message.data[7]
        return self._database.decode_message("ValveCommand", message.data)


def answer(bus: can.BusABC, limit_s: float = 10.0) -> can.Message:
    """The next valve command."""
    end = time.monotonic() + limit_s
    while (left := end - time.monotonic()) > 0.0:
        message = bus.recv(left)
        if message is not None and message.arbitration_id == 0x201:
            return message
    raise AssertionError(f"no valve command within {limit_s} s")


class Operator:
    """The operator protocol by hand: length, MessagePack map."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.settimeout(30.0)
        self.socket.connect(str(path))

    def ask(self, **request) -> dict:
        return self.ask_bytes(msgpack.packb(request))

    def ask_bytes(self, body: bytes) -> dict:
        self.socket.sendall(struct.pack("<I", len(body)) + body)
        (size,) = struct.unpack("<I", self._exactly(4))
        return msgpack.unpackb(self._exactly(size))

    def _exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = self.socket.recv(size - len(data))
            assert part, "the daemon closed the operator socket"
            data += part
        return data


class Daemon:
    """eampcd as a process; leaves nothing behind."""

    def __init__(
        self, folder: Path, bus: str, *arguments: str, payload: dict | None = None
    ) -> None:
        law = folder / "toy.law"
        law.write_bytes(law_bytes(payload))
        # A Unix socket's path has at most 107 bytes; pytest's folders stay below.
        self.socket_path = folder / "s"
        self.record_path = folder / "record.csv"
        self.log_path = folder / "eampcd.log"
        read_end, write_end = os.pipe()
        with self.log_path.open("wb") as log:
            self.process = subprocess.Popen(
                [
                    eampcd(),
                    f"--law={law}",
                    f"--bus={bus}",
                    f"--socket={self.socket_path}",
                    f"--record={self.record_path}",
                    f"--flight-folder={folder}",
                    f"--ready-fd={write_end}",
                    *arguments,
                ],
                pass_fds=[write_end],
                stderr=log,
            )
        os.close(write_end)
        try:
            ready, _, _ = select.select([read_end], [], [], START_LIMIT_S)
            said = os.read(read_end, 16) if ready else b""
        finally:
            os.close(read_end)
        if said != b"ready\n":
            self.process.kill()
            self.process.wait()
            raise AssertionError(f"eampcd did not get ready: {self.log()}")

    def log(self) -> str:
        return self.log_path.read_text()

    def __enter__(self) -> "Daemon":
        return self

    def __exit__(self, *_) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def operator(self) -> Operator:
        return Operator(self.socket_path)

    def status_after(self, cycles: int, limit_s: float = 10.0) -> dict:
        """The status once so many cycles are counted: a command leaves before it is counted."""
        end = time.monotonic() + limit_s
        operator = self.operator()
        while (status := operator.ask(command="status"))["counters"]["cycles"] < cycles:
            assert time.monotonic() < end, f"{cycles} cycles expected: {status}"
        return status

    def stop(self, limit_s: float = 60.0) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(limit_s)
