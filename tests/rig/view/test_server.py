"""Who may look at the screen and what a page may say, over real sockets; what a page that stands still is sent."""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from urllib.parse import urlsplit

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pages import Socket, request, served, until

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.rig.view.messages import PageRequest, SessionState
from isorig.rig.view.sources import Reading, beginning_of

NOW = SessionState(phase="measures", run="u70", may=("stop", "again", "note"))


def growing(seconds: float, rate: float = 1024.0) -> Iterator[Reading]:
    """A run that grows by a tenth of a second every tenth of a second."""
    values = np.random.default_rng(0).standard_normal(int(seconds * rate))
    channels = {name: Channel(name=name, samples=values * (k + 1)) for k, name in enumerate(("head", "motor"))}
    run = Run(id="u70", configuration="unlocked", sample_rate=rate, gain=70.0, channels=channels, excitation="random")
    campaign = Campaign(runs=(run,))
    for n in range(int(0.1 * rate), len(values), int(0.1 * rate)):
        yield Reading(campaign=replace(campaign, runs=(beginning_of(run, n),)), whole=frozenset())
        time.sleep(0.1)


def test_only_the_page_itself_is_served() -> None:
    with served() as screen:
        parts = urlsplit(screen.address)
        status, text, headers = request(screen.address)
        assert (status, "page.js" in text) == (200, True)
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert headers["Cache-Control"] == "no-store"
        assert [request(screen.address, name)[0] for name in ("page.js", "page.css", "uplot.js", "uplot.css")] == [200] * 4
        assert request(screen.address, "/")[0] == request(screen.address, f"/{'x' * 32}/")[0] == 403
        assert request(screen.address, f"/{'x' * 32}/page.js")[0] == 403
        for name in ("server.py", "..", "../desk.py", "vendor/uPlot-LICENSE", "%2e%2e/desk.py"):
            assert request(screen.address, name)[0] in (403, 404)
        for host in ("evil.example", f"evil.example:{parts.port}", "127.0.0.1", f"127.0.0.1.evil.example:{parts.port}", ""):
            assert request(screen.address, Host=host)[0] in (400, 403)
        assert request(screen.address, Host=f"localhost:{parts.port}")[0] == 200
        assert request(screen.address, Origin="http://evil.example")[0] == 403
        assert len(screen.screen.token) >= 32
        if sys.platform == "linux":
            # All of 127/8 is this machine; what listens on every address would answer here.
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(("127.0.0.2", int(parts.port or 0)), timeout=5.0)


def test_a_socket_needs_host_origin_and_token() -> None:
    with served() as screen:
        parts = urlsplit(screen.address)
        refused = [
            {"origin": "http://evil.example"}, {"origin": "null"}, {"origin": ""}, {"origin": f"https://{parts.netloc}"},
            {"origin": f"http://localhost:{parts.port}"}, {"host": f"evil.example:{parts.port}"},
            {"host": "evil.example", "origin": "http://evil.example"}, {"path": "/live"}, {"path": f"/{'x' * 32}/live"},
        ]  # fmt: skip
        for told in refused:
            assert Socket(screen.address, **told).status in (403, 404), told
        own = f"localhost:{parts.port}"
        assert Socket(screen.address, host=own, origin=f"http://{own}").status == 101


def test_what_a_page_should_not_say_ends_it() -> None:
    with served() as screen:

        @settings(max_examples=40, deadline=None)
        @given(st.one_of(st.binary(max_size=300), st.text(max_size=200).map(str.encode)))
        def say(said: bytes) -> None:
            page = Socket(screen.address)
            page.send(said, kind=2)
            assert page.ended() == 1008
            page.close()

        say()
        assert screen.asked == []


def test_only_what_has_the_form_of_a_wish_is_handed_on() -> None:
    with served(standing=NOW) as screen:
        page = Socket(screen.address)
        page.say({"say": "asked", "do": "stop", "run": "u70"})
        page.say({"say": "asked", "do": "note", "run": "u70", "text": "<b>loud</b>"})
        until(lambda: len(screen.asked) == 2)
        assert screen.asked[1] == PageRequest(do="note", run="u70", text="<b>loud</b>")
        for wrong in (
            {"say": "asked", "do": "drive", "run": "u70"}, {"say": "asked", "do": "stop"},
            {"say": "asked", "do": "stop", "run": 3}, ["stop", "u70"],
            {"say": "asked", "do": "stop", "run": "u70", "gain": 500}, {"say": "begin"}, {"do": "stop", "run": "u70"},
            {"say": "asked", "do": "note", "run": "", "text": "x" * 5000},
        ):  # fmt: skip
            page = Socket(screen.address)
            page.say(wrong)
            assert page.ended() in (1008, 1009)
        assert len(screen.asked) == 2


def test_a_page_that_is_slow_gets_the_newest_frame_and_nothing_waits_for_it() -> None:
    with served(growing(8.0), standing=NOW) as screen:
        screen.screen.stalled = 2.0
        quick, slow, still = (Socket(screen.address) for _ in range(3))
        still.frame(answer=False)
        first, _ = slow.frame(answer=False)
        seen = [quick.frame() for _ in range(8)]
        # One frame and no more is on its way to a page that has not drawn it.
        assert slow.silent(0.3)
        slow.say({"say": "drawn", "frame": first["frame"], "values": 0})
        newest, plots = slow.frame(answer=False)
        assert newest["frame"] == first["frame"] + 1
        latest = max(plot["time"][0].max() for _, plot in seen if "time" in plot)
        assert plots["time"][0].max() >= latest - 0.2
        # A page that stands still is let go, the others go on.
        tally = screen.screen.tally
        while tally.dropped < 2:
            assert quick.frame()[0]["state"]["phase"] == "measures"
        assert (slow.ended(), still.ended()) == (1013, 1013)
        assert tally.frames >= 9
        assert tally.values >= sum(rows.size for _, plots in seen for rows in plots.values())


def test_a_page_cannot_say_that_it_has_drawn_what_it_was_not_sent() -> None:
    with served(standing=NOW) as screen:
        page = Socket(screen.address)
        head, _ = page.frame(answer=False)
        for number in (head["frame"] + 1, 0, -5, head["frame"] + 1000):
            page.say({"say": "drawn", "frame": number, "values": 10})
        assert page.silent(0.6)
        page.say({"say": "drawn", "frame": head["frame"], "values": 10})
        page.say({"say": "drawn", "frame": head["frame"], "values": 10})
        page.frame(answer=False)
        assert screen.screen.tally.values == 10


def test_too_many_pages_are_refused() -> None:
    with served(standing=NOW) as screen:
        screen.screen.most_pages = 2
        pages = [Socket(screen.address) for _ in range(3)]
        assert pages[2].read()[0] == 8
        pages[0].close()
        until(lambda: len(screen.screen.pages) == 1)
        assert Socket(screen.address).frame()[0]["frame"] == 1
