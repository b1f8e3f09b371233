"""Ten thousand broken messages, definitions and logs of transforms: that no stranger's bytes end a read rests on this.

Usage: python tests/benchmarks/fuzz_payloads.py [ROUNDS] [SEED]. Prints for each kind how many were refused, the slowest
round, and the memory at its height; a failure with its round.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))
from payload_mutations import check_definition, check_payload, check_transforms, subjects

TRANSFORMS_A_LOG = 200


def main(rounds: int = 10_000, seed: int = 0) -> None:
    with tempfile.TemporaryDirectory() as folder:
        whole = subjects(Path(folder))
        path = Path(folder) / "tf.mcap"
        failures = 0
        for subject in whole:
            failures += run(f"message, {subject.name}", rounds, seed, lambda rng, one=subject: check_payload(one, rng))
        for subject in whole:
            if subject.name != "json":
                failures += run(
                    f"definition, {subject.name}", rounds, seed, lambda rng, one=subject: check_definition(one, rng)
                )
        failures += run(
            f"transforms, {TRANSFORMS_A_LOG} a round", -(-rounds // TRANSFORMS_A_LOG), seed,
            lambda rng: check_transforms(rng, path, TRANSFORMS_A_LOG),
        )  # fmt: skip
    print(f"memory at its height: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    sys.exit(bool(failures))


def run(name: str, rounds: int, seed: int, check: Callable[[np.random.Generator], int]) -> int:
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
    main(*map(int, sys.argv[1:]))
