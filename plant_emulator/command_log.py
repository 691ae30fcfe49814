"""Every command frame as it came off the bus, one row each, written at the end as CSV."""

from __future__ import annotations

import csv
from pathlib import Path

from eampc_rig.message_codec import MessageCodec
from eampc_rig.rig_error import RigError

COLUMNS = ("frame", "offset_s", "valid", "u1_V", "u2_V", "enable", "counter")


class CommandLog:
    """Frames by the encoder frame (period) they arrived in, decoded with the DBC; a frame of wrong
    length or CRC has valid = 0 and, without its length, no values. Signals that the message does
    not have are empty."""

    def __init__(self, path: Path | None, codec: MessageCodec) -> None:
        """Keep rows for `path`; None keeps nothing. Raises RigError if the file cannot be made."""
        self._path = path
        self._codec = codec
        self._rows: list[tuple[object, ...]] = []
        if path is not None:
            try:
                path.open("wb").close()
            except OSError as error:
                reason = error.strerror
                raise RigError(f'--command-log "{path}": cannot be written ({reason})') from None

    def append(self, frame: int, offset_s: float, data: bytes) -> None:
        """Keep one frame that arrived `offset_s` into period `frame`."""
        if self._path is None:
            return
        said = self._codec.decode(data)
        values = said.values
        self._rows.append(
            (
                frame,
                offset_s,
                int(said.valid),
                values.get("u1", ""),
                values.get("u2", ""),
                int(values["enable"]) if "enable" in values else "",
                "" if said.counter is None else said.counter,
            )
        )

    def write(self) -> None:
        """Write what was kept; raises OSError."""
        if self._path is None:
            return
        with self._path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            writer.writerows(self._rows)
