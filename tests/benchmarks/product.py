"""Samples of Eq. 4, what is usual here times a turn signal: in closed form, and by the paper's rejection sampler.

The decision it defends: the product is taken in closed form and sampled exactly; rejection stays for reproduction. The
prior has three modes at -45, 0 and 45 degrees of weights 0.5, 0.3 and 0.2 and concentration 20, as the paper's Fig. 2
looks (the paper prints no numbers); the cue is its turn signal, VM(-90 degrees, 2.5); the proposal is a broad von Mises
around -60 degrees with the least envelope that holds.

    python tests/benchmarks/product.py [samples]
"""

import sys
import time
from collections.abc import Callable

import numpy as np
from scipy import stats

from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.product import multiply_mixtures


def mixture(*modes: tuple[float, float, float]) -> VonMisesMixture:
    """Of weight, mean direction in degrees and concentration."""
    weight, mean, concentration = np.array(modes).T
    return VonMisesMixture(weight=weight, mean_direction=np.deg2rad(mean), concentration=concentration)


PRIOR = mixture((0.5, -45.0, 20.0), (0.3, 0.0, 20.0), (0.2, 45.0, 20.0))
SIGNAL = mixture((1.0, -90.0, 2.5))
BROAD = mixture((1.0, -60.0, 1.0))


def log_target(theta: np.ndarray) -> np.ndarray:
    """The product, not normalised."""
    return PRIOR.log_density(theta) + SIGNAL.log_density(theta)


def seconds(work: Callable[[], object], repeats: int) -> float:
    """The least wall time of a call, after one to warm up."""
    work()
    found = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        found.append(time.perf_counter() - start)
    return min(found)


def main() -> None:
    """Print the table."""
    n = int(float(sys.argv[1])) if len(sys.argv) > 1 else 100_000
    rng = np.random.default_rng(0)
    circle = np.linspace(-np.pi, np.pi, 100_001)
    envelope = float((log_target(circle) - BROAD.log_density(circle)).max()) + 1e-6

    def exact() -> np.ndarray:
        return multiply_mixtures(PRIOR, SIGNAL).mixture.sample(n_samples=n, rng=rng)[0]

    def rejected() -> np.ndarray:
        kept: list[np.ndarray] = []
        while sum(map(len, kept)) < n:
            theta, _ = BROAD.sample(n_samples=2 * n, rng=rng)
            log_ratio = log_target(theta) - envelope - BROAD.log_density(theta)
            kept.append(theta[np.log(rng.random(2 * n)) < log_ratio])
        return np.concatenate(kept)[:n]

    ours, theirs = seconds(exact, 15), seconds(rejected, 3)
    agree = stats.ks_2samp(exact(), rejected()).pvalue
    print(f"{n:,} samples of prior times turn signal; the two agree with p = {agree:.2f}")
    print(f"closed form   {ours * 1e3:9.2f} ms")
    print(f"rejection     {theirs * 1e3:9.2f} ms   {theirs / ours:.0f} times as long")


if __name__ == "__main__":
    main()
