"""The operator protocol from the outside: a socket of the test plays the daemon, byte by byte."""

import contextlib
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from eampc.errors import RunFailed, UserError
from eampc.operator_client import OperatorClient, Refused, default_socket_path
from eampc.reference_table import ReferenceTable


class PlayedDaemon:
    """Accepts one connection; `answer` turns a request into the bytes to send (None: hang up)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.requests: list[dict[str, Any]] = []
        self.answer: Callable[[dict[str, Any]], bytes | None] = lambda _: framed({"ok": True})
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(str(path))
        self._listener.listen()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        connection, _ = self._listener.accept()
        # A client that has seen enough hangs up, with bytes unread: a reset, not an end.
        with connection, contextlib.suppress(OSError):
            while head := connection.recv(4, socket.MSG_WAITALL):
                (length,) = struct.unpack("<I", head)
                request = msgpack.unpackb(connection.recv(length, socket.MSG_WAITALL))
                self.requests.append(request)
                reply = self.answer(request)
                if reply is None:
                    return
                for byte in reply:  # the client must cope with any split of the stream
                    connection.sendall(bytes([byte]))

    def close(self) -> None:
        self._listener.close()


def framed(reply: dict[str, Any]) -> bytes:
    body = msgpack.packb(reply)
    return struct.pack("<I", len(body)) + body


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[PlayedDaemon]:
    played = PlayedDaemon(tmp_path / "s")
    yield played
    played.close()


def test_status_is_the_daemon_s_reply(daemon: PlayedDaemon) -> None:
    daemon.answer = lambda _: framed({"ok": True, "mode": "ACTIVE", "cycle": 7})
    with OperatorClient(daemon.path) as client:
        assert client.status() == {"ok": True, "mode": "ACTIVE", "cycle": 7}
    assert daemon.requests == [{"command": "status"}]


def test_commands_carry_the_cycle_only_if_asked(daemon: PlayedDaemon) -> None:
    with OperatorClient(daemon.path) as client:
        client.arm(20)
        client.disarm()
        client.reset()
    assert daemon.requests == [
        {"command": "arm", "at_cycle": 20},
        {"command": "disarm"},
        {"command": "reset"},
    ]


def test_reference_has_every_field_of_the_protocol(daemon: PlayedDaemon) -> None:
    with OperatorClient(daemon.path) as client:
        client.reference("sine", amplitude_rad=0.5, frequency_hz=0.25, start_s=1.0)
    assert daemon.requests == [
        {
            "command": "reference",
            "kind": "sine",
            "amplitude_rad": 0.5,
            "offset_rad": 0.0,
            "start_s": 1.0,
            "frequency_hz": 0.25,
        }
    ]


def test_table_is_little_endian_rows(daemon: PlayedDaemon) -> None:
    rows = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    with OperatorClient(daemon.path) as client:
        client.reference_table(ReferenceTable(0.005, rows))
    request = daemon.requests[0]
    assert request["kind"] == "table"
    assert request["sample_period_s"] == 0.005
    assert struct.unpack("<6d", request["table"]) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


def test_refusal_is_an_error_with_the_daemon_s_sentence(daemon: PlayedDaemon) -> None:
    daemon.answer = lambda _: framed({"ok": False, "message": "no encoder frame was seen"})
    with OperatorClient(daemon.path) as client, pytest.raises(Refused) as caught:
        client.arm()
    assert str(caught.value) == "the daemon refused arm: no encoder frame was seen"
    assert caught.value.exit_code == 1


def test_daemon_that_hangs_up_is_an_error(daemon: PlayedDaemon) -> None:
    daemon.answer = lambda _: None
    with OperatorClient(daemon.path) as client, pytest.raises(RunFailed, match="closed the conn"):
        client.status()


def test_daemon_that_stays_silent_is_an_error(daemon: PlayedDaemon) -> None:
    daemon.answer = lambda _: b""
    with (
        OperatorClient(daemon.path, timeout_s=0.05) as client,
        pytest.raises(RunFailed, match=r"did not answer status within 0\.05 s"),
    ):
        client.status()


@pytest.mark.parametrize(
    "reply",
    [b"HTTP/1.1 400 Bad Request\r\n\r\n", struct.pack("<I", 1) + b"\xc1", framed({"hello": 1})],
)
def test_something_else_on_the_socket_is_bad_input(daemon: PlayedDaemon, reply: bytes) -> None:
    daemon.answer = lambda _: reply
    with OperatorClient(daemon.path) as client, pytest.raises(UserError, match="eampcd"):
        client.status()


def test_no_socket_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"start eampcd, or name its socket with --socket"):
        OperatorClient(tmp_path / "none")


def test_socket_left_by_a_dead_daemon_says_so(tmp_path: Path) -> None:
    stale = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    stale.bind(str(tmp_path / "stale"))
    stale.close()
    with pytest.raises(UserError, match="no eampcd listens there any more"):
        OperatorClient(tmp_path / "stale")


def test_default_socket_follows_the_daemon_s_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EAMPC_SOCKET", "/run/a.sock")
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/7")
    assert default_socket_path() == Path("/run/a.sock")
    monkeypatch.delenv("EAMPC_SOCKET")
    assert default_socket_path() == Path("/run/user/7/eampcd.sock")
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert default_socket_path().name.startswith("eampcd-")
