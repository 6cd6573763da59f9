"""A counter of NI-DAQmx for the pulses of a tachometer or an encoder, read at each sample of the analog inputs."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from isorig.drivers.block import FloatArray


class Tachometer:
    """Counts rising edges on the clock of the inputs: its sample k belongs to their sample k.

    The pulses arrive at a terminal, that of the counter by default. The inputs have a rate in Hz, and `buffer` samples are kept
    for the host.
    """

    def __init__(self, package: Any, counter: str, terminal: str, *, rate: float, clock: str, buffer: int) -> None:
        self._package, self._task = package, package.Task()
        self._total = self._last = 0
        try:
            channel = self._task.ci_channels.add_ci_count_edges_chan(counter)
            if terminal:
                channel.ci_count_edges_term = terminal
            self._task.timing.cfg_samp_clk_timing(
                rate, source=clock, sample_mode=package.constants.AcquisitionType.CONTINUOUS, samps_per_chan=buffer
            )
            self._task.in_stream.overwrite = package.constants.OverwriteMode.OVERWRITE_UNREAD_SAMPLES
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Count from zero; before the inputs, whose first sample clocks the first count."""
        self._total = self._last = 0
        self._task.start()

    def stop(self) -> None:
        """Stop counting."""
        self._task.stop()

    def edges(self, first: int, count: int) -> FloatArray:
        """Edges since the start at the samples from `first` on, shape (count,)."""
        stream = self._task.in_stream
        # Not zero after samples that the host did not fetch.
        stream.offset = first - int(stream.curr_read_pos)
        counts = np.zeros(count, np.uint32)
        reader = self._package.stream_readers.CounterReader(stream)
        reader.read_many_sample_uint32(counts, number_of_samples_per_channel=count, timeout=1.0)
        # The counter has 32 bits: differences remain right when it returns to zero.
        steps = np.diff(counts, prepend=np.uint32(self._last))
        edges = self._total + np.cumsum(steps, dtype=np.int64)
        self._total, self._last = int(edges[-1]), int(counts[-1])
        return edges.astype(np.float64)

    def close(self) -> None:
        """Release the counter."""
        with suppress(Exception):
            self._task.close()
