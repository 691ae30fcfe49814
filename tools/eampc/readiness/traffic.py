"""The frames on the bus: rates, jitter, counters, CRC, and what they say. Listens only."""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise

import can
from eampc_rig import Frames, MessageCodec, Rig

from eampc.readiness.finding import Finding, judged

# An encoder's clock is good to 100 ppm; a rate that is this far off is another rate.
RATE_TOLERANCE = 0.05
MOST_FOREIGN = 8
FEWEST_FRAMES = 3  # for a mean interval and a deviation from it


@dataclass
class Recording:
    """Frames by identifier, each with its stamp, s."""

    seconds: float
    frames: dict[tuple[int, bool], list[tuple[float, bytes]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    error_frames: int = 0
    remote_frames: int = 0

    def add(self, message: can.Message) -> None:
        if message.is_error_frame:
            self.error_frames += 1
        elif message.is_remote_frame:
            self.remote_frames += 1
        else:
            key = (message.arbitration_id, message.is_extended_id)
            self.frames[key].append((message.timestamp, bytes(message.data)))

    def of(self, codec: MessageCodec) -> list[tuple[float, bytes]]:
        return self.frames.get((codec.frame_id, codec.is_extended), [])


def listen(bus: can.BusABC, seconds: float) -> Recording:
    recording = Recording(seconds)
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        if (message := bus.recv(left)) is not None:
            recording.add(message)
    return recording


def judge_traffic(rig: Rig, frames: Frames, recording: Recording) -> list[Finding]:
    """Findings on a recording of a bus with this rig's messages."""
    findings = [_encoder(rig, frames, recording), *_contents(frames, recording)]
    findings += _supply(rig, frames, recording)
    findings.append(_commands(frames, recording))
    findings.append(
        judged(
            "error frames",
            recording.error_frames == 0,
            f"{recording.error_frames} in {recording.seconds:g} s",
            "look at cables, termination and bit rates; `candump -e` names each",
        )
    )
    findings.append(Finding("other frames", _foreign(frames, recording)))
    return findings


def _rate(stamps: list[float]) -> tuple[float, float]:
    """Frames per second over the whole recording, and the furthest an interval is from its mean,
    s; of three stamps or more."""
    mean_s = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
    jitter_s = max(abs(later - earlier - mean_s) for earlier, later in pairwise(stamps))
    return (1.0 / mean_s if mean_s > 0.0 else 0.0), jitter_s


def _encoder(rig: Rig, frames: Frames, recording: Recording) -> Finding:
    codec, seen = frames.encoder, recording.of(frames.encoder)
    topic = "encoder rate"
    wanted_hz = 1.0 / rig.control.period_s
    if len(seen) < FEWEST_FRAMES:
        if rig.control.trigger == "sync":
            return Finding(topic, "silent: it answers the daemon's Sync")
        return Finding(
            topic,
            f"{len(seen)} frames of 0x{codec.frame_id:x} in {recording.seconds:g} s",
            False,
            "is it powered, is its identifier the DBC's, is its bit rate the bus's?",
        )
    rate_hz, jitter_s = _rate([stamp for stamp, _ in seen])
    found = f"{rate_hz:.4g} Hz, jitter {1e3 * jitter_s:.2f} ms"
    right = abs(rate_hz - wanted_hz) <= RATE_TOLERANCE * wanted_hz
    return judged(
        topic, right, found, f"the rig's period_s asks for {wanted_hz:g} Hz: set the encoder so"
    )


def _contents(frames: Frames, recording: Recording) -> list[Finding]:
    """Length, CRC and counter of every message that the daemon reads."""
    watched = {
        "encoder": frames.encoder,
        "valve feedback": frames.valve_feedback,
        "heartbeat": frames.heartbeat if frames.heartbeat_monitored else None,
        "emergency": frames.emergency,
        "stop button": frames.e_stop,
    }
    findings = []
    for name, codec in watched.items():
        if codec is None:
            continue
        seen = recording.of(codec)
        if not seen:
            # Emergencies are sent when there is one, a stop button when it is pressed.
            if codec is frames.encoder:
                continue  # _encoder has said so
            needed = name in ("valve feedback", "heartbeat")
            findings.append(
                Finding(
                    f"{name} {codec.name}",
                    "no frame",
                    False if needed else None,
                    "is the valve node powered? The daemon stops without it" if needed else "",
                )
            )
            continue
        bytes_seen = [data for _, data in seen]
        findings.append(_content(name, codec, bytes_seen, frames.e_stop_released_raw))
    return findings


def _content(name: str, codec: MessageCodec, seen: list[bytes], released_raw: int) -> Finding:
    decoded = [codec.decode(data) for data in seen]
    damaged = sum(not frame.valid for frame in decoded)
    counters = [frame.counter for frame in decoded if frame.valid and frame.counter is not None]
    modulus = codec.counter_modulus or 1
    gaps = sum((later - earlier) % modulus != 1 for earlier, later in pairwise(counters))
    newest = next((frame.values for frame in reversed(decoded) if frame.valid), {})
    said = ", ".join(f"{role} {value:g}" for role, value in newest.items())
    topic = f"{name} {codec.name}"
    if name == "emergency" and newest.get("error_code", 1.0) != 0.0:
        return Finding(topic, said, False, "the node reports an error: see its manual for the code")
    if name == "stop button" and newest.get("stop", 1.0) != released_raw:
        return Finding(topic, said, False, "it is pressed: release it when the joint may move")
    return judged(
        topic,
        damaged == 0 and gaps == 0,
        f"{len(seen)} frames, {damaged} damaged, {gaps} counter gaps; {said}",
        "length, CRC and counter must be the DBC's; gaps without damage: two senders, or lost "
        "frames",
    )


def _supply(rig: Rig, frames: Frames, recording: Recording) -> list[Finding]:
    codec = frames.valve_feedback
    low, high = rig.safety.supply_pressure_min_kPa, rig.safety.supply_pressure_max_kPa
    if codec is None or "supply_pressure" not in codec.roles:
        return [Finding("supply pressure", "not measured: read the gauge")]
    valid = [f for _, data in recording.of(codec) if (f := codec.decode(data)).valid]
    if not valid:
        return []
    pressure_kPa = valid[-1].values["supply_pressure"]
    found = f"{pressure_kPa:.0f} kPa"
    if low is not None and pressure_kPa < low:
        return [
            Finding(
                "supply pressure",
                f"{found}, below safety.supply_pressure_min_kPa = {low:g}: shut, or not enough",
                None,
            )
        ]
    too_high = high is not None and pressure_kPa > high
    return [
        judged(
            "supply pressure",
            not too_high,
            found,
            f"above safety.supply_pressure_max_kPa = {high:g}: turn the regulator down"
            if high is not None
            else "",
        )
    ]


def _commands(frames: Frames, recording: Recording) -> Finding:
    seen = recording.of(frames.valve_command)
    if not seen:
        return Finding("valve commands", "nobody sends any", True)
    enabled = sum(
        frame.valid and frame.values.get("enable", 1.0) != 0.0
        for frame in map(frames.valve_command.decode, (data for _, data in seen))
    )
    return judged(
        "valve commands",
        enabled == 0,
        f"{len(seen)} frames, {enabled} of them enabled",
        "the joint is being moved: disarm the daemon, or find the other sender",
    )


def _foreign(frames: Frames, recording: Recording) -> str:
    codecs = [
        *(frames.encoder, frames.valve_command, frames.valve_feedback, frames.sync),
        *(frames.heartbeat, frames.emergency, frames.e_stop, frames.identity, frames.nmt_start),
    ]
    known = {(codec.frame_id, codec.is_extended) for codec in codecs if codec is not None}
    others = sorted((-len(seen), key) for key, seen in recording.frames.items() if key not in known)
    if not others:
        return f"none in {recording.seconds:g} s"
    shown = [
        f"0x{identifier:0{8 if extended else 3}x} {-count / recording.seconds:.3g}/s"
        for count, (identifier, extended) in others[:MOST_FOREIGN]
    ]
    more = f" and {len(others) - MOST_FOREIGN} more" if len(others) > MOST_FOREIGN else ""
    return ", ".join(shown) + more
