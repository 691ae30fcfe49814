"""The CAN interface under the bus, and how it is made to fail: link down, queue full, queue held.

Netlink and ioctl by hand, because a program started for each would take several control periods.
Needs CAP_NET_ADMIN in the interface's network namespace.
"""

from __future__ import annotations

import fcntl
import os
import socket
import struct

from plant_emulator.emulator_error import EmulatorError

# linux/sockios.h, linux/if.h
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _IFF_UP = 0x8913, 0x8914, 0x1
# linux/netlink.h, linux/rtnetlink.h, linux/pkt_sched.h
_NLMSG_ERROR, _RTM_NEWQDISC, _RTM_DELQDISC = 2, 36, 37
_NLM_F_REQUEST, _NLM_F_ACK, _NLM_F_REPLACE, _NLM_F_CREATE = 0x1, 0x4, 0x100, 0x400
_TC_H_ROOT, _HANDLE = 0xFFFFFFFF, 0x10000
_TCA_KIND, _TCA_OPTIONS = 1, 2
_PLUG_BLOCK, _PLUG_RELEASE_INDEFINITE, _PLUG_LIMIT = 0, 2, 3
_PLUG_LIMIT_BYTES = 1 << 20
# Ticks of 64 ns: 100 s, longer than any fault lasts.
_NETEM_DELAY_TICKS, _NETEM_LIMIT_FRAMES = 1_562_500_000, 1
_REPLY_BYTES = 4096


class CanInterface:
    """One network interface by name. Every method raises EmulatorError if the kernel refuses."""

    def __init__(self, name: str) -> None:
        self.name = name

    def set_up(self, up: bool) -> None:
        """Bring the link up or down."""
        request = struct.pack("16sH14x", self.name.encode(), 0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
            try:
                answer = fcntl.ioctl(control, _SIOCGIFFLAGS, request)
                flags = struct.unpack_from("16xH", answer)[0]
                flags = flags | _IFF_UP if up else flags & ~_IFF_UP
                request = struct.pack("16sH14x", self.name.encode(), flags)
                fcntl.ioctl(control, _SIOCSIFFLAGS, request)
            except OSError as error:
                raise self._refused(f"{'up' if up else 'down'}", error) from None

    def hold_frames(self) -> None:
        """Keep every frame in the queue from now on; none is confirmed, none arrives."""
        limit = struct.pack("=iI", _PLUG_LIMIT, _PLUG_LIMIT_BYTES)
        self._qdisc(_RTM_NEWQDISC, "plug", limit, _NLM_F_CREATE | _NLM_F_REPLACE)
        self._qdisc(_RTM_NEWQDISC, "plug", struct.pack("=iI", _PLUG_BLOCK, 0), 0)

    def release_frames(self) -> None:
        """Let go what hold_frames kept, in order, and whatever comes after it."""
        release = struct.pack("=iI", _PLUG_RELEASE_INDEFINITE, 0)
        self._qdisc(_RTM_NEWQDISC, "plug", release, 0)

    def fill_queue(self) -> None:
        """Make the queue hold one frame for very long: the one after that is refused (ENOBUFS)."""
        options = struct.pack("=6I", _NETEM_DELAY_TICKS, _NETEM_LIMIT_FRAMES, 0, 0, 0, 0)
        self._qdisc(_RTM_NEWQDISC, "netem", options, _NLM_F_CREATE | _NLM_F_REPLACE)

    def free_queue(self) -> None:
        """Take the queue of hold_frames or fill_queue away, with the frames in it."""
        self._qdisc(_RTM_DELQDISC, "", b"", 0)

    def _qdisc(self, kind: int, discipline: str, options: bytes, flags: int) -> None:
        attributes = b""
        if discipline:
            attributes = _attribute(_TCA_KIND, discipline.encode() + b"\0")
            attributes += _attribute(_TCA_OPTIONS, options)
        try:
            index = socket.if_nametoindex(self.name)
            # tcmsg: family, padding, interface, handle, parent, info
            body = struct.pack("=BxHiIII", 0, 0, index, _HANDLE, _TC_H_ROOT, 0) + attributes
            self._request(kind, body, flags)
        except OSError as error:
            raise self._refused(f"queue {discipline or 'removal'}", error) from None

    def _request(self, kind: int, body: bytes, flags: int) -> None:
        with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as link:
            link.bind((0, 0))
            flags |= _NLM_F_REQUEST | _NLM_F_ACK
            link.send(struct.pack("=IHHII", 16 + len(body), kind, flags, 1, 0) + body)
            answer = link.recv(_REPLY_BYTES)
        answer_kind, code = struct.unpack_from("=4xH10xi", answer)
        if answer_kind == _NLMSG_ERROR and code != 0:
            raise OSError(-code, os.strerror(-code))

    def _refused(self, what: str, error: OSError) -> EmulatorError:
        return EmulatorError(
            f"the interface {self.name} cannot be made to fail ({what}: {error.strerror}); this "
            "needs CAP_NET_ADMIN and, for queues, the kernel modules sch_plug and sch_netem"
        )


def _attribute(kind: int, value: bytes) -> bytes:
    padding = -len(value) % 4
    return struct.pack("=HH", 4 + len(value), kind) + value + b"\0" * padding
