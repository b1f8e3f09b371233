"""A neural field of motion, the reference for learned cells: a mixture density network on the position alone.

A peer that knows nothing of cells: a multilayer perceptron from (x, y) to a mixture of von Mises x gamma, trained by
Adam on the log density of direction and speed, stopped early by validation vehicles; of several encodings of the
position, the one that those vehicles like best. torch is no dependency of the package: pip install torch
"""

from __future__ import annotations

import numpy as np

try:
    import torch
except ImportError as error:
    raise SystemExit("the neural field needs torch, which is no dependency: pip install torch") from error

N_MODES, WIDTH = 6, 128
VALIDATION_SHARE = 0.2
BATCH, MOST_EPOCHS, PATIENCE = 512, 150, 20
FEWEST_STEPS = 5000
"""Of the optimiser: small logs are gone through more often."""
ENCODINGS = (0.0, 1.0, 3.0)
"""Standard deviation of the frequencies of random Fourier features, per unit of the scaled position; 0 for none."""
LEAST_SPEED = 1e-3


class Field(torch.nn.Module):
    """Position to the parameters of a mixture."""

    def __init__(self, frequency: float, middle: np.ndarray, scale: float) -> None:
        super().__init__()
        self.middle, self.scale = torch.as_tensor(middle, dtype=torch.float32), scale
        self.frequency = torch.randn(2, 64, dtype=torch.float32) * frequency * 2 * np.pi if frequency else None
        n_in = 2 + (128 if frequency else 0)
        layers: list[torch.nn.Module] = []
        for n in (n_in, WIDTH, WIDTH):
            layers += [torch.nn.Linear(n, WIDTH, dtype=torch.float32), torch.nn.SiLU()]
        self.network = torch.nn.Sequential(*layers, torch.nn.Linear(WIDTH, 6 * N_MODES, dtype=torch.float32))

    def log_density(self, position: torch.Tensor, direction: torch.Tensor, speed: torch.Tensor) -> torch.Tensor:
        """Of each row, (n,)."""
        x = (position - self.middle) / self.scale
        if self.frequency is not None:
            turned = x @ self.frequency
            x = torch.cat([x, torch.cos(turned), torch.sin(turned)], dim=1)
        out = self.network(x).reshape(-1, N_MODES, 6)
        log_weight = torch.log_softmax(out[..., 0], dim=1)
        mean = torch.atan2(out[..., 1], out[..., 2] + 1e-9)
        kappa = torch.clamp(torch.exp(out[..., 3] + 2.0), 1e-3, 1e4)
        shape = torch.clamp(torch.exp(out[..., 4] + 1.0), 1e-2, 1e4)
        rate = shape / torch.exp(out[..., 5] + 1.0)
        v = torch.clamp(speed, LEAST_SPEED)[:, None]
        log_direction = kappa * (torch.cos(direction[:, None] - mean) - 1.0)
        log_direction -= torch.log(torch.special.i0e(kappa)) + np.log(2 * np.pi)
        log_speed = shape * torch.log(rate) + (shape - 1) * torch.log(v) - rate * v - torch.lgamma(shape)
        return torch.logsumexp(log_weight + log_direction + log_speed, dim=1)


def _tensors(tracks):
    columns = (tracks.position, tracks.direction, tracks.speed)
    return tuple(torch.as_tensor(column, dtype=torch.float32) for column in columns)


def _train(frequency, fitted, validation, seed):
    torch.manual_seed(seed)
    rows, kept = _tensors(fitted), _tensors(validation)
    field = Field(frequency, fitted.position.mean(axis=0), float(np.ptp(fitted.position, axis=0).max()) / 2)
    optimiser = torch.optim.Adam(field.parameters(), lr=2e-3, weight_decay=1e-6)
    best, state, since = -np.inf, None, 0
    more = max(1.0, FEWEST_STEPS / (MOST_EPOCHS * -(-len(rows[0]) // BATCH)))
    schedule = torch.optim.lr_scheduler.ReduceLROnPlateau(
        optimiser, mode="max", factor=0.5, patience=int(0.4 * PATIENCE * more)
    )
    for _ in range(int(more * MOST_EPOCHS)):
        for batch in torch.randperm(len(rows[0])).split(BATCH):
            optimiser.zero_grad()
            loss = -field.log_density(*(column[batch] for column in rows)).mean()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(field.parameters(), 5.0)
            optimiser.step()
        with torch.no_grad():
            reached = float(field.log_density(*kept).mean())
        schedule.step(reached)
        since += 1
        if reached > best:
            best, state, since = reached, {k: v.clone() for k, v in field.state_dict().items()}, 0
        if since > more * PATIENCE:
            break
    field.load_state_dict(state)
    return best, field


def neural_field(train, group, *, seed=0):
    """The field that validation vehicles like best, as a function of tracks; `group` (n,) is held out together."""
    names = np.unique(group)
    rng = np.random.default_rng(seed)
    aside = np.isin(group, rng.permutation(names)[: max(1, int(VALIDATION_SHARE * names.size))])
    found = [_train(frequency, train[~aside], train[aside], seed) for frequency in ENCODINGS]
    field = max(found, key=lambda pair: pair[0])[1]

    def log_density(tracks):
        with torch.no_grad():
            return field.log_density(*_tensors(tracks)).numpy().astype(np.float64)

    return log_density
