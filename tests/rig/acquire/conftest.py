"""What all tests of sessions share."""

from __future__ import annotations

import pytest

from isorig.rig.acquire import block_stream as incoming


@pytest.fixture(autouse=True)
def soon_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wire that is gone stays gone here: it is waited for as long as it takes to see that."""
    monkeypatch.setattr(incoming, "AWAY", 0.8)
