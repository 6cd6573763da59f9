"""The bounds within which a counter, a clock and the host are said to agree: numbers from the manual of what they must do."""

from __future__ import annotations

import pytest

from isorig.drivers.block import Status
from isorig.drivers.errors import InstrumentError
from isorig.drivers.order import Order, Reading, wrapped


def second_block(rate: float, step: int, clock: float | None, *, host: float = 0.5, rows: int = 10) -> tuple[int, Status]:
    """Tick and status of a block whose counter stepped by `step` samples and whose clock by `clock` samples."""
    order = Order(who="It", began=0.0, rate=rate, first=0)
    micros = None if clock is None else 0
    order.place(Reading(counter=0, rows=rows, host=0.1, clock=micros))
    later = None if clock is None else round(clock / rate * 1e6)
    place = order.place(Reading(counter=step, rows=rows, host=host, clock=later))
    assert place is not None
    return place.tick, place.status


@pytest.mark.parametrize(
    ("rate", "step", "off"),
    [
        (100.0, 20, 2.0),  # two samples
        (10_000.0, 20, 50.0),  # 5 ms
        (100.0, 150, 3.0),  # 2 % of the step
    ],
)
def test_a_clock_agrees_with_the_counter_up_to_its_resolution(rate: float, step: int, off: float) -> None:
    assert second_block(rate, step, step + 0.98 * off) == (step, Status.GOOD)
    tick, status = second_block(rate, step, step + 1.06 * off)
    assert (tick, status) == (step, Status.DISAGREES)


@pytest.mark.parametrize("loose", [(2.0, 0.005), (0.6, 0.0)])
def test_a_latched_clock_is_compared_more_strictly(loose: tuple[float, float]) -> None:
    order = Order(who="It", began=0.0, rate=1000.0, first=0, loose=loose)
    order.place(Reading(counter=0, rows=10, host=0.1, clock=0))
    place = order.place(Reading(counter=20, rows=10, host=0.2, clock=21_000))
    assert place is not None
    assert place.status == (Status.GOOD if loose[0] > 1.0 else Status.DISAGREES)


def test_samples_may_be_a_second_late_and_arrive_twice_as_fast() -> None:
    """Half a second after the start, (0.5 + 1) s at twice the rate: 300 samples at 100 Hz."""
    assert second_block(100.0, 300, None) == (300, Status.GOOD)
    with pytest.raises(InstrumentError, match="counts 301 samples"):
        second_block(100.0, 301, None)


def test_what_was_received_shows_that_an_instrument_is_faster_than_real_time() -> None:
    order = Order(who="It", began=0.0, rate=100.0, first=0)
    assert order.possible(10**9, 0.1)  # before the first block nothing is known
    order.place(Reading(counter=0, rows=200, host=2.0))
    order.place(Reading(counter=200, rows=200, host=2.0))
    # Received by then: as fast as real time; so twice the rate over 2 s and the second that they may be late.
    assert order.possible(600, 2.0)
    assert not order.possible(601, 2.0)
    assert not order.possible(399, 2.0)
    order.place(Reading(counter=400, rows=200, host=2.0))
    # 400 samples in 2 s are twice as fast as real time, so twice that is possible.
    assert order.possible(1200, 2.0)
    assert not order.possible(1201, 2.0)


def test_a_frame_of_an_earlier_run_is_early_only_soon_after_the_start() -> None:
    def at(host: float, tick: int) -> bool:
        order = Order(who="It", began=0.0, rate=1000.0, first=0, real_time=True)
        order.place(Reading(counter=0, rows=10, host=0.02))
        return order.place(Reading(counter=tick, rows=10, host=host)) is not None

    # 2 % above the rate, and 5 ms of the host's clock: at 0.5 s no more than 515.1 samples.
    assert at(0.5, 505)
    assert not at(0.5, 506)
    # After a second no frame of an earlier run is on its way.
    assert not at(0.99, 1100)
    assert at(1.01, 1100)


def test_a_wrapped_counter_is_the_nearest() -> None:
    assert [wrapped(value, 250, 256) for value in (250, 255, 0, 121, 122)] == [250, 255, 256, 377, 122]
