"""A command that gets a signal while JSBSim calls Python, at each of these calls in turn.

``python interrupted.py SIGNAL MOST COMMAND...`` prints a JSON line for each end: wait status and
stderr. The command runs in a copy of this process, until it gets none or MOST ends.
"""

import contextlib
import json
import os
import signal
import sys
import tempfile

# What JSBSim calls of its logger.
CALLED = {"set_level", "file_location", "message", "format", "flush"}


def run(number, at, command, file):
    """Run the command and send the signal at a call, counted from 0; its wait status."""
    if child := os.fork():
        return os.waitpid(child, 0)[1]
    os.dup2(file.fileno(), 2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    count, sent = 0, False

    def watch(frame, event, _):
        nonlocal count, sent
        if event == "call" and frame.f_code.co_name in CALLED:
            count += 1
            if count == at + 1:
                sent = True
                os.kill(os.getpid(), number)

    sys.argv = ["flighttune", *command]
    sys.setprofile(watch)
    code = 0
    try:
        flighttune.cli.app.main()
    except SystemExit as end:
        code = end.code or 0
    finally:
        sys.stderr.flush()
        os._exit(code if sent else 99)
    return None


if __name__ == "__main__":
    import flighttune.cli.app
    import flighttune.vehicles.plants.jsbsim.trim

    # A shell starts background commands, and so tests, with SIGINT ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    number, most = signal.Signals[sys.argv[1]], int(sys.argv[2])
    for at in range(most):
        with tempfile.TemporaryFile("w+") as file, contextlib.suppress(KeyboardInterrupt):
            status = run(number, at, sys.argv[3:], file)
            file.seek(0)
            sys.stdout.write(json.dumps([status, file.read()]) + "\n")
            if os.WIFEXITED(status) and os.WEXITSTATUS(status) == 99:
                break
