"""Is moving by manoeuvres as good as a network trained for nothing but the forecast?

Defends: the motion model of `primitives.motion`, which forecasts any horizon, beside a mixture density network
(Bishop 1994) trained straight for one: position, direction and speed in, a mixture of eight Gaussians of the position
so many seconds later out. Early stopping on vehicles of its own. Same vehicles for all.

    python tests/benchmarks/forecast_network.py recordings/roundabout_learn.mcap [--horizon 5] [--seeds 1]

torch is no dependency: pip install torch --index-url https://download.pytorch.org/whl/cpu
"""

import argparse
import sys

import numpy as np

from dirprim_filter import read_tracks
from dirprim_filter.cli.evaluate.forecast import forecast_text
from dirprim_filter.evaluation import forecast_cases
from dirprim_filter.evaluation.forecast_cases import Cases
from dirprim_filter.evaluation.forecast_methods import Forecaster, by_constant_velocity, by_map, by_trajectory_memory
from dirprim_filter.evaluation.forecasting import evaluate_forecasts

try:
    import torch
    from torch import nn
except ImportError:
    sys.exit("torch: not installed; pip install torch --index-url https://download.pytorch.org/whl/cpu")

N_COMPONENTS, WIDTH = 8, 128
BATCH, MOST_EPOCHS, PATIENCE = 256, 200, 15
VALIDATION = 0.2
"""Of the training vehicles."""
EVERY_S, MOST_STARTS = 0.4, 60
"""Of the cases to learn from: many more than are judged."""


class MixtureDensityNetwork(nn.Module):
    """Log density and samples of a displacement in the vehicle's own frame, in units of its spread."""

    def __init__(self, n_inputs):
        super().__init__()
        self.body = nn.Sequential(
            nn.Linear(n_inputs, WIDTH), nn.SiLU(), nn.Linear(WIDTH, WIDTH), nn.SiLU(), nn.Linear(WIDTH, WIDTH),
            nn.SiLU(),
            nn.Linear(WIDTH, 6 * N_COMPONENTS),
        )  # fmt: skip

    def forward(self, inputs):
        """Log weights, means and Cholesky factors of the precisions."""
        out = self.body(inputs).reshape(len(inputs), N_COMPONENTS, 6)
        log_weight = torch.log_softmax(out[..., 0], dim=1)
        return log_weight, out[..., 1:3], out[..., 3].clamp(-7, 7), out[..., 4].clamp(-7, 7), out[..., 5]

    def log_density(self, inputs, target):
        """(n, F), (n, 2) -> (n,)."""
        log_weight, mean, log_a, log_b, c = self(inputs)
        dx, dy = (target[:, None] - mean).unbind(-1)
        a, b = log_a.exp(), log_b.exp()
        fit = log_a + log_b - np.log(2 * np.pi) - 0.5 * ((a * dx) ** 2 + (c * dx + b * dy) ** 2)
        return torch.logsumexp(log_weight + fit, dim=1)

    def sample(self, inputs, n, generator):
        """(m, F) -> (m, n, 2)."""
        log_weight, mean, log_a, log_b, c = self(inputs)
        k = torch.multinomial(log_weight.exp(), n, replacement=True, generator=generator)
        z = torch.randn(len(inputs), n, 2, generator=generator)
        at = [torch.gather(column, 1, k) for column in (mean[..., 0], mean[..., 1], log_a, log_b, c)]
        dx = z[..., 0] / at[2].exp()
        dy = (z[..., 1] - at[4] * dx) / at[3].exp()
        return torch.stack([at[0] + dx, at[1] + dy], dim=-1)


def by_network(train, horizons_s, rng):
    """A network for the last of the horizons; the others it does not know."""
    torch.manual_seed(int(rng.integers(2**31)))
    torch.set_num_threads(2)
    kept = forecast_cases.START_EVERY_S, forecast_cases.MAX_STARTS
    forecast_cases.START_EVERY_S, forecast_cases.MAX_STARTS = EVERY_S, MOST_STARTS
    cases = Cases.of(train, horizons_s=horizons_s)
    forecast_cases.START_EVERY_S, forecast_cases.MAX_STARTS = kept
    known = np.isfinite(cases.later[:, -1, 0])
    center, scale = cases.position.mean(axis=0), cases.position.std()

    def inputs_of(some):
        x, y = ((some.position - center) / scale).T
        columns = [x, y, np.cos(some.direction), np.sin(some.direction), some.speed / 10.0, x**2, y**2, x * y]
        return torch.tensor(np.column_stack(columns), dtype=torch.float32)

    def turned(vector, angle):
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([c * vector[..., 0] - s * vector[..., 1], s * vector[..., 0] + c * vector[..., 1]], axis=-1)

    way = turned(cases.later[:, -1] - cases.position, -cases.direction)[known]
    spread = way.std(axis=0)
    inputs, target = inputs_of(cases)[known], torch.tensor(way / spread, dtype=torch.float32)
    vehicles = rng.permutation(np.unique(cases.vehicle))
    judged = torch.tensor(np.isin(cases.vehicle[known], vehicles[: max(1, int(VALIDATION * vehicles.size))]))
    network = MixtureDensityNetwork(inputs.shape[1])
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-3, weight_decay=1e-4)
    best, least, waited = None, np.inf, 0
    learned = torch.nonzero(~judged)[:, 0]
    for _ in range(MOST_EPOCHS):
        for batch in learned[torch.randperm(len(learned))].split(BATCH):
            optimizer.zero_grad()
            (-network.log_density(inputs[batch], target[batch]).mean()).backward()
            optimizer.step()
        with torch.no_grad():
            loss = float(-network.log_density(inputs[judged], target[judged]).mean())
        waited += 1
        if loss < least:
            least, waited = loss, 0
            best = {name: value.clone() for name, value in network.state_dict().items()}
        if waited > PATIENCE:
            break
    network.load_state_dict(best)

    def sample(some, n_samples, rng):
        generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
        with torch.no_grad():
            drawn = network.sample(inputs_of(some), n_samples, generator).numpy() * spread
        out = np.zeros((len(some.speed), n_samples, len(horizons_s), 2))
        out[:, :, -1] = some.position[:, None] + turned(drawn, some.direction[:, None])
        return out

    return {"network": Forecaster(sample)}


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", nargs="+")
    parser.add_argument("--horizon", type=float, default=5.0)
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    table = evaluate_forecasts(
        read_tracks(given.log), horizons_s=(given.horizon,), n_seeds=given.seeds,
        methods=(by_map, by_network, by_trajectory_memory, by_constant_velocity), rng=np.random.default_rng(0),
    )  # fmt: skip
    print(forecast_text(table))


if __name__ == "__main__":
    main()
