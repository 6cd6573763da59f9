"""`rig` without its second of imports, for tests of many calls: a process that has loaded the program forks for each.

A call has the arguments, folder, environment, standard streams and process group of its caller, and its exit status; one with the
argument -c runs Python code instead. The real start of the program is tested elsewhere (tests/test_interface.py,
tests/rig/test_terminal.py).
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import pkgutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: What the modules of the program import within functions.
LIBRARIES = (
    "h5py", "jinja2", "matplotlib.backends.backend_agg", "matplotlib.backends.backend_svg", "matplotlib.figure", "pandas",
    "pyarrow.parquet", "rich.console", "rich.markup", "rich.table", "scipy.interpolate", "scipy.linalg", "scipy.optimize",
    "scipy.signal", "tornado.web",
)  # fmt: skip
CALL = """#!{python} -IS
import json, os, socket, sys
call = socket.socket(socket.AF_UNIX)
call.connect({address!r})
socket.send_fds(call, [json.dumps([sys.argv[1:], os.getcwd(), os.getpgrp(), dict(os.environ)]).encode()], [0, 1, 2])
call.shutdown(socket.SHUT_WR)
sys.exit(int(call.recv(8) or b"70"))
"""


@contextmanager
def forked_rig(folder: Path, environment: dict[str, str]) -> Iterator[dict[str, str]]:
    """The environment of calls, in which `rig` is served from a folder; it begins with the given one."""
    address = str(folder / "calls")
    command = folder / "rig"
    command.write_text(CALL.format(python=sys.executable, address=address), encoding="utf-8")
    command.chmod(0o755)
    server = subprocess.Popen([sys.executable, __file__, address], env=environment, stdout=subprocess.PIPE)
    assert server.stdout is not None
    server.stdout.readline()
    try:
        yield {**environment, "PATH": f"{folder}{os.pathsep}{environment['PATH']}"}
    finally:
        server.kill()
        server.communicate()


def serve(address: str) -> None:
    """Fork for each call; returns in the process of a call only, which `main` is to run in."""
    import isorig

    # A command imports what it needs when it is called: here once for all.
    modules = [one.name for one in pkgutil.walk_packages(isorig.__path__, "isorig.") if not one.name.endswith("__main__")]
    for name in (*modules, *LIBRARIES):
        importlib.import_module(name)
    from isorig.rig.wire_bonder.description import wire_bonder
    from isorig.rig.wire_bonder.session import SESSION, virtual_campaign

    # Loads the compiled programs.
    virtual_campaign(wire_bonder(), SESSION[:1], seed=1)
    gc.freeze()
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(address)
    listening.listen()
    print("ready", flush=True)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        call, _ = listening.accept()
        if os.fork() == 0:
            break
        call.close()
    listening.close()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    content, streams, _, _ = socket.recv_fds(call, 1 << 20, 3)
    words, where, group, environment = json.loads(content)
    os.setpgid(0, group)
    child = os.fork()
    if child:
        _, status = os.waitpid(child, 0)
        call.send(str(os.waitstatus_to_exitcode(status) % 256).encode())
        os._exit(0)
    call.close()
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(where)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv[1:] = words


if __name__ == "__main__":
    from isorig.rig.cli import main

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    serve(sys.argv[1])
    if sys.argv[1:2] == ["-c"]:
        exec(sys.argv[2], {"__name__": "__main__"})
        sys.stdout.flush()
        # As a command: nothing is left but to dismantle all these modules.
        os._exit(0)
    sys.exit(main())
