"""Ten thousand broken logs: the decision to scan MCAP ourselves, and to go on behind damage, rests on this.

Usage: python tests/benchmarks/fuzz.py [ROUNDS] [SEED]. Prints rounds, how many were noticed, the slowest, and the
memory at its height. A failure leaves the broken log in the working folder and says how to make it again.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))
from mutations import check, check_recovery, mutated, subject, subjects

REAL = Path(__file__).parents[2] / "../shared/data/mcap_osi/disappearingVehicle.mcap"
RECOVER_EACH = 5


def main(rounds: int = 10_000, seed: int = 0) -> None:
    rng = np.random.default_rng(seed)
    logs = subjects(rng)
    if REAL.exists():
        logs.append(subject(REAL.stem, REAL.read_bytes()))
    noticed, slowest, failures = Counter(), Counter(), Counter()
    with tempfile.TemporaryDirectory() as folder:
        path, fixed = Path(folder) / "broken.mcap", Path(folder) / "fixed.mcap"
        for i in range(rounds):
            whole = logs[i % len(logs)]
            data, done = mutated(whole.data, np.random.default_rng([seed, i]))
            begun = time.perf_counter()
            try:
                noticed[whole.name] += check(whole, data, path)
                slowest[whole.name] = max(slowest[whole.name], time.perf_counter() - begun)
                if i % RECOVER_EACH == 0:
                    check_recovery(path, fixed)
            except Exception as error:  # noqa: BLE001 - a fuzzer reports what it finds
                failures[f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"] += 1
                Path(f"fuzz_{seed}_{i}.mcap").write_bytes(data)
                print(f"round {i}, {whole.name}, {done}: {type(error).__name__} {str(error)[:200]}")
    n = {whole.name: len(range(k, rounds, len(logs))) for k, whole in enumerate(logs)}
    for name, n_rounds in n.items():
        print(f"{name:24} {n_rounds:6} rounds, damage reported in {noticed[name]:6}, slowest {slowest[name]:.2f} s")
    print(f"memory at its height: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    print(f"failures: {sum(failures.values())} {dict(failures)}")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
