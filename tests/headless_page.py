"""A page opened in headless Chromium, and what a script in it tells."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--virtual-time-budget=20000", "--enable-logging=stderr", "--dump-dom",
)  # fmt: skip
#: A browser's window has a least width; a frame has none.
FRAME = """<!doctype html><link rel="icon" href="data:,"><iframe src="report.html" style="width:{width}px;height:2000px;border:0">
</iframe><pre></pre><script>onmessage = (event) => {{ document.querySelector("pre").textContent = event.data; }};</script>"""

#: Whether each chart is drawn, and how wide the page's content and its frame are.
EXTENT = """<script>addEventListener("load", () => setTimeout(() => parent.postMessage(JSON.stringify({
  drawn: [...document.querySelectorAll(".chart")].map((c) => c.querySelectorAll(".main-svg path").length > 0),
  wide: document.documentElement.scrollWidth, inner: innerWidth }), "*"), 1500));</script>"""


def told_by(page: str, probe: str, width: int, folder: Path) -> dict[str, Any]:
    """What a script put after a page's own posts to the page around it, in a frame of a width; nothing may be in the console."""
    (folder / "report.html").write_text(page.replace("</body>", probe + "</body>"), encoding="utf-8")
    (folder / "frame.html").write_text(FRAME.format(width=width), encoding="utf-8")
    done = subprocess.run(
        [str(CHROMIUM), *FLAGS, f"--user-data-dir={folder / 'profile'}", (folder / "frame.html").as_uri()],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
    told: dict[str, Any] = json.loads(html.unescape(re.findall(r"<pre>(.*?)</pre>", done.stdout)[0]))
    return told
