"""The C++ frame codec against cantools on random layouts, bit for bit; the CRC against crccheck."""

import math

import pytest
from cantools.database import Message, Signal
from cantools.database.conversion import BaseConversion
from crccheck.crc import Crc8SaeJ1850
from eampc import _core
from hypothesis import assume, given, settings
from hypothesis import strategies as st

CASES = 400
# A double holds whole numbers up to here; longer signals are compared on the values it does hold.
EXACT_BITS = 53


def occupied(start: int, length: int, little_endian: bool) -> set[int]:
    """Bits 8·byte + bit_in_byte of a signal, by the DBC's rules."""
    if little_endian:
        return set(range(start, start + length))
    bits, position = set(), start
    for _ in range(length):
        bits.add(position)
        position = position + 15 if position % 8 == 0 else position - 1
    return bits


@st.composite
def layouts(draw: st.DrawFn) -> list[dict]:
    """One to five signals of a frame that do not overlap; both byte orders mixed."""
    taken: set[int] = set()
    found = []
    for _ in range(draw(st.integers(1, 5))):
        little_endian = draw(st.booleans())
        start = draw(st.integers(0, 63))
        length = draw(st.integers(1, 32 if found else 64))
        bits = occupied(start, length, little_endian)
        if max(bits) > 63 or bits & taken:
            continue
        taken |= bits
        is_signed = draw(st.booleans()) if length > 1 else False
        found.append(
            {
                "start_bit": start,
                "length": length,
                "little_endian": little_endian,
                "is_signed": is_signed,
                "factor": draw(
                    st.sampled_from([1.0, -1.0, 0.5, 0.001, 4.7936899621426287e-05, 10.0, -0.0125])
                ),
                "offset": draw(st.sampled_from([0.0, 1.0, -40.0, 0.3])),
            }
        )
    assume(found)
    return found


def message(signals: list[dict]) -> Message:
    """The same frame for cantools."""
    return Message(
        frame_id=0x123,
        name="Random",
        length=8,
        strict=True,
        signals=[
            Signal(
                name=f"s{number}",
                start=layout["start_bit"],
                length=layout["length"],
                byte_order="little_endian" if layout["little_endian"] else "big_endian",
                is_signed=layout["is_signed"],
                conversion=BaseConversion.factory(
                    scale=layout["factor"], offset=layout["offset"], choices=None, is_float=False
                ),
            )
            for number, layout in enumerate(signals)
        ],
    )


def raw_range(layout: dict) -> tuple[int, int]:
    if layout["is_signed"]:
        return -(1 << (layout["length"] - 1)), (1 << (layout["length"] - 1)) - 1
    return 0, (1 << layout["length"]) - 1


@settings(max_examples=CASES, deadline=None)
@given(layouts(), st.data())
def test_encodes_as_cantools_does(signals: list[dict], data: st.DataObject) -> None:
    values = []
    for layout in signals:
        low, high = raw_range(layout)
        exact = 1 << EXACT_BITS
        raw = data.draw(st.integers(max(low, -exact), min(high, exact)))
        between = data.draw(st.floats(-0.49, 0.49)) if low < raw < high else 0.0
        values.append((raw + between) * layout["factor"] + layout["offset"])
    # cantools refuses what it cannot carry; a rounding past the end is the next test's business.
    for layout, value in zip(signals, values, strict=True):
        low, high = raw_range(layout)
        assume(low <= round((value - layout["offset"]) / layout["factor"]) <= high)
    expected = message(signals).encode(
        {f"s{number}": value for number, value in enumerate(values)}, strict=False
    )
    assert _core.encode_signals(signals, values) == expected


@settings(max_examples=CASES, deadline=None)
@given(layouts(), st.binary(min_size=8, max_size=8))
def test_decodes_as_cantools_does(signals: list[dict], data: bytes) -> None:
    expected = message(signals).decode(data)
    for number, (layout, value) in enumerate(
        zip(signals, _core.decode_signals(signals, data), strict=True)
    ):
        raw = (expected[f"s{number}"] - layout["offset"]) / layout["factor"]
        # With whole factors cantools keeps whole numbers that no double holds.
        if max(abs(raw), abs(expected[f"s{number}"])) < 1 << EXACT_BITS:
            assert value == expected[f"s{number}"]
        else:
            assert math.isclose(value, expected[f"s{number}"], rel_tol=1e-12)


@settings(max_examples=CASES, deadline=None)
@given(layouts(), st.sampled_from([1e30, -1e30, math.inf, -math.inf]))
def test_saturates_at_the_raw_range(signals: list[dict], value: float) -> None:
    for layout in signals:
        low, high = raw_range(layout)
        raw = high if value * layout["factor"] > 0 else low
        data = message([layout]).encode({"s0": raw}, scaling=False, strict=False)
        assert _core.encode_signals([layout], [value]) == data


@settings(max_examples=CASES, deadline=None)
@given(st.binary(min_size=1, max_size=8), st.integers(0, 7), st.integers(0, 0xFFFF))
def test_crc_is_sae_j1850(data: bytes, byte: int, data_id: int) -> None:
    assume(byte < len(data))
    covered = bytes([data_id & 0xFF, data_id >> 8]) + data[:byte] + data[byte + 1 :]
    assert _core.frame_crc(data, byte, data_id) == Crc8SaeJ1850.calc(covered)


def test_a_signal_beyond_the_frame_is_refused() -> None:
    layout = {
        "start_bit": 60,
        "length": 8,
        "little_endian": True,
        "is_signed": False,
        "factor": 1.0,
        "offset": 0.0,
    }
    with pytest.raises(ValueError, match="does not fit"):
        _core.encode_signals([layout], [1.0])
