"""Signals are told by a pipe, also where they come while the main thread holds a lock."""

import subprocess
import sys

MANY = """
import os, signal, threading
from service.adapters.processes.signal_pipe import SignalPipe

pipe = SignalPipe(signal.SIGTERM, signal.SIGCONT)
assert not pipe.wait(0.0)
lock = threading.Lock()
with lock:
    for _ in range(100_000):
        os.kill(os.getpid(), signal.SIGCONT)
    os.kill(os.getpid(), signal.SIGTERM)
seen = set()
while signal.SIGTERM not in seen and (came := pipe.wait(5.0)):
    seen |= came
print(sorted(signal.Signals(number).name for number in seen))
"""


def test_no_signal_is_lost_or_waits_for_a_lock() -> None:
    done = subprocess.run([sys.executable, "-c", MANY], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "['SIGCONT', 'SIGTERM']"
