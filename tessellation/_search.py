"""The steps of `joint.fit_jointly`: each takes a state and gives one of lower objective, or the same."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Generic

import numpy as np
from scipy.spatial import Delaunay, QhullError

from tessellation._arrays import BoolArray, FloatArray, IntArray
from tessellation._scoring import N_RIVALS, scoring_step
from tessellation.gates import halve, leave_out, members_of, nearest_generators, part_of_members, residents, unite
from tessellation.protocols import CellModel, Cells, Data_contra, Members

LEAST_ROWS = 4
"""A cell of fewer rows is not split."""
CHILD_DISTANCE = 0.8
"""Halves of a normal distribution have their means so many standard deviations from its own."""
MARGIN = 2.0
"""Standard errors by which a split, or a merger, must gain."""
TRIES = 3
"""Steps that raise the objective are halved so often before they are given up."""
MOVE_WIDTHS = (0.25, 0.1)
LEAST_GAIN = 5e-3
"""Of the objective per datum: a round that gains less is the last."""


@dataclass(slots=True, kw_only=True, eq=False)
class State(Generic[Cells]):
    """Cells, as fitted without each of the folds, and what they give to the rows held out."""

    generators: FloatArray  # (n_cells, 2)
    members: Members
    cell: IntArray  # (n,) of each row
    signature: FloatArray  # (n_cells,) the same for the same members
    fits: Cells  # cell c without fold f is number c * n_folds + f
    score: FloatArray  # (n,) log density of each row as held out
    objective: float  # minus the mean of the scores
    finished: BoolArray  # (n_cells,) cells that are known not to gain by a split
    refused: FloatArray  # (n,) sums of two signatures, of cells that are known not to gain by being one


@dataclass(frozen=True, slots=True, kw_only=True)
class Search(Generic[Data_contra, Cells]):
    """What does not change while cells are laid out: the data, and how they are held out.

    Attributes:
        model: what happens in a cell.
        position: (n_all, 2) metres.
        data: of the model, all of it.
        row: (n,) the data that are used, ascending.
        fold: (n,) of each of them.
        group: (n,) of each of them, 0 to n_groups - 1.
        salt: (n_all,) random numbers that break ties between members.
        softness: of the gates.
        smallest: metres; a cell that spreads less along an axis is not split across it.
    """

    model: CellModel[Data_contra, Cells]
    position: FloatArray
    data: Data_contra
    row: IntArray
    fold: IntArray
    group: IntArray
    salt: FloatArray
    softness: float
    smallest: float

    @property
    def n_folds(self) -> int:
        """How many folds there are."""
        return int(self.fold.max()) + 1

    # States -----------------------------------------------------------------------------------------------------------

    def evaluate(self, generators: FloatArray, *before: State[Cells]) -> State[Cells]:
        """The state of these generators.

        Args:
            generators: (n_cells, 2).
            before: cells that one of these states has with the same members are taken from it.
        """
        members, cell = members_of(self.position[self.row], generators, softness=self.softness)
        of_member = np.repeat(np.arange(len(generators)), np.diff(members.start))
        salt = members.weight * self.salt[self.row[members.row]]
        signature = np.asarray(np.bincount(of_member, salt, len(generators)), np.float64)
        source, number = known(generators, signature, before)
        new = np.flatnonzero(source < 0)
        fitted = self._fit(part_of_members(members, new))
        source[new], number[new] = len(before), np.arange(new.size)
        first = np.cumsum([0, *(len(state.generators) for state in before)])
        without = self.n_folds * (first[source] + number)[:, None] + np.arange(self.n_folds)
        fits = gathered([*(state.fits for state in before), fitted], without.ravel())
        score = np.empty(self.row.size)
        again = np.ones(self.row.size, np.bool_)
        finished = np.zeros(len(generators), np.bool_)
        for i, state in enumerate(before):
            same = (source[cell] == i) & (number[cell] == state.cell)
            score[same], again[same] = state.score[same], False
            finished[source == i] = state.finished[number[source == i]]
        row = np.flatnonzero(again)
        score[row] = self._log_density(fits, row, cell[row])
        return State(
            generators=generators, members=members, cell=cell, signature=signature, fits=fits,
            score=score, objective=-float(score.mean()), finished=finished,
            refused=before[0].refused if before else np.empty(0),
        )  # fmt: skip

    def _fit(self, members: Members) -> Cells:
        """Every cell without each of the folds."""
        kept = leave_out(members, self.fold, self.n_folds)  # numbered among the data that are used
        return self.model.fit(self.position, self.data, kept._replace(row=self.row[kept.row]))

    def _log_density(self, fits: Cells, row: IntArray, cell: IntArray) -> FloatArray:
        """Of rows, numbered among those used, in cells as fitted without the row's fold."""
        held_out = cell * self.n_folds + self.fold[row]
        return self.model.log_density(fits, self.position, self.data, self.row[row], held_out)

    # Steps ------------------------------------------------------------------------------------------------------------

    def split(self, state: State[Cells]) -> State[Cells]:
        """Split the cells that gain by it more than by chance."""
        children, gain, error = self._halves(state)
        axis = gain.argmax(axis=0)
        cells = np.arange(axis.size)
        best = gain[axis, cells]
        needed = MARGIN * error[axis, cells]
        order = np.argsort(-best, kind="stable")
        state.finished[:] |= ~(best > needed)
        order = order[(best > needed)[order] & (best[order] > 0)]
        return self._replaced(state, order[:, None], children[axis[order], order])

    def _replaced(self, state: State[Cells], gone: IntArray, made: FloatArray) -> State[Cells]:
        """All of these replacements, or the first half of them, or a quarter, as soon as the objective falls.

        Args:
            state: the cells.
            gone: (p, q) cells, of which none is twice.
            made: (p, r, 2) the generators in their places.
        """
        for _ in range(TRIES):
            if len(gone) == 0:
                break
            kept = np.delete(state.generators, gone.ravel(), axis=0)
            found = self.evaluate(np.vstack([kept, made.reshape(-1, 2)]), state)
            if found.objective < state.objective:
                return found
            gone, made = gone[: len(gone) // 2], made[: len(gone) // 2]
        return state

    def _halves(self, state: State[Cells]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Both ways to split each cell: generators (2, n_cells, 2, 2), gain of log density and its standard error."""
        n = len(state.generators)
        place = self.position[self.row]
        count = np.bincount(state.cell, minlength=n)
        safe = np.maximum(count, 1)
        mean = np.column_stack([np.bincount(state.cell, x, minlength=n) / safe for x in place.T])
        east, north = (place - mean[state.cell]).T
        moment = [np.bincount(state.cell, p, minlength=n) / safe for p in (east**2, east * north, north**2)]
        variance, axes = np.linalg.eigh(np.stack([moment[0], moment[1], moment[1], moment[2]], axis=1).reshape(n, 2, 2))
        children = np.empty((2, n, 2, 2))
        gain, error = np.full((2, n), -np.inf), np.zeros((2, n))
        for a in (0, 1):
            step = CHILD_DISTANCE * np.sqrt(np.maximum(variance[:, a], 0.0))
            unit = axes[:, :, a]
            children[a] = np.stack([mean - step[:, None] * unit, mean + step[:, None] * unit], axis=1)
            tried = np.flatnonzero(~state.finished & (count >= LEAST_ROWS) & (step > self.smallest))
            if tried.size:
                gain[a, tried], error[a, tried] = self._gain_of_halves(state, tried, mean, unit, step, children[a])
        return children, gain, error

    def _gain_of_halves(
        self, state: State[Cells], tried: IntArray, mean: FloatArray, unit: FloatArray, step: FloatArray,
        children: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """What the rows of the tried cells gain by halves across `unit`, and the standard error of that."""
        part = part_of_members(state.members, tried)
        border = np.hstack([mean[tried], unit[tried]])
        place = self.position[self.row]
        fits = self._fit(halve(part, place, border, self.softness * step[tried], children[tried].reshape(-1, 2)))
        held, which = _rows_of(state, tried)
        second = ((place[held] - border[which, :2]) * border[which, 2:]).sum(axis=1) > 0
        gain = self._log_density(fits, held, 2 * which + second) - state.score[held]
        return self._total_and_error(gain, which, self.group[held], tried.size)

    def _total_and_error(
        self, gain: FloatArray, cell: IntArray, group: IntArray, n_cells: int
    ) -> tuple[FloatArray, FloatArray]:
        """Gains summed over each cell, and the standard error of the sum over groups."""
        pair, index = np.unique(cell * (int(self.group.max()) + 1) + group, return_inverse=True)
        of_group = np.bincount(index, gain)
        owner = pair // (int(self.group.max()) + 1)
        total = np.bincount(owner, of_group, minlength=n_cells)
        return np.asarray(total, np.float64), np.sqrt(np.bincount(owner, of_group**2, minlength=n_cells))

    def move(self, state: State[Cells]) -> State[Cells]:
        """Move generators by scoring steps, with the cells as they are fitted: first far, then by less and less."""
        for width in MOVE_WIDTHS if len(state.generators) > 1 else ():
            log_density = partial(self._log_density, state.fits)
            step = scoring_step(self.position[self.row], state.generators, width=width, log_density=log_density)
            state = self._helpful(state, state.generators + step)
        return state

    def _helpful(self, state: State[Cells], trial: FloatArray) -> State[Cells]:
        """The best of the state, that of all the moves, and of those alone that help the cells around."""
        every = self.evaluate(trial, state)
        _, around = nearest_generators(self.position[self.row], state.generators, k=N_RIVALS - 1)
        gained = np.repeat(every.score - state.score, around.shape[1])
        helped = np.bincount(around.ravel(), gained, minlength=len(trial)) > 0  # the rows for which each cell competes
        some = self.evaluate(np.where(helped[:, None], trial, state.generators), state, every)
        return min((state, every, some), key=lambda found: found.objective)

    def merge(self, state: State[Cells]) -> State[Cells]:
        """Unite neighbours that do better as one, by more than by chance."""
        n = len(state.generators)
        if n < 2:
            return state
        pair = _neighbors(state.generators)
        pair = pair[~np.isin(state.signature[pair].sum(axis=1), state.refused)]
        mass = np.maximum(np.bincount(state.cell, minlength=n), 1)
        united = (mass[pair, None] * state.generators[pair]).sum(axis=1) / mass[pair].sum(axis=1)[:, None]
        both = part_of_members(state.members, pair.ravel())
        fits = self._fit(unite(both, np.arange(pair.size) // 2, united))
        held, each = _rows_of(state, pair.ravel())
        change = self._log_density(fits, held, each // 2) - state.score[held]
        gain, error = self._total_and_error(change, each // 2, self.group[held], len(pair))
        gain -= MARGIN * error
        state.refused = np.union1d(state.refused, state.signature[pair[gain <= 0]].sum(axis=1))
        chosen = _disjoint(pair, gain)
        return self._replaced(state, pair[chosen], united[chosen])


def _rows_of(state: State[Cells], cells: IntArray) -> tuple[IntArray, IntArray]:
    """The rows that lie in each of some cells, cell by cell, and in which of these; of a cell given twice twice."""
    homes = part_of_members(residents(state.cell, state.generators), cells)
    return homes.row, np.repeat(np.arange(cells.size), np.diff(homes.start))


def _neighbors(generators: FloatArray) -> IntArray:
    """(n, 2) generators whose cells share a border, and each with its nearest; every pair once."""
    nearest = nearest_generators(generators, generators, k=2)[1][:, 1]
    pairs = [np.column_stack([np.arange(len(generators)), nearest])]
    try:
        corner = Delaunay(generators).simplices
        pairs += [corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]]
    except QhullError:  # fewer than three, or all on a line: then the nearest are neighbours
        pass
    return np.unique(np.sort(np.vstack(pairs).astype(np.int64), axis=1), axis=0)


def _disjoint(pair: IntArray, gain: FloatArray) -> IntArray:
    """Which pairs gain, best first, none with a cell that a better one has."""
    used: set[int] = set()
    chosen = []
    for p in np.argsort(-gain, kind="stable"):
        if gain[p] > 0.0 and not used.intersection(pair[p].tolist()):
            chosen.append(p)
            used.update(pair[p].tolist())
    return np.array(chosen, dtype=np.int64)


def known(generators: FloatArray, signature: FloatArray, before: tuple[State[Cells], ...]) -> tuple[IntArray, IntArray]:
    """Which of the states before has each cell with the same members, and its number there; -1 where none has."""
    numbers = {
        key: (i, c)
        for i, state in enumerate(before)
        for c, key in enumerate(zip(*state.generators.T.tolist(), state.signature.tolist(), strict=True))
    }
    keys = zip(*generators.T.tolist(), signature.tolist(), strict=True)
    source, number = np.array([numbers.get(key, (-1, -1)) for key in keys], dtype=np.int64).reshape(-1, 2).T.copy()
    return source, number


def gathered(parts: list[Cells], index: IntArray) -> Cells:
    """The parameters of some cells, numbered through all the parts."""
    return type(parts[0])(*(np.concatenate(columns)[index] for columns in zip(*parts, strict=True)))
