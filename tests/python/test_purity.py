"""Folders say what code may do: an include or import that points the wrong way fails here."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DAEMON = ROOT / "daemon"

STAGES = (
    "encoder_codec",
    "state_estimator",
    "disturbance_estimator",
    "explicit_law",
    "safety",
    "valve_codec",
)
# What safety consists of, in the order of its own data flow.
SAFETY_PARTS = (
    "monitor_codec",
    "encoder_supervision",
    "fault_detection",
    "arming",
    "stop_ramp",
    "mode_machine",
    "voltage_guard",
)
# Headers that daemon/control may use: numbers, fixed-size data, vector instructions.
PURE_STANDARD_HEADERS = {
    "algorithm",
    "arm_neon.h",
    "array",
    "bit",
    "cmath",
    "cstddef",
    "cstdint",
    "immintrin.h",
    "limits",
    "numbers",
    "span",
    "type_traits",
    "utility",
}
# What would break "no clock, heap, throw, I/O" even where no header tells.
FORBIDDEN_WORDS = re.compile(
    r"\b(throw|try|catch|new|delete|malloc|free|printf|std::string|std::vector|std::function|"
    r"std::chrono|std::mutex|std::thread|virtual|static_cast<void\*>)\b"
)
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]', re.MULTILINE)
COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
TEXT = re.compile(r'"(?:\\.|[^"\\])*"')


def sources(folder: Path) -> list[Path]:
    return sorted([*folder.glob("*.hpp"), *folder.glob("*.cpp")])


def includes(file: Path) -> list[tuple[str, str]]:
    return INCLUDE.findall(file.read_text(encoding="utf-8"))


def own_includes(file: Path) -> list[str]:
    return [name for mark, name in includes(file) if mark == '"']


CONTROL = sources(DAEMON / "control")


def test_there_is_something_to_check() -> None:
    assert {f"{stage}.cpp" for stage in STAGES} <= {file.name for file in CONTROL}


@pytest.mark.parametrize("file", CONTROL, ids=lambda file: file.name)
def test_control_includes_only_what_is_pure(file: Path) -> None:
    for mark, name in includes(file):
        if mark == '"':
            assert name.startswith("control/"), f"{file.name} includes {name}"
        else:
            pure = name in PURE_STANDARD_HEADERS or name.startswith("Eigen/")
            assert pure, f"{file.name} includes <{name}>"


@pytest.mark.parametrize("file", CONTROL, ids=lambda file: file.name)
def test_control_has_no_clock_heap_or_throw(file: Path) -> None:
    code = TEXT.sub('""', COMMENT.sub("", file.read_text(encoding="utf-8")))
    found = FORBIDDEN_WORDS.search(code)
    assert found is None, f"{file.name} uses {found.group(0)}"


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_includes_no_other_stage(stage: str) -> None:
    others = {f"control/{other}.hpp" for other in (*STAGES, "control_cycle") if other != stage}
    for file in (DAEMON / "control" / f"{stage}.hpp", DAEMON / "control" / f"{stage}.cpp"):
        assert not others & set(own_includes(file)), file.name


@pytest.mark.parametrize("part", SAFETY_PARTS)
def test_a_part_of_safety_knows_only_the_parts_before_it(part: str) -> None:
    later = SAFETY_PARTS[SAFETY_PARTS.index(part) + 1 :]
    forbidden = {f"control/{name}.hpp" for name in (*later, *STAGES, "control_cycle")}
    for file in (DAEMON / "control" / f"{part}.hpp", DAEMON / "control" / f"{part}.cpp"):
        assert not forbidden & set(own_includes(file)), file.name


@pytest.mark.parametrize("stage", [stage for stage in STAGES if stage != "safety"])
def test_the_parts_of_safety_are_its_own(stage: str) -> None:
    parts = {f"control/{part}.hpp" for part in SAFETY_PARTS}
    for file in (DAEMON / "control" / f"{stage}.hpp", DAEMON / "control" / f"{stage}.cpp"):
        assert not parts & set(own_includes(file)), file.name


def test_what_stages_share_knows_no_stage() -> None:
    shared = ("control_types", "controller_config", "frame_codec", "point_location")
    stages = {f"control/{stage}.hpp" for stage in (*STAGES, "control_cycle")}
    for name in (*shared, "reference_trajectory"):
        for file in (DAEMON / "control").glob(f"{name}.?pp"):
            assert not stages & set(own_includes(file)), file.name


def test_stages_stand_in_the_order_of_the_data_flow() -> None:
    listed = (DAEMON / "control" / "CMakeLists.txt").read_text(encoding="utf-8")
    before, after = STAGES[: STAGES.index("safety")], STAGES[STAGES.index("safety") :]
    flow = (*before, *SAFETY_PARTS, *after, "control_cycle")
    places = [listed.index(f"  {stage}.cpp") for stage in flow]
    assert places == sorted(places)


@pytest.mark.parametrize(
    ("folder", "may_include"),
    [
        ("realtime", ("realtime/", "control/")),
        ("service", ("service/", "realtime/", "control/", "lcmtypes/", "eampc_lcm")),
    ],
)
def test_daemon_folders_point_down(folder: str, may_include: tuple[str, ...]) -> None:
    for file in sources(DAEMON / folder):
        for name in own_includes(file):
            assert name.startswith(may_include), f"{file.relative_to(ROOT)} includes {name}"


def imported(file: Path) -> set[str]:
    """First names of every module that a Python file imports, at whatever depth."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize(
    ("package", "forbidden"),
    [
        ("tools/eampc", {"plant_emulator"}),
        ("plant_emulator", {"eampc"}),
        ("rigs/eampc_rig", {"eampc", "plant_emulator"}),
    ],
)
def test_python_packages_point_down(package: str, forbidden: set[str]) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for file in files:
        assert not imported(file) & forbidden, file.relative_to(ROOT)
