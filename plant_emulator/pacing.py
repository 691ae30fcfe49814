"""How periods follow each other: in real time on an absolute grid, or in lock-step."""

from __future__ import annotations

import heapq
import math
import threading
import time
from dataclasses import dataclass

import can

from plant_emulator.bus_faults import BusFaults
from plant_emulator.daemon_process import DaemonProcess
from plant_emulator.emulator_error import EmulatorError
from plant_emulator.joint_node import JointNode
from plant_emulator.truth_log import TruthRow

ANSWER_LIMIT_S = 5.0  # lock-step: how long a daemon may take for one answer
_WAIT_SLICE_S = 0.1  # how late a request to stop may be noticed
_OLD_FRAMES_MAX = 10000
_BUS_PAUSE_S = 0.001  # before a bus that failed is asked again


@dataclass(slots=True)
class PacingCounts:
    """What happened to the grid and the bus."""

    overruns: int = 0  # frames that could not go out on their instant
    send_errors: int = 0
    receive_errors: int = 0


class Pacing:
    """What both ways share: the bus, the request to stop, the counts."""

    def __init__(
        self, bus: can.BusABC, node: JointNode, stop: threading.Event, bus_faults: BusFaults
    ) -> None:
        self._bus = bus
        self._node = node
        self._stop = stop
        self._bus_faults = bus_faults
        self.counts = PacingCounts()
        self._forget_old_frames()

    def _forget_old_frames(self) -> None:
        # What came before the run is no answer; bounded, for a bus that never falls silent.
        for _ in range(_OLD_FRAMES_MAX):
            try:
                if self._bus.recv(0.0) is None:
                    return
            except (can.CanError, OSError):
                self.counts.receive_errors += 1

    def _start_nodes(self, limit_s: float) -> bool:
        """Wait until CANopen nodes, if the rig has any, are started: before that there is no
        encoder frame to count. Return whether the run may begin.

        Raises EmulatorError if nobody starts them within `limit_s`.
        """
        begin_s = time.monotonic()
        while self._node.waits_for_start and not self._stop.is_set():
            if time.monotonic() - begin_s > limit_s:
                raise EmulatorError(
                    f"nobody started the CANopen nodes within {limit_s:g} s; is a daemon with "
                    "bus.nmt_start on this bus?"
                )
            for message in self._node.idle_messages(self._node.period_s):
                self._send(message)
            message = self._receive(self._node.period_s)
            if message is not None:
                self._node.receive(message, 0.0)
                self._reply()
        return not self._stop.is_set()

    def _reply(self) -> None:
        for reply in self._node.take_replies():
            self._send(reply)


class LockStep(Pacing):
    """Sends frame k, waits for one command per encoder frame sent, steps exactly one period.

    A delayed encoder frame goes out whole periods later, before that period's own frame.
    """

    def __init__(
        self, bus: can.BusABC, node: JointNode, stop: threading.Event, bus_faults: BusFaults
    ) -> None:
        super().__init__(bus, node, stop, bus_faults)
        self._delayed: dict[int, list[bytes]] = {}

    def exchange(self, frame: int) -> TruthRow | None:
        """Run one period; return its truth, or None if the run was asked to stop.

        Raises EmulatorError if the bus fails or no answer comes within ANSWER_LIMIT_S.
        """
        node = self._node
        if frame == 0 and not self._start_nodes(ANSWER_LIMIT_S):
            return None
        self._bus_faults.begin_frame(frame, self._send)
        for message in node.begin_frame(frame):
            self._send(message)
        due = self._delayed.pop(frame, [])
        for delivery in node.encoder_deliveries():
            if delivery.delay_s > 0.0:
                periods = max(1, round(delivery.delay_s / node.period_s))
                self._delayed.setdefault(frame + periods, []).append(delivery.data)
            else:
                due.append(delivery.data)
        sent_s = answered_s = math.nan
        for data in due:
            sent_s = time.monotonic()
            self._send(node.encoder_message(data))
            if not self._await_answer(frame):
                return None
            answered_s = time.monotonic()
        return node.end_frame(sent_s, answered_s)

    def _send(self, message: can.Message) -> None:
        try:
            self._bus.send(message)
        except (can.CanError, OSError) as error:
            raise EmulatorError(f"the bus does not take frames: {_reason(error)}") from None

    def _receive(self, timeout_s: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout_s)
        except (can.CanError, OSError) as error:
            if not isinstance(error.__cause__ or error, OSError):
                self.counts.receive_errors += 1  # a datagram that is no CAN frame
                return None
            raise EmulatorError(f"the bus cannot be read: {_reason(error)}") from None

    def _await_answer(self, frame: int) -> bool:
        limit = time.monotonic() + ANSWER_LIMIT_S
        while not self._stop.is_set():
            left = limit - time.monotonic()
            if left <= 0.0:
                raise EmulatorError(
                    f"no valve command answered encoder frame {frame} within {ANSWER_LIMIT_S:g} s; "
                    "is a daemon in lock-step on this bus?"
                )
            message = self._receive(min(left, _WAIT_SLICE_S))
            is_command = message is not None and self._node.receive(message, 0.0)
            self._reply()
            if is_command:
                return True
        return False


class RealTime(Pacing):
    """Sends frame k at start + k T of CLOCK_MONOTONIC; a late frame goes out at once, is counted,
    and the grid stays. A command acts from the instant it arrives; the plant is integrated shortly
    before the next frame. A bus that fails loses frames, as a real node would.
    """

    # Share of the period kept for integrating the plant: about 0.1 ms of work for 5 ms.
    INTEGRATION_SHARE = 0.1

    def __init__(
        self,
        bus: can.BusABC,
        node: JointNode,
        stop: threading.Event,
        bus_faults: BusFaults,
        daemon: DaemonProcess | None = None,
    ) -> None:
        """daemon: the process that the fault deadline_overruns stops."""
        super().__init__(bus, node, stop, bus_faults)
        self._daemon = daemon
        self._start_s = 0.0
        self._sent_s = 0.0  # the newest encoder frame
        self._delayed: list[tuple[float, int, bytes]] = []
        self._order = 0

    def exchange(self, frame: int) -> TruthRow | None:
        """Run one period; return its truth, or None if the run was asked to stop."""
        node = self._node
        if frame == 0 and not self._start_nodes(math.inf):
            return None
        instant_s = self._await_instant(frame)
        if self._stop.is_set():
            return None
        self._bus_faults.begin_frame(frame, self._send)
        if node.faults.misses_deadline(frame - 1):
            self._stopped_daemon().stop()
        for message in node.begin_frame(frame):
            self._send(message)
        sent_s = math.nan
        for delivery in node.encoder_deliveries():
            if delivery.delay_s > 0.0:
                self._order += 1
                due = (instant_s + delivery.delay_s, self._order, delivery.data)
                heapq.heappush(self._delayed, due)
                continue
            now_s = time.monotonic()
            sent_s = now_s if math.isnan(sent_s) else sent_s
            self._sent_s = now_s
            self._send(node.encoder_message(delivery.data))
        if node.faults.misses_deadline(frame - 2):
            waking_s = max(instant_s, self._sent_s + node.period_s) + 0.5 * node.period_s
            time.sleep(max(0.0, waking_s - time.monotonic()))
            self._stopped_daemon().go_on()
        answered_s = self._listen(instant_s)
        return node.end_frame(sent_s, answered_s)

    def _stopped_daemon(self) -> DaemonProcess:
        if self._daemon is None:
            raise EmulatorError("the fault deadline_overruns needs --daemon-pid")
        return self._daemon

    def _await_instant(self, frame: int) -> float:
        """Wait for the beginning of period `frame`; return its time of CLOCK_MONOTONIC in s."""
        period_s = self._node.period_s
        if frame == 0:
            self._start_s = time.monotonic() + period_s
        instant_s = self._start_s + frame * period_s
        late_s = time.monotonic() - instant_s
        if late_s < 0.0:
            time.sleep(-late_s)
        elif frame > 0:
            self.counts.overruns += 1
        return instant_s

    def _begins_next_period(self, _message: can.Message) -> bool:
        return False  # the grid does, no frame

    def _listen(self, instant_s: float) -> float:
        node, period_s = self._node, self._node.period_s
        end_s = instant_s + period_s * (1.0 - self.INTEGRATION_SHARE)
        answered_s = math.nan
        while True:
            now_s = time.monotonic()
            while self._delayed and self._delayed[0][0] <= now_s:
                self._send(node.encoder_message(heapq.heappop(self._delayed)[2]))
            left_s = end_s - now_s
            if self._delayed:
                left_s = min(left_s, max(0.0, self._delayed[0][0] - now_s))
            # A period that has run out still empties the queue: a command may wait there.
            message = self._receive(max(0.0, left_s))
            now_s = time.monotonic()
            if message is None:
                if now_s >= end_s:
                    return answered_s
                continue
            if self._begins_next_period(message):
                return answered_s
            is_command = node.receive(message, min(max(now_s - instant_s, 0.0), period_s))
            self._reply()
            if is_command:
                answered_s = now_s if math.isnan(answered_s) else answered_s
            if now_s >= instant_s + period_s:
                return answered_s

    def _send(self, message: can.Message) -> None:
        try:
            self._bus.send(message)
        except (can.CanError, OSError):
            self.counts.send_errors += 1

    def _receive(self, timeout_s: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout_s)
        except (can.CanError, OSError):
            self.counts.receive_errors += 1
            time.sleep(_BUS_PAUSE_S)
            return None


class SyncPaced(RealTime):
    """An encoder that samples when the daemon's Sync frame arrives (control.trigger = "sync").

    Before the daemon sends one, nothing happens. The plant advances T per Sync, however far apart
    they arrive.
    """

    def __init__(
        self,
        bus: can.BusABC,
        node: JointNode,
        stop: threading.Event,
        bus_faults: BusFaults,
        sync_id: tuple[int, bool],
        daemon: DaemonProcess | None = None,
    ) -> None:
        """`sync_id` is the identifier and whether it has 29 bits."""
        super().__init__(bus, node, stop, bus_faults, daemon)
        self._sync_id = sync_id
        self._sync_waits = False  # came while the period before was not over

    def _await_instant(self, _frame: int) -> float:
        while not self._sync_waits and not self._stop.is_set():
            message = self._receive(_WAIT_SLICE_S)
            if message is not None and not self._begins_next_period(message):
                self._node.receive(message, 0.0)  # late for the period before, in time for this one
                self._reply()
        self._sync_waits = False
        return time.monotonic()

    def _begins_next_period(self, message: can.Message) -> bool:
        if (message.arbitration_id, message.is_extended_id) != self._sync_id:
            return False
        self._sync_waits = True
        return True


def _reason(error: Exception) -> str:
    cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
    return getattr(cause, "strerror", None) or " ".join(str(error).split())
