"""Seconds on the clock and of the processors."""

import time

RUNS = 3


def measured(work):
    """Run something once to warm up, then `RUNS` times; give the least wall and processor seconds, and its answer.

    Processor time does not count what other programs do meanwhile; where two cores share the work it is up to twice
    the wall time of an idle machine.
    """
    answer = work()
    walls, processors = [], []
    for _ in range(RUNS):
        wall, processor = time.perf_counter(), time.process_time()
        work()
        walls.append(time.perf_counter() - wall)
        processors.append(time.process_time() - processor)
    return min(walls), min(processors), answer
