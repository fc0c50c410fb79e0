"""Whether the bounds of the dependencies are true: ``make bounds``.

Runs the fast tests with the lowest and with the newest versions that pyproject.toml allows, each
in an environment of its own, and resolves the package for other systems and versions of Python.
The tests run in the Python that runs this, or in those whose paths are given: ``make bounds
PYTHONS="python3.11 python3.13"``.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
RESOLUTIONS = ("lowest-direct", "highest")
PLATFORMS = ("x86_64-manylinux_2_28", "aarch64-apple-darwin", "x86_64-pc-windows-msvc")
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
EXTRAS = ("fast", "cluster", "notebook", "gym")
QUIET = "ignore::DeprecationWarning"
"""Old versions warn of what newer ones no longer do; newest versions must be silent."""


def uv(*arguments: str | Path) -> None:
    """Run uv with the certificates of the system, and end where it fails."""
    trusting = os.environ | {"UV_SYSTEM_CERTS": "1", "UV_NATIVE_TLS": "1"}  # new and old name
    command = [sys.executable, "-m", "uv", "--quiet", *arguments]
    subprocess.run(command, check=True, cwd=ROOT, env=trusting)


def tested(interpreter: str, resolution: str, folder: Path) -> bool:
    """Whether the fast tests pass with such versions."""
    uv("venv", "--python", interpreter, folder)
    python = folder / "bin" / "python"
    uv("pip", "install", "--python", python, "--resolution", resolution, "--editable", ".[dev]")
    command = [python, "-m", "pytest", "-n", "2", "--dist", "loadfile"]
    command += ["-m", "not (slow or soak or counts)", *(["-W", QUIET] * (resolution != "highest"))]
    done = subprocess.run(
        command, check=False, cwd=ROOT, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    )
    print(
        f"{interpreter}, {resolution}: {'passed' if done.returncode == 0 else 'FAILED'}", flush=True
    )
    return done.returncode == 0


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        for platform in PLATFORMS:
            for python in PYTHONS:
                uv(
                    *("pip", "compile", "pyproject.toml", "--only-binary", ":all:"),
                    *("--python-platform", platform, "--python-version", python),
                    *(word for extra in EXTRAS for word in ("--extra", extra)),
                    *("--output-file", Path(folder) / "resolved.txt"),
                )
            print(f"{platform}: wheels for Python {', '.join(PYTHONS)}", flush=True)
        passed = [
            tested(interpreter, resolution, Path(folder) / f"{i}-{resolution}")
            for i, interpreter in enumerate(sys.argv[1:] or [sys.executable])
            for resolution in RESOLUTIONS
        ]
    return 0 if all(passed) else 1


if __name__ == "__main__":
    sys.exit(main())
