"""Jobs of several threads: their results in order, and jobs that have jobs of their own."""

from __future__ import annotations

from isorig.analysis.parallel import cores, side_by_side


def test_results_are_in_the_order_of_the_jobs() -> None:
    assert side_by_side(lambda job: job * job, range(100)) == [job * job for job in range(100)]


def test_jobs_may_have_jobs_of_their_own() -> None:
    # More than there are threads, so that all of them would wait.
    jobs = range(4 * cores())
    found = side_by_side(lambda outer: sum(side_by_side(lambda inner: outer + inner, jobs)), jobs)
    assert found == [sum(outer + inner for inner in jobs) for outer in jobs]
