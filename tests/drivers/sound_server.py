"""A PulseAudio daemon of this user with a sink that plays into its own monitor: a real audio stack, digital from end to end."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

#: The rate of the loop, Hz, and seconds within which the daemon must answer.
RATE, READY = 48000, 10.0
CONFIGURATION = """
</usr/share/alsa/alsa.conf>
pcm.loop {
  type asym
  playback.pcm { type pulse device "loop" }
  capture.pcm { type pulse device "loop.monitor" }
  hint { show on description "loop" }
}
ctl.!default { type pulse }
"""


class Server:
    """The daemon; it can be ended as when an interface is unplugged."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process

    def end(self) -> None:
        """End it."""
        self.process.kill()
        self.process.wait()


def _started(folder: Path, settings: dict[str, str]) -> subprocess.Popen[bytes]:
    call = [
        "pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no", "--log-target=null",
        "-L", f"module-native-protocol-unix socket={folder}/s auth-anonymous=1",
        "-L", f"module-null-sink sink_name=loop format=s32le rate={RATE} channels=2",
    ]  # fmt: skip
    return subprocess.Popen(call, env={**os.environ, **settings}, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)


@contextmanager
def loop() -> Iterator[Server]:
    """The daemon, and PortAudio connected to it; skips with the reason where none can start."""
    if shutil.which("pulseaudio") is None or shutil.which("pactl") is None:
        pytest.skip("there is no PulseAudio here (on Debian: pulseaudio, pulseaudio-utils, libasound2-plugins)")
    sounddevice = pytest.importorskip("sounddevice", reason="there is no PortAudio here", exc_type=OSError)
    with tempfile.TemporaryDirectory(prefix="sound-") as name, pytest.MonkeyPatch.context() as patch:
        folder = Path(name)
        (folder / "asound.conf").write_text(CONFIGURATION)
        settings = {"HOME": name, "XDG_RUNTIME_DIR": name, "PULSE_SERVER": f"unix:{folder}/s"}
        settings["ALSA_CONFIG_PATH"] = str(folder / "asound.conf")
        process = _started(folder, settings)
        try:
            end = time.monotonic() + READY
            while subprocess.run(["pactl", "info"], env={**os.environ, **settings}, capture_output=True, check=False).returncode:
                if process.poll() is not None or time.monotonic() > end:
                    pytest.skip("the PulseAudio daemon does not start here")
                time.sleep(0.05)
            for key, value in settings.items():
                patch.setenv(key, value)
            sounddevice._terminate()
            sounddevice._initialize()
            if not any(one["name"] == "loop" for one in sounddevice.query_devices()):
                pytest.skip("PortAudio does not list the loop; on Debian install libasound2-plugins")
            yield Server(process)
        finally:
            sounddevice._terminate()
            process.terminate()
            process.wait()
    sounddevice._initialize()
