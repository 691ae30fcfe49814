"""tools/vcanrun [options] -- COMMAND [ARG ...]: run a command where vcan0 exists.

The command sees the host's files and its own environment; stdin is /dev/null, stdout and stderr
are streamed. lo carries multicast. In a guest (uml, qemu) the current directory and every --rw
directory are the host's own; writes anywhere else go to memory and are lost, there is no network
but lo, and the command is root inside. VCANRUN_BACKEND tells the command where it runs.

Exit status: the command's; 124 at the time limit; 125 when the runner failed; 128+N when the
runner was ended by signal N.
"""

import argparse
import math
import sys
from pathlib import Path
from typing import NoReturn

from vcan import guest_session, native, qemu, uml
from vcan.run_request import BackendMissing, RunnerError, RunRequest

TIME_LIMIT = 124  # as timeout(1)
RUNNER_FAILED = 125  # as timeout(1), env(1) and docker run


class _Parser(argparse.ArgumentParser):
    """Its own errors must not look like an exit status of the command."""

    def error(self, message: str) -> NoReturn:
        self.exit(RUNNER_FAILED, f"{self.prog}: {message}\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="vcanrun", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--backend",
        choices=["auto", native.NAME, uml.NAME, qemu.NAME],
        default="auto",
        help="where the kernel comes from (default: the first of native, uml, qemu that works)",
    )
    parser.add_argument(
        "--buses", type=_bus_count, default=1, metavar="N", help="vcan0 .. vcanN-1 (default 1)"
    )
    parser.add_argument(
        "--controllers",
        type=_bus_count,
        default=0,
        metavar="N",
        help="also can0 .. canN-1 at 1 Mbit/s on one bus: emulated hardware with its real driver "
        "(qemu only)",
    )
    parser.add_argument(
        "--echo",
        action="store_true",
        help="only a vcan that echoes a frame when it leaves its queue, as hardware does (a "
        "guest's always does; this kernel's if loaded with echo=1)",
    )
    parser.add_argument(
        "--timeout",
        type=_positive_s,
        metavar="S",
        help="limit in seconds, from the start of the command (default: none)",
    )
    parser.add_argument(
        "--rw",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="a further directory of the host that a guest may write to",
    )
    parser.add_argument(
        "--mem", type=_memory, default="2G", metavar="SIZE", help="memory of a guest (default 2G)"
    )
    parser.add_argument(
        "--verbose", action="store_true", help="say which backend runs and why, and a guest's log"
    )
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="-- COMMAND")
    return parser


def _bus_count(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 64:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of buses from 1 to 64")
    return int(text)


def _positive_s(text: str) -> float:
    try:
        value_s = float(text)
    except ValueError:
        value_s = math.nan
    if not 0 < value_s < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of seconds")
    return value_s


def _memory(text: str) -> str:
    if not text[:-1].isdecimal() or text[-1:] not in ("M", "G"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a size such as 512M or 2G")
    return text


def _request(options: argparse.Namespace) -> RunRequest:
    command = options.command[1:] if options.command[:1] == ["--"] else options.command
    if not command:
        raise RunnerError("no command given (vcanrun [options] -- COMMAND [ARG ...])")
    writable = []
    for path in [Path.cwd(), *options.rw]:
        path = path.resolve()
        if not path.is_dir():
            raise RunnerError(f"--rw {path} is not a directory")
        if path not in writable and path != Path("/"):
            writable.append(path)
    return RunRequest(
        command=command,
        buses=options.buses,
        timeout_s=options.timeout,
        memory=options.mem,
        writable=writable,
        verbose=options.verbose,
        controllers=options.controllers,
        echo=options.echo,
    )


def _run(backend: str, request: RunRequest) -> int | None:
    refusals = []
    if request.controllers:
        if backend not in ("auto", qemu.NAME):
            raise RunnerError(f"--controllers needs --backend qemu, not {backend}")
        backend = qemu.NAME

    def say(name: str, reason: str) -> None:
        if request.verbose:
            print(f"vcanrun: {name}: {'; '.join([*refusals, reason])}", file=sys.stderr)

    if backend in ("auto", native.NAME):
        try:
            place = native.find_place(request)
        except BackendMissing as missing:
            refusals.append(f"{missing}")
        else:
            say(native.NAME, place.reason)
            return native.run(request, place)
    for guest in (uml, qemu):
        if backend not in ("auto", guest.NAME):
            continue
        try:
            guest.check()
        except BackendMissing as missing:
            refusals.append(f"{missing}")
        else:
            say(guest.NAME, f"{guest.NAME} is installed" if refusals else "asked for")
            return guest_session.run(request, guest.NAME, guest.prepare)
    raise RunnerError(f"no vcan to be had: {'; '.join(refusals)}")


def main() -> int:
    options = _parser().parse_args()
    try:
        status = _run(options.backend, _request(options))
    except RunnerError as error:
        print(f"vcanrun: {error}", file=sys.stderr)
        return RUNNER_FAILED
    if status is None:
        print(f"vcanrun: time limit of {options.timeout:g} s reached", file=sys.stderr)
        return TIME_LIMIT
    return status
