"""How often this machine takes its cores from programs that only read the clock, one on each core: for a
millisecond and more. If that is 1 % of the time, no server on that core has a p99 below it.

  python3 tests/bench/stalls.py [SECONDS (8)]
"""

import multiprocessing
import os
import sys
import time

STALL = 1e-3  # seconds


def stalls_of(core, seconds):
    """How long each took, in seconds."""
    os.sched_setaffinity(0, {core})
    stalls = []
    before = time.monotonic()
    end = before + seconds
    while before < end:
        now = time.monotonic()
        if now - before > STALL:
            stalls.append(now - before)
        before = now
    return stalls


def main():
    if len(sys.argv) > 2 or "--help" in sys.argv or "-h" in sys.argv:
        sys.exit(__doc__)
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0
    cores = sorted(os.sched_getaffinity(0))
    with multiprocessing.Pool(len(cores)) as pool:
        found = pool.starmap(stalls_of, [(core, seconds) for core in cores], chunksize=1)
    for core, stalls in zip(cores, found):
        print(
            f"core {core}: taken {len(stalls)} times in {seconds:g} s, "
            f"{100 * sum(stalls) / seconds:.2f} % of the time, {1e3 * max(stalls, default=0):.1f} ms at most"
        )


if __name__ == "__main__":
    main()
