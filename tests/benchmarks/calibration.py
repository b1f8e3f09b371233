"""How often `calibrate` finds each number of a simulated sensor within what it says is uncertain: 100 runs of three.

Defends the standard errors of `evaluation.calibration`: intervals of 99 % hold at least 90 in 100.

    python tests/benchmarks/calibration.py
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter.evaluation.calibration import calibrate
from dirprim_filter.simulation.sensor import sense
from evaluation.test_calibration import BIASED, CORRELATED, TRUTH, WHITE

RUNS = 100

for name, sensor in (("white", WHITE), ("correlated", CORRELATED), ("biased", BIASED)):
    held, reported = Counter(), Counter()
    for seed in range(RUNS):
        found = calibrate(sense(TRUTH, sensor, rng=np.random.default_rng(seed)), TRUTH).sensor
        for number, value in sensor.numbers().items():
            if value is not None and number in found.uncertainty:
                reported[number] += 1
                held[number] += abs(found.numbers()[number] - value) <= found.uncertainty[number]
    print(name, ", ".join(f"{number} {held[number]}/{reported[number]}" for number in reported), flush=True)
