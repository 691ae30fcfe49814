"""Faults of the bus itself: forged error frames, and an interface that fails.

An error frame may be sent by any user; it reaches the sockets that asked for error frames, as the
driver's own would. What the interface does acts on every program that uses it, this one included.
"""

from __future__ import annotations

from collections.abc import Callable

import can

from plant_emulator.can_interface import CanInterface
from plant_emulator.fault_injection import FaultInjector

# linux/can/error.h
_CAN_ERR_CRTL, _CAN_ERR_BUSOFF, _CAN_ERR_RESTARTED, _CAN_ERR_CNT = 0x4, 0x40, 0x100, 0x200
_CRTL_RX_PASSIVE, _CRTL_TX_PASSIVE, _CRTL_ACTIVE = 0x10, 0x20, 0x40
_PASSIVE_COUNT, _BUS_OFF_COUNT = 128, 255
# The highest identifier: what fills a queue must mean nothing to anybody.
_FILLER_ID = 0x7FF


class BusFaults:
    """Starts and ends the bus faults of one run."""

    def __init__(self, faults: FaultInjector, interface: CanInterface | None) -> None:
        """interface: None where the bus has none (emulation); then nothing ever happens."""
        self._faults = faults
        self._interface = interface
        self._holding: set[str] = set()

    def begin_frame(self, frame: int, send: Callable[[can.Message], None]) -> None:
        """Begin and end what begins and ends with encoder frame `frame`."""
        if self._interface is None:
            return
        for kind in ("bus_off", "error_passive", "link_down", "send_refused", "tx_unconfirmed"):
            holds = self._faults.holds(kind, frame)
            if holds and kind not in self._holding:
                self._holding.add(kind)
                self._begin(kind, self._interface, send)
            elif not holds and kind in self._holding:
                self._holding.discard(kind)
                self._end(kind, self._interface, send)

    def end(self) -> None:
        """Leave the interface as it was found."""
        if self._interface is not None:
            for kind in sorted(self._holding):
                self._end(kind, self._interface, lambda _: None)
            self._holding.clear()

    def _begin(
        self, kind: str, interface: CanInterface, send: Callable[[can.Message], None]
    ) -> None:
        if kind == "bus_off":
            send(_error_frame(_CAN_ERR_BUSOFF | _CAN_ERR_CNT, 0, _BUS_OFF_COUNT))
        elif kind == "error_passive":
            state = _CRTL_RX_PASSIVE | _CRTL_TX_PASSIVE
            send(_error_frame(_CAN_ERR_CRTL | _CAN_ERR_CNT, state, _PASSIVE_COUNT))
        elif kind == "link_down":
            interface.set_up(False)
        elif kind == "send_refused":
            interface.fill_queue()
            send(can.Message(arbitration_id=_FILLER_ID, is_extended_id=False, data=b""))
        else:
            interface.hold_frames()

    def _end(self, kind: str, interface: CanInterface, send: Callable[[can.Message], None]) -> None:
        if kind == "bus_off":
            send(_error_frame(_CAN_ERR_RESTARTED, 0, 0))
        elif kind == "error_passive":
            send(_error_frame(_CAN_ERR_CRTL, _CRTL_ACTIVE, 0))
        elif kind == "link_down":
            interface.set_up(True)
        elif kind == "tx_unconfirmed":
            interface.release_frames()
        else:
            interface.free_queue()


def _error_frame(classes: int, controller: int, errors: int) -> can.Message:
    # Byte 1: the controller's state; bytes 6 and 7: transmit and receive error counter.
    data = bytes([0, controller, 0, 0, 0, 0, errors, errors])
    return can.Message(
        arbitration_id=classes, is_error_frame=True, is_extended_id=False, data=data, check=False
    )
