"""The bounds within which a counter, a clock and the host are said to agree: numbers from the manual of what they must do."""

from __future__ import annotations

from itertools import accumulate

import pytest

from isorig.drivers.block import Status
from isorig.drivers.errors import InstrumentError
from isorig.drivers.order import EXACT, BlockHeader, Order, wrapped


def second_block(rate: float, step: int, clock: float | None, *, host: float = 0.5, rows: int = 10) -> tuple[int, Status]:
    """Tick and status of a block whose counter stepped by `step` samples and whose clock by `clock` samples."""
    order = Order(who="It", began=0.0, rate=rate, first=0)
    micros = None if clock is None else 0
    order.place(BlockHeader(counter=0, rows=rows, host=0.1, clock=micros))
    later = None if clock is None else round(clock / rate * 1e6)
    place = order.place(BlockHeader(counter=step, rows=rows, host=host, clock=later))
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


@pytest.mark.parametrize(
    ("rate", "off", "status"), [(100.0, 0.5, Status.GOOD), (100.0, 0.7, Status.DISAGREES), (1e4, 0.7, Status.DISAGREES)]
)
def test_a_latched_clock_agrees_within_six_tenths_of_a_sample(rate: float, off: float, status: Status) -> None:
    order = Order(who="It", began=0.0, rate=rate, first=0, loose=EXACT)
    order.place(BlockHeader(counter=0, rows=10, host=0.1, clock=0))
    place = order.place(BlockHeader(counter=20, rows=10, host=0.2, clock=round((20 + off) / rate * 1e6)))
    assert place is not None
    assert place.status == status


def test_samples_may_be_a_second_late_and_arrive_twice_as_fast() -> None:
    """Half a second after the start, (0.5 + 1) s at twice the rate: 300 samples at 100 Hz."""
    assert second_block(100.0, 300, None) == (300, Status.GOOD)
    with pytest.raises(InstrumentError, match="counts 301 samples"):
        second_block(100.0, 301, None)


def test_what_was_received_shows_that_an_instrument_is_faster_than_real_time() -> None:
    order = Order(who="It", began=0.0, rate=100.0, first=0)
    assert order.possible(10**9, 0.1)  # before the first block nothing is known
    order.place(BlockHeader(counter=0, rows=200, host=2.0))
    order.place(BlockHeader(counter=200, rows=200, host=2.0))
    # Received by then: as fast as real time; so twice the rate over 2 s and the second that they may be late.
    assert order.possible(600, 2.0)
    assert not order.possible(601, 2.0)
    assert not order.possible(399, 2.0)
    order.place(BlockHeader(counter=400, rows=200, host=2.0))
    # 400 samples in 2 s are twice as fast as real time, so twice that is possible.
    assert order.possible(1200, 2.0)
    assert not order.possible(1201, 2.0)


def test_a_frame_of_an_earlier_run_is_early_only_soon_after_the_start() -> None:
    def at(host: float, tick: int) -> bool:
        order = Order(who="It", began=7000.0, rate=1000.0, first=65_000, counter_wrap=1 << 16, real_time=True)
        order.place(BlockHeader(counter=65_000, rows=10, host=7000.02))
        return order.place(BlockHeader(counter=(65_000 + tick) % (1 << 16), rows=10, host=7000.0 + host)) is not None

    # 2 % above the rate, and 5 ms of the host's clock: at 0.5 s no more than 515.1 samples.
    assert at(0.5, 505)
    assert not at(0.5, 506)
    # After a second no frame of an earlier run is on its way.
    assert not at(0.99, 1100)
    assert at(1.01, 1100)


def test_a_wrapped_counter_is_the_nearest() -> None:
    assert [wrapped(value, 250, 256) for value in (250, 255, 0, 121, 122)] == [250, 255, 256, 377, 122]


class Instrument:
    """What an instrument sends: all its indicators wrap soon, and its clock runs one per cent fast."""

    RATE, HOST, FIRST, WRAP = 1000.0, 5000.0, 65_000, 1 << 16
    CLOCK, NUMBER, FULL = (1 << 32) - 300_000, (1 << 32) - 7, 1 << 32

    def __init__(self, *, clock: bool = True, sequence: bool = True, rows: int = 50) -> None:
        self.has_clock, self.has_sequence, self.rows = clock, sequence, rows

    def order(self, **more: object) -> Order:
        """What places its blocks."""
        settings: dict[str, object] = {"first": self.FIRST, "rate": self.RATE, "began": self.HOST, "counter_wrap": self.WRAP}
        return Order(who="It", **{**settings, **more})  # type: ignore[arg-type]

    def frame(self, k: int, *, counter: int = 0, clock: int = 0, sequence: int = 0, late: float = 0.02) -> BlockHeader:
        """Frame number k, with errors of its indicators."""
        tick = k * self.rows
        return BlockHeader(
            counter=(self.FIRST + tick + counter) % self.WRAP,
            rows=self.rows,
            host=self.HOST + (tick + self.rows) / self.RATE + late,
            clock=(self.CLOCK + round(1.01e6 * tick / self.RATE) + clock) % self.FULL if self.has_clock else None,
            sequence=(self.NUMBER + k + sequence) % self.FULL if self.has_sequence else None,
            mark=k,
        )


EVERY = [Instrument(clock=clock, sequence=sequence) for clock in (False, True) for sequence in (False, True)]


@pytest.mark.parametrize("sender", EVERY)
def test_frames_are_placed_where_they_were_taken_however_indicators_wrap(sender: Instrument) -> None:
    order = sender.order()
    lost = {5, 6, 40, 90}
    for k in range(100):
        if k in lost:
            continue
        place = order.place(sender.frame(k))
        assert place is not None
        assert (place.tick, place.status, order.end) == (k * 50, Status.GOOD, k * 50 + 50)
        if sender.has_clock:
            # Of the instrument's clock, without its wraps.
            assert place.seconds == pytest.approx((sender.CLOCK + 1.01e3 * place.tick) * 1e-6, abs=1e-6)
        else:
            assert place.seconds is None
        assert order.place(sender.frame(k)) is None  # a duplicate
    assert order.place(sender.frame(89)) is None
    assert order.place(sender.frame(90)) is None
    assert order.place(sender.frame(40)) is None  # so late that its ticks count as lost
    assert order.place(sender.frame(6)) is None
    assert order.noticed == []


@pytest.mark.parametrize("k", [3, 30])
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"counter": 700}, "its counter 750, its clock 50, its frame numbers 50 samples on; 50 was used"),
        ({"counter": -30}, "its counter 20, its clock 50, its frame numbers 50 samples on; 50 was used"),
        ({"clock": 700_000}, "its counter 50, its clock 7"),
        ({"sequence": -2}, "its counter 50, its clock 50, its frame number went by -1 samples on; 50 was used"),
    ],
)
def test_two_indicators_outvote_the_third(wrong: dict[str, int], said: str, k: int) -> None:
    """At the start, and after the clock's own rate was learned; afterwards the wrong one is trusted again."""
    sender = Instrument()
    order = sender.order()
    for n in range(k + 5):
        place = order.place(sender.frame(n, **(wrong if n >= k else {})))
        assert place is not None
        assert (place.tick, place.status) == (50 * n, Status.DISAGREES if n == k else Status.GOOD)
    (notice,) = order.noticed
    assert notice.startswith(f"at tick {50 * k} {said}")


@pytest.mark.parametrize(("counter", "clock", "status"), [(700, 0, Status.DISAGREES), (0, 700_000, Status.DISAGREES)])
def test_without_numbers_a_possible_step_of_the_counter_is_used(counter: int, clock: int, status: Status) -> None:
    sender = Instrument(sequence=False)
    order = sender.order()
    for n in range(30):
        order.place(sender.frame(n))
    place = order.place(sender.frame(30, counter=counter, clock=clock))
    assert place is not None
    assert (place.tick, place.status) == (1500 + counter, status)


def test_a_counter_that_restarts_is_replaced_by_the_clock_or_the_numbers() -> None:
    for sender, back in ((Instrument(sequence=False), -1500), (Instrument(clock=True), -1500)):
        order = sender.order()
        for n in range(30):
            order.place(sender.frame(n))
        # One frame was lost, too.
        place = order.place(sender.frame(31, counter=back))
        assert place is not None
        assert place.tick == pytest.approx(1550, abs=0)
        assert place.status == Status.DISAGREES
        place = order.place(sender.frame(32, counter=back))
        assert place is not None
        assert (place.tick, place.status) == (1600, Status.GOOD)


def test_a_counter_that_restarts_ends_the_run_where_nothing_else_shows_the_loss() -> None:
    sender = Instrument(clock=False, sequence=False)
    order = sender.order()
    for n in range(30):
        order.place(sender.frame(n))
    with pytest.raises(InstrumentError, match="counts -1450 samples at tick 1500, where 50 or more are expected"):
        order.place(sender.frame(30, counter=-1500))


@pytest.mark.parametrize(("counter", "refused"), [(0, False), (2100, False), (2200, True), (-1, True)])
def test_the_first_block_is_where_its_counter_was_announced_or_later(counter: int, refused: bool) -> None:
    """At 0.07 s, twice 1.07 s of samples may have been taken."""
    sender = Instrument()
    if refused:
        with pytest.raises(InstrumentError, match="announced 65000; switch it off and on"):
            sender.order().place(sender.frame(0, counter=counter))
        return
    place = sender.order().place(sender.frame(0, counter=counter))
    assert place is not None
    assert (place.tick, place.status) == (counter, Status.GOOD)


@pytest.mark.parametrize(("sizes", "tick"), [((50, 50, 50), 200), ((50, 30, 50), 900)])
def test_numbers_count_samples_only_where_all_frames_have_the_same_size(sizes: tuple[int, ...], tick: int) -> None:
    """A frame is lost and the counter is wrong: numbers and clock agree on 100 samples, but not if frames differ in size."""
    order = Order(who="It", began=0.0, rate=1000.0, first=0)
    ends = [0, *accumulate(sizes)]
    for k, rows in enumerate(sizes):
        order.place(BlockHeader(counter=ends[k], rows=rows, host=0.2, sequence=k, clock=1000 * ends[k]))
    last = len(sizes) - 1
    wrong = BlockHeader(counter=900, rows=50, host=0.4, sequence=last + 2, clock=1000 * (ends[last] + 100))
    place = order.place(wrong)
    assert place is not None
    assert (place.tick, place.status) == (tick, Status.DISAGREES)


def test_a_wrong_number_in_a_gap_costs_no_sample() -> None:
    """The clock is a hundredth fast, and its rate not learned yet: the counter is exact."""
    sender = Instrument()
    order = sender.order()
    for n in range(3):
        order.place(sender.frame(n))
    place = order.place(sender.frame(7, sequence=-7))
    assert place is not None
    assert (place.tick, place.status) == (350, Status.DISAGREES)


@pytest.mark.parametrize("gap", [5, 6, 20])
def test_a_counter_of_eight_bits_may_wrap_in_a_gap(gap: int) -> None:
    order = Order(who="It", began=0.0, rate=1000.0, first=17, counter_wrap=256)
    taken = [0, 1, 2, 2 + gap, 3 + gap]
    for k in taken:
        place = order.place(BlockHeader(counter=(17 + 50 * k) % 256, rows=50, host=0.05 * k + 0.1, clock=50_000 * k))
        assert place is not None
        assert (place.tick, place.status) == (50 * k, Status.GOOD)


@pytest.mark.parametrize(("frames", "status"), [(9, Status.DISAGREES), (13, Status.GOOD)])
def test_the_rate_of_a_clock_is_learned_in_half_a_second(frames: int, status: Status) -> None:
    """A clock 3 % fast shows 616 samples where 600 were taken: 2 % are allowed, unless its own rate is known."""
    order = Order(who="It", began=0.0, rate=1000.0, first=0)
    for k in [*range(frames), frames + 11]:
        place = order.place(BlockHeader(counter=50 * k, rows=50, host=0.05 * k + 0.1, clock=51_500 * k))
        assert place is not None
        assert place.tick == 50 * k
    assert place is not None
    assert place.status == status


def test_without_a_rate_everything_is_possible_and_the_first_counter_is_tick_0() -> None:
    order = Order(who="It", began=0.0)
    place = order.place(BlockHeader(counter=77, rows=10, host=0.1))
    assert place is not None
    assert place.tick == 0
    place = order.place(BlockHeader(counter=10**6, rows=10, host=0.1))
    assert place is not None
    assert place.tick == 10**6 - 77


def test_a_clock_that_stands_still_is_none() -> None:
    order = Order(who="It", began=0.0, rate=1000.0, first=0)
    for k in range(4):
        place = order.place(BlockHeader(counter=50 * k, rows=50, host=0.1 * k, clock=12_345))
        assert place is not None
        assert place.status == Status.GOOD


def test_without_a_rate_a_clock_agrees_by_samples_alone() -> None:
    order = Order(who="It", began=0.0, rate=None, first=0)
    order._loose = (2.0, 5.0)
    assert order._near(10.0, 12.0)
    assert not order._near(10.0, 13.0)


def test_one_sample_in_two_seconds_of_agreement_is_a_rate() -> None:
    order = Order(who="It", began=0.0, rate=None, first=0)
    order._agreed = (1.0, 2e6)
    assert order._own_rate() == 0.5
