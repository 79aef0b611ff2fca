"""The line protocol of a peer's driver: a greeting, then one round for each line of standard input.

A driver prints JSON lines. The first names the software and its version once everything is warm. Each later one is a
round: seconds, units of work done, and for some work a number that both sides should agree on. Work on one thread is
timed by the process's own CPU time, so that other load on the machine does not distort it; work on several threads by
the wall clock. jostle's own side does the same.
"""

import json
import sys
import time

# A round lasts at least this long.
ROUND_SECONDS = 0.4


def clock(threads):
    return time.process_time if threads == 1 else time.perf_counter


def serve(name, version, threads, work):
    """`work()` does a piece of the work and returns how many units it did; it has been called once to warm up."""
    now = clock(threads)
    print(json.dumps({"name": name, "version": version}), flush=True)
    for _ in sys.stdin:
        start, units = now(), 0
        while True:
            units += work()
            seconds = now() - start
            if seconds >= ROUND_SECONDS:
                break
        print(json.dumps({"seconds": seconds, "units": float(units)}), flush=True)
