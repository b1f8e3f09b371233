"""Ten thousand broken logs, messages, definitions, tables, maps and logs of transforms: no foreign bytes end a read.

The decision to scan MCAP ourselves, and to go on behind damage, rests on this.

Usage: python tests/benchmarks/fuzz.py [ROUNDS [SEED [KIND]]]. Prints for each kind (of those that begin with KIND) how
many rounds were refused or noticed, the slowest, and the memory at its height; a failure with its round. A broken log
stays in the working folder.
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
import map_mutations as maps
import mutations
import payload_mutations as payloads

REAL = Path(__file__).parents[2] / "../shared/data/mcap_osi/disappearingVehicle.mcap"
RECOVER_EACH, TRANSFORMS_A_LOG, MAPS_A_ROUND = 5, 4, 4
Check = Callable[[np.random.Generator], int]


def check_log(whole: mutations.Subject, folder: Path, rng: np.random.Generator) -> int:
    """Break a log and read it, and recover one in five; whether its damage was noticed."""
    data, _ = mutations.mutated(whole.data, rng)
    try:
        noticed = mutations.check(whole, data, folder / "broken.mcap")
        if rng.integers(RECOVER_EACH) == 0:
            mutations.check_recovery(folder / "broken.mcap", folder / "fixed.mcap")
    except Exception:
        Path(f"fuzz_{whole.name}_{hash(data)}.mcap").write_bytes(data)
        raise
    return int(noticed)


def check_maps(kind: str, path: Path, rng: np.random.Generator) -> int:
    """How many of some harmed maps are refused."""
    return sum(maps.check_map(kind, path, rng) for _ in range(MAPS_A_ROUND))


def kinds(folder: Path, rng: np.random.Generator) -> dict[str, Check]:
    """What is broken, by name."""
    logs = mutations.subjects(rng) + [mutations.subject(REAL.stem, REAL.read_bytes())] * REAL.exists()
    whole = payloads.subjects(folder)
    return {
        **{f"log, {one.name}": partial(check_log, one, folder) for one in logs},
        **{f"message, {one.name}": partial(payloads.check_payload, one) for one in whole},
        **{f"definition, {one.name}": partial(payloads.check_definition, one) for one in whole if one.name != "json"},
        "transforms": lambda rng: payloads.check_transforms(rng, folder / "tf.mcap", TRANSFORMS_A_LOG),
        **{f"table, {form}": partial(payloads.check_table, form, folder / "table") for form in payloads.TABLES},
        **{f"map, {kind}": partial(check_maps, kind, folder / "map.mcap") for kind in maps.MAPS},
    }


def main(rounds: int = 10_000, seed: int = 0, only: str = "") -> None:
    """Run all kinds, and end with 1 where one failed."""
    with tempfile.TemporaryDirectory() as folder:
        checks = kinds(Path(folder), np.random.default_rng(seed))
        logging.disable()  # of frames with several parents, at every round
        failures = sum(run(name, rounds, seed, check) for name, check in checks.items() if name.startswith(only))
    print(f"memory at its height: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    sys.exit(bool(failures))


def run(name: str, rounds: int, seed: int, check: Check) -> int:
    """So many rounds of a kind; how many failed."""
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
