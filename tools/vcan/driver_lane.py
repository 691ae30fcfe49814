"""tools/driver-lane: the daemon on a real CAN driver, two emulated boards on one wire.

QEMU runs Debian's stock kernel with two kvaser_pci boards (SJA1000 controllers) at 1 Mbit/s: the
daemon has can0, the emulated rig can1. Judged: the scenario's tolerances; state and counters of
both interfaces, read with ip; and the tests of stale commands on can0. The emulated wire knows no
missing acknowledgement and no bus-off.

Takes some 10 minutes, so it is no part of tools/test. Exit status: 0 all met, 1 something was not,
125 no such machine could be started.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
DAEMON_BUS, PLANT_BUS = "can0", "can1"
LIMIT_S = 3000
STALE_TESTS = ROOT / "tests" / "vcan" / "test_stale_commands.py"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="driver-lane",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--rig", type=Path, default=ROOT / "rigs" / "reference", metavar="DIR")
    parser.add_argument("--scenario", default="sine", metavar="NAME")
    parser.add_argument("--law", type=Path, metavar="FILE", help="default: designed and kept")
    parser.add_argument("--part", choices=["track", "stale"], help="default: both")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


def _outside(options: argparse.Namespace) -> int:
    """Design on this machine, which is 20 times faster than the emulated one."""
    from eampc import design
    from eampc.hil.law_choice import cached_law
    from eampc_rig import load_rig

    rig = load_rig(options.rig)
    law = options.law or cached_law(rig, lambda path: design(rig).save(path))
    command = [str(ROOT / "tools" / "vcanrun"), "--controllers", "2", "--timeout", str(LIMIT_S)]
    command += ["--", sys.executable, str(Path(__file__)), "--inside"]
    command += ["--rig", str(options.rig.resolve()), "--scenario", options.scenario]
    command += ["--part", options.part] if options.part else []
    return subprocess.call([*command, "--law", str(law.resolve())], cwd=ROOT)


def _inside(options: argparse.Namespace) -> int:
    met = []
    if options.part != "stale":
        met.append(_track(options))
        met += [_interface_is_sound(name) for name in (DAEMON_BUS, PLANT_BUS)]
    if options.part != "track":
        met.append(_stale_commands())
    print(f"driver lane: {sum(met)} of {len(met)} parts met", flush=True)
    return 0 if all(met) else 1


def _track(options: argparse.Namespace) -> bool:
    from eampc.hil import scenario_run
    from eampc.hil.scenario_run import RunSettings, run_scenario
    from eampc_rig import load_rig

    scenario_run.START_LIMIT_S = LIMIT_S  # Python alone takes a minute to start here
    settings = RunSettings(
        rig_path=options.rig,
        variant=None,
        overrides=(),
        emulator_overrides=(),
        bus_url=f"socketcan:{DAEMON_BUS}",
        plant_bus_url=f"socketcan:{PLANT_BUS}",
        lockstep=True,
        law=options.law,
        lcm_url="none",
    )
    with tempfile.TemporaryDirectory() as folder:
        run = run_scenario(load_rig(options.rig), options.scenario, settings, Path(folder))
    found, counters = run.assessment, run.status["counters"]
    print(
        f"{options.scenario}: RMS error {1e3 * found.rms_error_rad:.2f} mrad, {run.seconds:.0f} s"
    )
    for demand in [*found.demands, *found.bounds]:
        limit = f"{'>=' if demand.at_least else '<='} {demand.limit:g}"
        print(f"  {'ok' if demand.met else 'NOT MET'}: {demand.name} {demand.value:g} {limit}")
    confirmed = counters["confirmed_frames"]
    print(f"  {counters['cycles']} cycles, {confirmed} commands confirmed by the controller")
    return found.passed and counters["cycles"] - confirmed <= 1


def _interface_is_sound(name: str) -> bool:
    shown = subprocess.check_output(
        ["ip", "-json", "-details", "-statistics", "link", "show", name]
    )
    link = json.loads(shown)[0]
    can, frames = link["linkinfo"]["info_data"], link["stats64"]
    counters = link["linkinfo"].get("info_xstats", {})
    sound = can["state"] == "ERROR-ACTIVE" and not any(counters.values())
    print(
        f"{name}: {can['state']}, counters {can.get('berr_counter')}, "
        f"{frames['tx']['packets']} frames sent, {frames['rx']['packets']} received, {counters}",
        flush=True,
    )
    return sound and frames["tx"]["packets"] > 0 and frames["rx"]["packets"] > 0


def _stale_commands() -> bool:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "vcan"]
    command += ["--timeout", "900", str(STALE_TESTS)]
    return subprocess.call(command, env={**os.environ, "EAMPC_TEST_INTERFACE": DAEMON_BUS}) == 0


def main() -> int:
    options = _options()
    return _inside(options) if options.inside else _outside(options)


if __name__ == "__main__":
    sys.exit(main())
