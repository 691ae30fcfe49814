"""lcm-spy of the lcm package, started with our message types on its class path."""

import importlib.util
import os
import shutil
from pathlib import Path

import lcm

from eampc.errors import UserError

JAR = "eampc_lcmtypes.jar"


def types_jar() -> Path:
    """The jar of our LCM types, beside the generated Python package."""
    package = importlib.util.find_spec("eampc_lcm")
    folders = list(package.submodule_search_locations or []) if package else []
    for folder in folders:
        jar = Path(folder) / JAR
        if jar.is_file():
            return jar
    raise UserError(
        f"{JAR} is not installed: there was no JDK at build time; install one "
        "(apt install default-jdk-headless) and run tools/setup, or pip install . again"
    )


def spy_command(lcm_url: str | None) -> tuple[list[str], dict[str, str]]:
    """Program with arguments, and environment, of lcm-spy. UserError if java, jar or display is
    missing.
    """
    jar = types_jar()
    if shutil.which("java") is None:
        raise UserError("lcm-spy needs java in PATH; install one (apt install default-jre)")
    if not os.environ.get("DISPLAY"):
        raise UserError(
            "lcm-spy needs a display and DISPLAY is not set; log in graphically, or use Xvfb"
        )
    program = Path(lcm.LCM_BIN_DIR) / "lcm-spy"
    if not program.is_file():
        raise UserError(f"the lcm package has no {program}; install lcm==1.5.3 from PyPI")
    present = os.environ.get("CLASSPATH")
    class_path = f"{jar}{os.pathsep}{present}" if present else str(jar)
    arguments = [str(program), *([f"--lcm-url={lcm_url}"] if lcm_url else [])]
    return arguments, {**os.environ, "CLASSPATH": class_path}
