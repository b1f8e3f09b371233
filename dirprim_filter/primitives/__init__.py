"""What do vehicles do here? Directional primitives and how they are learned.

Learning reads in the order of the paper's section III:

- `learning`: the whole of it; what can be asked for.
- `rows`: observations, thinned (Algorithm 1), and those of each cell as columns.
- `fitting`: cells and their parents, all at once; the paper's two steps, DBSCAN and gammas of speed (Eq. 3).
- `_kernels`: the number of modes by BIC, and the climb to each fit.
- `_em`: the two steps of that (Eq. 1 and 3).
- `primitive_map`: the result, a function of position; its density and samples in `_map_kernels`.

Beside it: `background`, what holds at no place; `motion`, how vehicles go on, by `visits`; `traffic`, how many are
where; `leader`, the vehicle ahead; `cues` (Eq. 4).
"""
