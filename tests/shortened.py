"""The beginnings of recorded runs."""

from __future__ import annotations

from dataclasses import replace

from isorig.analysis.campaign import Campaign


def shortened(campaign: Campaign, seconds: float) -> Campaign:
    """The campaign with at most so many seconds of each run."""
    runs = [
        replace(
            run,
            channels={
                name: replace(channel, samples=channel.samples[: round(seconds * run.sample_rate)])
                for name, channel in run.channels.items()
            },
        )
        for run in campaign.runs
    ]
    return replace(campaign, runs=tuple(runs))
