"""Ten thousand broken logs, messages, definitions, tables, maps and logs of transforms: no foreign bytes end a read.

The decision to scan MCAP ourselves, and to go on behind damage, rests on this. Time and memory of each round follow
from how large the whole thing is.

Usage: python tests/benchmarks/fuzz.py [ROUNDS [SEED [KIND]]]. Prints for each kind (of those that begin with KIND) how
many rounds were refused or noticed, the slowest, and what the largest took; a failure with its round. A broken log
stays in the working folder.
"""

from __future__ import annotations

import logging
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))
import map_mutations as maps
import mutations
import payload_mutations as payloads

from peak_memory import with_growth

REALS = (Path(__file__).parents[2] / "../shared/data/mcap_osi").glob("disappearingVehicle.mcap")
RECOVER_EACH, TRANSFORMS_A_LOG, MAPS_A_ROUND = 5, 4, 4
SECONDS, BYTES_PER_S = 2.0, 1e5
MEMORY, GROWTH = 64 << 20, 100
"""A round may take so long and so many bytes, and longer and more by the size of what is broken: a tenth of a megabyte
a second, a hundredfold."""


class Kind(NamedTuple):
    """What is broken."""

    size: int  # bytes of the whole
    check: Callable[[np.random.Generator], int]


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


def kinds(folder: Path, rng: np.random.Generator) -> dict[str, Kind]:
    """What is broken, by name."""
    logs = mutations.subjects(rng) + [mutations.subject(path.stem, path.read_bytes()) for path in REALS]
    whole, n = payloads.subjects(folder), TRANSFORMS_A_LOG
    by_definition = [one for one in whole if one.name != "json"]
    return {
        **{f"log, {one.name}": Kind(len(one.data), partial(check_log, one, folder)) for one in logs},
        **{f"message, {one.name}": Kind(len(one.payload), partial(payloads.check_payload, one)) for one in whole},
        **{f"definition, {one.name}": Kind(len(one.channel.schema.data), partial(payloads.check_definition, one))
           for one in by_definition},
        "transforms": Kind(10_000, lambda rng: payloads.check_transforms(rng, folder / "tf.mcap", n)),
        **{f"table, {form}": Kind(len(payloads.TABLE), partial(payloads.check_table, form, folder / "table"))
           for form in payloads.TABLES},
        **{f"map, {kind}": Kind(MAPS_A_ROUND * len(whole), partial(check_maps, kind, folder / "map.mcap"))
           for kind, whole in maps.MAPS.items()},
    }  # fmt: skip


def main(rounds: int = 10_000, seed: int = 0, only: str = "") -> None:
    """Run all kinds, and end with 1 where one failed."""
    with tempfile.TemporaryDirectory() as folder:
        found = kinds(Path(folder), np.random.default_rng(seed))
        logging.disable()  # of frames with several parents, at every round
        failures = sum(run(name, rounds, seed, kind) for name, kind in found.items() if name.startswith(only))
    sys.exit(bool(failures))


def run(name: str, rounds: int, seed: int, kind: Kind) -> int:
    """So many rounds of a kind; how many failed."""
    refused = failures = most = 0
    slowest = 0.0
    for i in range(rounds):
        try:
            n, seconds, grown = within_budget(kind, [seed, i])
        except Exception as error:  # noqa: BLE001 - a fuzzer reports what it finds
            failures += 1
            print(f"round {i} of {name}: {type(error).__name__} {str(error)[:200]}", flush=True)
        else:
            refused, slowest, most = refused + n, max(slowest, seconds), max(most, grown)
    print(f"{name:36} {rounds:6} rounds, {refused:6} refused, {failures} failures, slowest {slowest:.3f} s, "
          f"most {most >> 20} MiB", flush=True)  # fmt: skip
    return failures


def within_budget(kind: Kind, seed: list[int]) -> tuple[int, float, int]:
    """A round: how many were refused, its seconds, and the bytes that it grew by.

    Raises:
        AssertionError: it takes more than its budget, and takes it again: at first it may import and compile.
    """
    for _ in range(2):
        begun = time.process_time()
        refused, grown = with_growth(partial(kind.check, np.random.default_rng(seed)))
        seconds = time.process_time() - begun
        if seconds <= SECONDS + kind.size / BYTES_PER_S and grown <= MEMORY + GROWTH * kind.size:
            return refused, seconds, grown
    raise AssertionError(f"{kind.size} bytes took {seconds:.1f} s and {grown >> 20} MiB")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]), *sys.argv[3:])
