"""Ground that others laid out: real sensors, roads and benchmarks, and the simulated town beside them.

    python tests/benchmarks/neutral.py NAME|all --json [--data FOLDER] [--seeds 5] [--maps FOLDER]

What the folder holds is judged: sequences, users, days and drives that are laid out as in `../shared/data`. Nothing of
the product was tuned to it; rivals are fitted on training data, on grids that widen until the best lies inside.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

from grounds.findings import Asked, Findings
from grounds.gps import SOURCES, of_gps
from grounds.kitti import of_kitti
from grounds.mcity_blind import of_mcity_blind
from grounds.mot import KINDS, of_mot
from grounds.town import of_town

DATA = Path(__file__).parents[2] / "../shared/data"
GROUNDS: dict[str, tuple[str, Callable[[Asked], list[Findings]]]] = {
    "kitti": ("kitti_tracking", of_kitti),
    **{name: (KINDS[name][0], partial(of_mot, name)) for name in KINDS},
    "mcity_blind": ("mcity_roadside", of_mcity_blind),
    **{name: (source.folder, partial(of_gps, name)) for name, source in SOURCES.items()},
    "town": ("town03", of_town),
}
"""Each ground's folder, and what judges it."""


def findings(name: str, asked: Asked) -> list[Findings]:
    """The tables of a ground; none where its data are absent."""
    folder, judge = GROUNDS[name]
    if not (asked.data / folder).is_dir():
        sys.stderr.write(f"{name}: skipped, {asked.data / folder} is absent\n")
        return []
    return judge(asked)


def main() -> None:
    """Print the tables of one ground, or of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("ground", choices=[*GROUNDS, "all"])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="in one line")
    parser.add_argument("--smoke", action="store_true", help="as little as shows that all of it works")
    parser.add_argument("--maps", type=Path, help="a folder where learned maps are kept and found again")
    given = parser.parse_args()
    logging.disable(logging.INFO)
    warnings.filterwarnings("ignore", "overflow encountered in exp")
    asked = Asked(given.data, 1 if given.smoke else given.seeds, given.smoke, given.maps)
    made = {
        table.about: {"ground": name} | table.as_json()
        for name in (GROUNDS if given.ground == "all" else [given.ground])
        for table in findings(name, asked)
    }
    print(json.dumps(made, indent=None if given.json else 1))


if __name__ == "__main__":
    main()
