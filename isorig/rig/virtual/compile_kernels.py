"""Compiles and caches the kernels, so that the first command does not wait: `python -m isorig.rig.virtual.compile_kernels`."""

from __future__ import annotations

from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign


def main() -> None:
    """Simulate one second of the built-in rig."""
    from isorig.rig.wire_bonder.description import wire_bonder

    virtual_campaign(wire_bonder(), [VirtualRun(id="warm", configuration="unlocked", gain=70.0, seconds=1.0, start=0.0)])


if __name__ == "__main__":
    main()
