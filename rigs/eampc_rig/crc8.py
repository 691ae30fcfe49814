"""SAE J1850 CRC-8: polynomial 0x1D, initial value 0xFF, final XOR 0xFF, not reflected."""

from __future__ import annotations

_POLYNOMIAL = 0x1D


def _table() -> tuple[int, ...]:
    entries = []
    for byte in range(256):
        remainder = byte
        for _ in range(8):
            carry = remainder & 0x80
            remainder = (remainder << 1) & 0xFF
            if carry:
                remainder ^= _POLYNOMIAL
        entries.append(remainder)
    return tuple(entries)


_TABLE = _table()


def crc8_j1850(data: bytes) -> int:
    """Return the CRC-8 of `data` (the check value of b"123456789" is 0x4B)."""
    remainder = 0xFF
    for byte in data:
        remainder = _TABLE[remainder ^ byte]
    return remainder ^ 0xFF


def frame_crc(data: bytes, crc_byte: int, data_id: int) -> int:
    """Return the CRC of a frame: over the data id's low and high byte, then all bytes but its own.

    `data` is the whole frame; the value in place at index `crc_byte` is ignored.
    """
    head = bytes((data_id & 0xFF, data_id >> 8 & 0xFF))
    return crc8_j1850(head + data[:crc_byte] + data[crc_byte + 1 :])
