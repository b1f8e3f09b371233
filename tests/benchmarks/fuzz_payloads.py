"""Ten thousand broken messages, definitions, tables and logs of transforms: no foreign bytes end a read.

Usage: python tests/benchmarks/fuzz_payloads.py [ROUNDS [SEED [KIND]]]. Prints for each kind (of those that begin with
KIND) how many were refused, the slowest round, and the memory at its height; a failure with its round.
"""

from __future__ import annotations

import logging
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))
from payload_mutations import TABLES, check_definition, check_payload, check_table, check_transforms, subjects

TRANSFORMS_A_LOG = 4
Check = Callable[[np.random.Generator], int]


def main(rounds: int = 10_000, seed: int = 0, only: str = "") -> None:
    """Run all kinds, and end with 1 where one failed."""
    with tempfile.TemporaryDirectory() as folder:
        whole, path = subjects(Path(folder)), Path(folder) / "tf.mcap"
        kinds: dict[str, Check] = {f"message, {one.name}": partial(check_payload, one) for one in whole}
        kinds |= {f"definition, {one.name}": partial(check_definition, one) for one in whole if one.name != "json"}
        kinds["transforms"] = lambda rng: check_transforms(rng, path, TRANSFORMS_A_LOG)
        kinds |= {f"table, {form}": partial(check_table, form, Path(folder) / "table") for form in TABLES}
        logging.disable()  # of frames with several parents, at every round
        failures = sum(run(name, rounds, seed, check) for name, check in kinds.items() if name.startswith(only))
    print(f"memory at its height: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    sys.exit(bool(failures))


def run(name: str, rounds: int, seed: int, check: Check) -> int:
    refused = failures = 0
    slowest = 0.0
    for i in range(rounds):
        begun = time.process_time()
        try:
            refused += check(np.random.default_rng([seed, i]))
        except Exception as error:  # noqa: BLE001 - a fuzzer reports what it finds
            failures += 1
            print(f"round {i} of {name}: {type(error).__name__} {str(error)[:200]}")
        slowest = max(slowest, time.process_time() - begun if i else 0.0)
    print(f"{name:36} {rounds:6} rounds, {refused:6} refused, {failures} failures, slowest {slowest:.3f} s")
    return failures


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]), *sys.argv[3:])
