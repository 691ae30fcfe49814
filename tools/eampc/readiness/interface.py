"""The CAN interface: state, bit rate, counters, and frames that still wait in its queue.

Read with `ip` and `tc` of iproute2; nothing is changed. The judgement is a pure function of what
they print.
"""

from __future__ import annotations

import json
import subprocess
from typing import Any

from eampc.readiness.finding import Finding, judged

# One command in flight is the daemon's rule; a long queue keeps old ones.
LONGEST_QUEUE = 10
ERROR_PASSIVE_FROM = 128


def look_at_interface(name: str) -> list[Finding]:
    links = _read(["ip", "-details", "-statistics", "-json", "link", "show", "dev", name])
    queues = _read(["tc", "-statistics", "-json", "qdisc", "show", "dev", name])
    return judge_interface(name, links, queues)


def _read(command: list[str]) -> list[dict[str, Any]]:
    """What the command prints as JSON; [] where it fails or knows nothing."""
    try:
        done = subprocess.run(command, capture_output=True, check=True, timeout=10)
        entries = json.loads(done.stdout or b"[]")
    except (OSError, subprocess.SubprocessError, ValueError):
        return []
    return [entry for entry in entries if entry]


def judge_interface(
    name: str, links: list[dict[str, Any]], queues: list[dict[str, Any]]
) -> list[Finding]:
    """Findings for the output of `ip -details -statistics -json link` and `tc -s -json qdisc`."""
    if not links:
        return [
            Finding(
                "interface",
                f"there is no {name}",
                False,
                f"plug the adapter in and see `ip link`; a virtual one: ip link add {name} type "
                f"vcan",
            )
        ]
    link = links[0]
    info = link.get("linkinfo", {})
    data = info.get("info_data", {})
    kind = info.get("info_kind", "no kind")
    findings = [
        judged(
            "interface",
            "UP" in link.get("flags", []),
            f"{name} ({kind}) is {'up' if 'UP' in link.get('flags', []) else 'down'}",
            f"ip link set {name} up",
        )
    ]
    if kind == "vcan":
        findings.append(Finding("bit rate", "none, it is a virtual bus"))
    else:
        findings += _judge_controller(name, data, info.get("info_xstats", {}))
    length = link.get("txqlen", 0)
    findings.append(
        judged(
            "queue length",
            kind == "vcan" or length <= LONGEST_QUEUE,
            f"{length} frames",
            f"a long queue keeps old commands: ip link set {name} txqueuelen {LONGEST_QUEUE}",
        )
    )
    waiting = sum(int(queue.get("qlen", 0)) for queue in queues)
    findings.append(
        judged(
            "waiting frames",
            waiting == 0,
            f"{waiting} in the interface's queue",
            "they would go out when the other node comes back, whoever sent them: "
            f"ip link set {name} down && ip link set {name} up",
        )
    )
    stats = link.get("stats64", {})
    lost = {way: int(stats.get(way, {}).get("over_errors", 0)) for way in ("rx", "tx")}
    dropped = int(stats.get("rx", {}).get("dropped", 0)) + lost["rx"]
    findings.append(Finding("dropped frames", f"{dropped} received ones since the interface is up"))
    return findings


def _judge_controller(name: str, data: dict[str, Any], totals: dict[str, Any]) -> list[Finding]:
    rate = data.get("bittiming", {}).get("bitrate", 0)
    restart_ms = data.get("restart_ms", 0)
    state = data.get("state", "unknown")
    counters = data.get("berr_counter", {})
    transmit, receive = int(counters.get("tx", 0)), int(counters.get("rx", 0))
    passive = max(transmit, receive) >= ERROR_PASSIVE_FROM
    set_rate = (
        f"ip link set {name} down; ip link set {name} type can bitrate 1000000 restart-ms 100"
    )
    return [
        judged("bit rate", rate > 0, f"{rate / 1000:g} kbit/s", set_rate),
        judged(
            "restart after bus-off",
            restart_ms > 0,
            f"after {restart_ms} ms" if restart_ms else "never",
            set_rate,
        ),
        judged(
            "controller",
            state in ("ERROR-ACTIVE", "ERROR-WARNING") and not passive,
            f"{state}, {transmit} transmit and {receive} receive errors",
            "is another node powered, is the bit rate the same everywhere, is the bus terminated "
            f"at both ends? Then: ip link set {name} down && ip link set {name} up",
        ),
        Finding(
            "controller so far",
            ", ".join(f"{totals.get(key, 0)} {text}" for key, text in _TOTALS.items()),
        ),
    ]


_TOTALS = {
    "bus_error": "bus errors",
    "error_passive": "times error passive",
    "bus_off": "times bus-off",
    "restarts": "restarts",
}
