"""A first load of an aircraft's files in a process of its own: some make JSBSim end the process."""

import subprocess
import sys
from functools import lru_cache
from typing import NoReturn

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.errors import PlantError
from flighttune.plants.jsbsim.model_files import (
    Unchanged,
    file_tree,
    model_folders,
    source_folders,
    stamps,
)
from flighttune.processes import crash_of
from flighttune.shipped import is_trusted

TIME_LIMIT_S = 60.0
"""Time that JSBSim may take to load an aircraft; it takes a tenth of a second."""

# JSBSim evaluates an aircraft once more when it frees it, and may end the process then: `_exit`.
_PROGRAM = """
import os, sys
import resource
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
import jsbsim
try:
    fdm = jsbsim.FGFDMExec(sys.argv[1])
    fdm.set_debug_level(0)
    if fdm.load_model_with_paths(*sys.argv[2:], False):
        fdm.run_ic()
except Exception:
    pass
os._exit(0)
"""


def check_loads(config: AircraftConfig) -> None:
    """Refuse an aircraft whose files make JSBSim end the process.

    Files that this process has not loaded yet are loaded by another one first, which takes about
    0.3 s. Shipped aircraft are known to load.

    Raises PlantError if JSBSim ends the process, or does not come to an end.
    """
    if is_trusted(config.folder) or not sys.executable:
        return
    how = _end_of_trial(Unchanged(config, stamps(file_tree(config))))
    if how:
        raise PlantError(f"{source_folders(config).file}: JSBSim must load it, but {how}.")


@lru_cache(maxsize=256)
def _end_of_trial(files: Unchanged) -> str:
    """Reason why the process that loaded the files failed; empty if it did not."""
    config = files.config.with_off_nominal(None)  # factors do not decide whether the files load
    with model_folders(config, _unweighed) as folders:
        paths = (config.folder, folders.name, folders.model, folders.engines, folders.systems)
        try:
            code = subprocess.run(
                # -P: a `jsbsim.py` in the working directory must not be imported.
                [sys.executable, "-P", "-c", _PROGRAM, *map(str, paths)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=TIME_LIMIT_S,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            return f"it did not within {TIME_LIMIT_S:g} s"
    if crash := crash_of(code):
        return f"it ended the process that tried: {crash}"
    return f"the process that tried ended with status {code}" if code else ""


def _unweighed(config: AircraftConfig) -> NoReturn:
    raise AssertionError(f"{config.file}: the nominal aircraft needs no weighing")
