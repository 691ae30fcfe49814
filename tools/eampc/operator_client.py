"""The operator's side of eampcd's Unix socket: one request, one reply, both length-prefixed
MessagePack maps.

Who may open the socket (mode 0600) may move the joint; there is no other authentication.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import msgpack

from eampc.errors import RunFailed, UserError

if TYPE_CHECKING:  # `eampc disarm` must not wait for numpy
    from eampc.reference_table import ReferenceTable

LENGTH = struct.Struct("<I")
# The largest reply is a few hundred bytes; anything near this is not eampcd.
LARGEST_REPLY_BYTES = 1 << 20


def default_socket_path() -> Path:
    """$EAMPC_SOCKET, else the user's run-time folder, else /tmp: the order that eampcd uses."""
    if explicit := os.environ.get("EAMPC_SOCKET"):
        return Path(explicit)
    if folder := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(folder) / "eampcd.sock"
    return Path(f"/tmp/eampcd-{os.getuid()}.sock")


class Refused(RunFailed):
    """The daemon understood the command and said no; the text is its own sentence."""


class OperatorClient:
    """Talks to one running eampcd. Use as a context manager.

    path       socket of the daemon; None for the default
    timeout_s  longest wait for one reply
    """

    def __init__(self, path: Path | None = None, timeout_s: float = 5.0) -> None:
        self.path = path or default_socket_path()
        self._timeout_s = timeout_s
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(timeout_s)
        try:
            self._socket.connect(os.fspath(self.path))
        except FileNotFoundError:
            self._fail("there is no such socket; start eampcd, or name its socket with --socket")
        except ConnectionRefusedError:
            self._fail("no eampcd listens there any more; start it again")
        except PermissionError:
            self._fail("permission denied; run as the user that started eampcd")
        except OSError as error:
            self._fail(f"{error.strerror or error}")

    def _fail(self, reason: str) -> None:
        self._socket.close()
        raise UserError(f"cannot reach the daemon at {self.path}: {reason}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        self._socket.close()

    def request(self, command: str, fields: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The daemon's reply to one command, whether it agreed (`ok`) or not."""
        body = msgpack.packb({"command": command, **(fields or {})})
        try:
            self._socket.sendall(LENGTH.pack(len(body)) + body)
            (length,) = LENGTH.unpack(self._receive(LENGTH.size))
            if length > LARGEST_REPLY_BYTES:
                raise UserError(f"{self.path} answered with {length} bytes: it is not an eampcd")
            reply = msgpack.unpackb(self._receive(length))
        except TimeoutError:
            raise RunFailed(
                f"the daemon at {self.path} did not answer {command} within {self._timeout_s:g} s"
            ) from None
        except OSError as error:
            raise RunFailed(
                f"the daemon at {self.path} went away during {command} ({error.strerror})"
            ) from None
        except (ValueError, msgpack.UnpackException):
            raise UserError(f"{self.path} did not answer in MessagePack: it is no eampcd") from None
        if not isinstance(reply, dict) or "ok" not in reply:
            raise UserError(f"{self.path} answered without `ok`: it is not an eampcd") from None
        return reply

    def _receive(self, count: int) -> bytes:
        parts = bytearray()
        while len(parts) < count:
            part = self._socket.recv(count - len(parts))
            if not part:
                raise RunFailed(f"the daemon at {self.path} closed the connection without a reply")
            parts += part
        return bytes(parts)

    def command(self, command: str, fields: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """As request(), but a refusal is an error that carries the daemon's sentence."""
        reply = self.request(command, fields)
        if not reply["ok"]:
            raise Refused(f"the daemon refused {command}: {reply.get('message', 'no reason')}")
        return reply

    def arm(self, at_cycle: int | None = None) -> dict[str, Any]:
        return self.command("arm", _at(at_cycle))

    def disarm(self, at_cycle: int | None = None) -> dict[str, Any]:
        return self.command("disarm", _at(at_cycle))

    def reset(self) -> dict[str, Any]:
        return self.command("reset")

    def status(self) -> dict[str, Any]:
        return self.command("status")

    def reference(
        self,
        kind: str,
        *,
        amplitude_rad: float = 0.0,
        offset_rad: float = 0.0,
        start_s: float = 0.0,
        frequency_hz: float = 0.0,
        at_cycle: int | None = None,
    ) -> dict[str, Any]:
        """kind: constant, step or sine. Times are scenario time: seconds since ACTIVE began."""
        return self.command(
            "reference",
            {
                "kind": kind,
                "amplitude_rad": float(amplitude_rad),
                "offset_rad": float(offset_rad),
                "start_s": float(start_s),
                "frequency_hz": float(frequency_hz),
                **_at(at_cycle),
            },
        )

    def reference_table(self, table: ReferenceTable, at_cycle: int | None = None) -> dict[str, Any]:
        """The table's first row is scenario time 0."""
        return self.command(
            "reference",
            {
                "kind": "table",
                "table": table.rows.astype("<f8").tobytes(),
                "sample_period_s": float(table.sample_period_s),
                **_at(at_cycle),
            },
        )


def _at(at_cycle: int | None) -> dict[str, Any]:
    return {} if at_cycle is None else {"at_cycle": int(at_cycle)}
